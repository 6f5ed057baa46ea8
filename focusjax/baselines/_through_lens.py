"""The picture by definition: cast every lens ray at the triangles themselves.

Shares nothing with the layers or the tracer but the lens that makes the rays and the scene's shader, which
looks at every point from where the ray starts, not from the lens centre.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._counts import require_counts
from focusjax._parallel import CORES, in_parallel, parts
from focusjax._programs import jit
from focusjax.baselines._raycast import RayCaster, world_rays
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, in_colour
from focusjax.scene import AbstractBackground, Scene, Shader

_AT_ONCE = 1 << 15
# One over powers of the generalised golden ratio: steps that fill the 4-cube evenly (Roberts 2018).
STEPS = 0.8566748838545029 ** np.arange(1, 5)
_TEXTURE_SHARE = 1 / 8


class RayScene:
    """A scene made ready for ray casting, so that several pictures share the work.

    Surfaces are opaque to it, whatever their opacity.

    Args:
        scene: what to see.

    Raises:
        ValueError: Embree's Python binding is not installed.
    """

    def __init__(self, scene: Scene):
        self.background: AbstractBackground = scene.background
        self.caster = RayCaster(scene.vertices, scene.faces)
        # The eye is given anew for every ray.
        self.shader: Shader = scene.shader(np.zeros(3))


def lens_picture(
    scene: Scene | RayScene, camera: Camera, lens: AbstractLens, *, rays: int = 64, seed: int = 0
) -> np.ndarray:
    """Linear picture [h, w, 3] through `lens`, each pixel the weighted mean of `rays` rays.

    A pixel's film points cover its unit square (box filter) and its pupil points the whole opening.
    Textures are read at an eighth of a pixel, so that the rays do the averaging.

    Args:
        scene: what to see.
        camera: frame and pose.
        lens: where rays go.
        rays: per pixel.
        seed: of the random shift of each pixel's ray pattern.

    Raises:
        ValueError: fewer than one ray, or Embree is not installed.
    """
    require_counts(rays=rays)
    ready = scene if isinstance(scene, RayScene) else RayScene(scene)
    pixel = pixel_corners(camera)
    shifts = np.random.default_rng(seed).uniform(size=(len(pixel), 4))

    def mean_of(block: slice) -> np.ndarray:
        corner, shift = pixel[block][:, None], shifts[block][:, None]
        total = np.zeros((len(corner), 3))
        # Small pictures have several rays of each pixel cast at once.
        for some in parts(rays, max(1, _AT_ONCE // len(corner))):
            square = (shift + np.arange(rays)[some, None] * STEPS) % 1.0
            film = (corner + square[..., :2]).reshape(-1, 2)
            seen = radiance(ready, camera, lens, film, square[..., 2:].reshape(-1, 2))
            total += seen.reshape(*square.shape[:2], 3).sum(axis=1)
        return total / rays

    means = in_parallel(mean_of, blocks(len(pixel)))
    return np.concatenate(means).reshape(camera.height, camera.width, 3)


def pixel_corners(camera: Camera) -> Int[np.ndarray, "p 2"]:
    """Top-left corners of all pixels (x right, y down), row after row."""
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([columns, rows], axis=-1).reshape(-1, 2)


def blocks(pixels: int) -> list[slice]:
    """That many pixels in blocks of like length, some for every core, small enough for its caches."""
    return parts(pixels, min(_AT_ONCE, -(-pixels // CORES)))


def radiance(
    ready: RayScene,
    camera: Camera,
    lens: AbstractLens,
    film: Float[np.ndarray, "n 2"],
    pupil: Float[np.ndarray, "n 2"],
) -> Float[np.ndarray, "n 3"]:
    """Weighted radiance along one ray per film point in pixels and pupil sample of the unit square."""
    real = jnp.zeros(()).dtype
    starts = jnp.asarray(film, dtype=real), jnp.asarray(pupil, dtype=real)

    def seen(lens: AbstractLens) -> Float[np.ndarray, "n 3"]:
        lines = _image_lines(lens, camera, *starts)
        a, b, weight = (np.asarray(part, dtype=np.float64) for part in lines)
        return weight[:, None] * line_radiance(ready, camera, a, b)[0]

    return np.asarray(in_colour(seen, lens))


def line_radiance(
    ready: RayScene, camera: Camera, a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Radiance and disparity (1/m, 0 on the background) at the ends of the image lines a + b w."""
    real = jnp.zeros(()).dtype
    origins, directions = world_rays(camera, a, b)
    hits = ready.caster.first_hits(origins, directions)
    seen = hits.triangle >= 0
    # Directions advance one metre along the view axis, so the distance is the depth.
    width = np.where(seen, hits.distance, 1.0) / float(camera.focal_px) * _TEXTURE_SHARE
    colour = _colours(
        ready.shader,
        ready.background,
        jnp.asarray(np.maximum(hits.triangle, 0), dtype=jnp.int32),
        jnp.asarray(hits.barycentric, dtype=real),
        jnp.asarray(width, dtype=real),
        jnp.asarray(origins, dtype=real),
        jnp.asarray(directions, dtype=real),
        jnp.asarray(seen),
    )
    return np.asarray(colour, dtype=np.float64), 1.0 / hits.distance


@jit
def _image_lines(
    lens: AbstractLens, camera: Camera, film: Float[Array, "n 2"], pupil: Float[Array, "n 2"]
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"], Float[Array, " n"]]:
    def one(point: Float[Array, "2"], sample: Float[Array, "2"]):
        ray = lens.ray(camera, point, lens.pupil_point(sample))
        return ray.a, ray.b, ray.weight

    return jax.vmap(one)(film, pupil)


@jit
def _colours(
    shader: Shader,
    background: AbstractBackground,
    triangle: Int[Array, " n"],
    barycentric: Float[Array, "n 3"],
    width: Float[Array, " n"],
    eye: Float[Array, "n 3"],
    direction: Float[Array, "n 3"],
    seen: Array,
) -> Float[Array, "n 3"]:
    def seen_from(eye: Float[Array, "3"], *sample: Array) -> Float[Array, "3"]:
        return dataclasses.replace(shader, eye=eye)(*sample)

    surface = jax.vmap(seen_from)(eye, triangle, barycentric, width)
    return jnp.where(seen[:, None], surface, jax.vmap(background.radiance)(direction))
