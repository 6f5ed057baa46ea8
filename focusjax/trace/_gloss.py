"""Gloss as each lens ray sees it, from its own point of the lens (Lee09 section 5)."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt

from focusjax._programs import jit
from focusjax.geometry import Camera, LensRay
from focusjax.layers import Grid, Layers, unpack_normal
from focusjax.scene import Gloss

_AT_ONCE = 1 << 18


class GlossPlanes(eqx.Module):
    """The layers' glossy surfaces as flat planes.

    Attributes:
        normal: packed normals [n] of the samples that the layers hold.
        material: material number [n].
        model: what materials, lights and surroundings make of them.
        camera: the camera that the layers were peeled from.
        grid: the layers' grid (static).
    """

    normal: UInt[Array, " n"]
    material: UInt[Array, " n"]
    model: Gloss
    camera: Camera
    grid: Grid = eqx.field(static=True)


def gloss_planes(layers: Layers) -> GlossPlanes | None:
    """The flat planes of `layers`, or None where gloss is part of their radiance."""
    samples = layers.samples.gloss
    if samples is None:
        return None
    return GlossPlanes(samples.normal, samples.material, samples.model, layers.camera, layers.grid)


def gloss_at(
    planes: GlossPlanes,
    ray: LensRay,
    disparity: Float[Array, ""],
    number: Int[Array, ""],
) -> Float[Array, "3"]:
    """Radiance that gloss adds where `ray` (in grid units) meets a surface at `disparity` (1/m, above 0).

    A ray is straight, so the direction back to its point of the lens is that of its image at infinity,
    reversed: the line q(w) = a + b w gives both ends of it.

    `number` is the position of the sample that was hit in the arrays of `planes`.
    """
    camera, grid = planes.camera, planes.grid

    # Component by component, which XLA fuses into one pass (a matrix product per ray it does not).
    pose, per_sample = camera.world_from_camera, 1.0 / (camera.focal_px * grid.supersampling)
    centre_x, centre_y = camera.principal_point * grid.supersampling + grid.margin

    def towards(x: Float[Array, ""], y: Float[Array, ""]) -> list[Float[Array, ""]]:
        """World direction of a place on the grid, 1 m along the view axis."""
        across, down = (x - centre_x) * per_sample, (y - centre_y) * per_sample
        return [pose[k, 0] * across - pose[k, 1] * down - pose[k, 2] for k in range(3)]

    (a_x, a_y), (b_x, b_y) = ray.a, ray.b
    to_eye = _unit([-part for part in towards(a_x, a_y)])
    ahead = towards(a_x + b_x * disparity, a_y + b_y * disparity)
    point = camera.position + jnp.stack(ahead) / disparity
    normal = _unit(unpack_normal(planes.normal[number]))
    return planes.model(point, normal, to_eye, planes.material[number].astype(jnp.int32))


def _unit(parts: Sequence[Float[Array, ""]]) -> Float[Array, "3"]:
    """A vector at length 1."""
    square = sum((part**2 for part in parts), jnp.zeros_like(parts[0]))
    scale = jax.lax.rsqrt(jnp.maximum(square, 1e-12))
    return jnp.stack([part * scale for part in parts])


@jit
def radiance_from_centre(layers: Layers) -> Float[Array, "n 3"]:
    """Radiance of every sample that the layers hold, gloss included, as the lens centre sees it."""
    planes = gloss_planes(layers)
    if planes is None:
        return layers.samples.radiance
    columns, rows = layers.grid.columns, layers.grid.rows
    disparity = layers.samples.disparity

    def one(sample: tuple[Array, Array, Array]) -> Float[Array, "3"]:
        number, index, disparity = sample
        place = jnp.stack([index % columns, index // columns % rows]).astype(disparity.dtype) + 0.5
        ray = LensRay(a=place, b=jnp.zeros_like(place), weight=jnp.ones_like(disparity))
        return gloss_at(planes, ray, jnp.where(disparity > 0, disparity, 1.0), number)

    numbers = jnp.arange(len(disparity), dtype=jnp.int32)
    # Some at a time, to hold little at once.
    samples = numbers, layers.samples.index, disparity
    gloss = jax.lax.map(one, samples, batch_size=_AT_ONCE)
    return layers.samples.radiance + gloss
