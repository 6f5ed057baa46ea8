"""The picture by definition: cast every lens ray at the triangles themselves, with Embree.

Shares nothing with the layers or the tracer but the lens that makes the rays and the scene's shader, which
looks at every point from where the ray starts, not from the lens centre.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens
from focusjax.scene import AbstractBackground, Scene, Shader

_AT_ONCE = 1 << 18
# One over powers of the generalised golden ratio: steps that fill the 4-cube evenly (Roberts 2018).
_STEPS = 0.8566748838545029 ** np.arange(1, 5)
_TEXTURE_SHARE = 1 / 8


@dataclasses.dataclass(frozen=True)
class SurfaceHits:
    """First surfaces along rays.

    Attributes:
        triangle: index [n] into the scene's faces; -1 where nothing is hit.
        distance: position [n] along the ray in multiples of its direction vector; infinite where
            nothing is hit.
        barycentric: weights [n, 3] of the face's three vertices.
    """

    triangle: Int[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]


class RayCaster:
    """Triangles made ready for ray casting; building takes about 5 s per million triangles.

    Args:
        vertices: world metres [v, 3].
        faces: vertex indices [t, 3].

    Raises:
        ValueError: Embree's Python binding is not installed.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]):
        try:
            from embreex.mesh_construction import TriangleMesh
            from embreex.rtcore_scene import EmbreeScene
        except ImportError as error:
            raise ValueError(
                "the ray-casting baseline needs Embree, which is not installed; run `pip install embreex`"
            ) from error
        self._corners = np.asarray(vertices, dtype=np.float64)[faces]
        # Embree computes in single precision: keep its coordinates small.
        self._centre = self._corners.mean(axis=(0, 1))
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, (self._corners - self._centre).astype(np.float32))

    def first_hits(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> SurfaceHits:
        """The nearest surface, seen from either side, along each ray.

        Embree names the triangle; where it is met is solved again in double precision.

        Args:
            origins: world metres.
            directions: world vectors of any length.
        """
        found = self._scene.run(
            (origins - self._centre).astype(np.float32),
            directions.astype(np.float32),
            query="INTERSECT",
            output=1,
        )
        triangle = np.asarray(found["primID"]).astype(np.int64)
        hit = triangle >= 0
        distance = np.full(len(triangle), np.inf)
        barycentric = np.zeros((len(triangle), 3))
        distance[hit], barycentric[hit] = _meet(
            self._corners[triangle[hit]], origins[hit].astype(np.float64), directions[hit].astype(np.float64)
        )
        return SurfaceHits(np.where(hit, triangle, -1), distance, barycentric)


def lens_picture(
    scene: Scene, camera: Camera, lens: AbstractLens, *, rays: int = 64, seed: int = 0
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
    if rays < 1:
        raise ValueError(f"rays is {rays}; expected at least 1 per pixel")
    caster = RayCaster(scene.vertices, scene.faces)
    shader = scene.shader(camera.position)
    shifts = np.random.default_rng(seed).uniform(size=(camera.height * camera.width, 4))
    pixel = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).reshape(-1, 2)
    total = np.zeros((len(pixel), 3))
    for first in range(0, len(pixel), _AT_ONCE):
        block = slice(first, first + _AT_ONCE)
        for number in range(rays):
            square = (shifts[block] + number * _STEPS) % 1.0
            film = pixel[block] + square[:, :2]
            total[block] += _radiance(scene, shader, caster, camera, lens, film, square[:, 2:])
    return (total / rays).reshape(camera.height, camera.width, 3)


def nearest_in_scene(scene: Scene, camera: Camera) -> Callable[[LensRay], Float[np.ndarray, " n"]]:
    """Which surface lens rays of `camera` meet first, by casting them: the truth for `missed_light`.

    Returns:
        a function from n rays to the disparities [n] in 1/m where they first meet a surface, 0 where none.

    Raises:
        ValueError: Embree is not installed.
    """
    caster = RayCaster(scene.vertices, scene.faces)

    def first_disparity(rays: LensRay) -> Float[np.ndarray, " n"]:
        lines = (np.asarray(part, dtype=np.float64) for part in (rays.a, rays.b))
        return 1.0 / caster.first_hits(*_world_rays(camera, *lines)).distance

    return first_disparity


def _radiance(
    scene: Scene,
    shader: Shader,
    caster: RayCaster,
    camera: Camera,
    lens: AbstractLens,
    film: np.ndarray,
    pupil: np.ndarray,
) -> np.ndarray:
    """Weighted radiance [n, 3] along one ray per film point [n, 2] and pupil sample [n, 2]."""
    real = jnp.zeros(()).dtype
    a, b, weight = (
        np.asarray(part, dtype=np.float64)
        for part in _image_lines(lens, camera, jnp.asarray(film, dtype=real), jnp.asarray(pupil, dtype=real))
    )
    origins, directions = _world_rays(camera, a, b)
    hits = caster.first_hits(origins, directions)
    seen = hits.triangle >= 0
    # Directions advance one metre along the view axis, so the distance is the depth.
    width = np.where(seen, hits.distance, 1.0) / float(camera.focal_px) * _TEXTURE_SHARE
    colour = _colours(
        shader,
        scene.background,
        jnp.asarray(np.maximum(hits.triangle, 0), dtype=jnp.int32),
        jnp.asarray(hits.barycentric, dtype=real),
        jnp.asarray(width, dtype=real),
        jnp.asarray(origins, dtype=real),
        jnp.asarray(directions, dtype=real),
        jnp.asarray(seen),
    )
    return weight[:, None] * np.asarray(colour, dtype=np.float64)


@eqx.filter_jit
def _image_lines(
    lens: AbstractLens, camera: Camera, film: Float[Array, "n 2"], pupil: Float[Array, "n 2"]
) -> tuple[Float[Array, "n 2"], Float[Array, "n 2"], Float[Array, " n"]]:
    def one(point: Float[Array, "2"], sample: Float[Array, "2"]):
        ray = lens.ray(camera, point, lens.pupil_point(sample))
        return ray.a, ray.b, ray.weight

    return jax.vmap(one)(film, pupil)


@eqx.filter_jit
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


def _world_rays(camera: Camera, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins in the lens plane and directions, one metre deep, of image lines q(w) = a + b w.

    X(z) = X0 + m z with b = f (X0, -Y0) and a = c + f (m_x, -m_y); the camera looks along -z.
    """
    focal = float(camera.focal_px)
    centre = np.asarray(camera.principal_point, dtype=np.float64)
    pose = np.asarray(camera.world_from_camera, dtype=np.float64)
    down = np.array([1.0, -1.0])
    crossing, slope = b / focal * down, (a - centre) / focal * down
    origins = np.concatenate([crossing, np.zeros((len(a), 1))], axis=1)
    directions = np.concatenate([slope, np.full((len(a), 1), -1.0)], axis=1)
    return origins @ pose[:3, :3].T + pose[:3, 3], directions @ pose[:3, :3].T


def _meet(corners: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance [n] and barycentric weights [n, 3] where rays meet the planes of `corners` [n, 3, 3].

    Möller and Trumbore 1997, without the test whether the point is inside: Embree made it.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(directions, second)
    volume = np.einsum("ni,ni->n", first, across)
    # A ray within the triangle's plane meets it nowhere in particular; any finite answer serves.
    volume = np.where(volume == 0.0, 1.0, volume)
    offset = origins - corners[:, 0]
    turned = np.cross(offset, first)
    u = np.clip(np.einsum("ni,ni->n", offset, across) / volume, 0.0, 1.0)
    v = np.clip(np.einsum("ni,ni->n", directions, turned) / volume, 0.0, 1.0 - u)
    return np.einsum("ni,ni->n", second, turned) / volume, np.stack([1.0 - u - v, u, v], axis=1)
