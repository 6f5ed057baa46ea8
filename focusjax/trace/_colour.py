"""The radiance a ray brings back, interpolated over the surface it met."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt

from focusjax.geometry import LensRay
from focusjax.layers import SAME_LAYER, UNJOINED, Layers, Places
from focusjax.trace._gloss import GlossPlanes, gloss_at, gloss_planes


class Surface(eqx.Module):
    """The layers' appearance as flat planes.

    Attributes:
        places: from the flat index of a sample to its position in the next three.
        radiance: red, green and blue, each [n].
        disparity: 1/m [n].
        links: packed joins to neighbours [n].
        background: red, green and blue at infinity, each [m] over the grid; of length 1 where it is the same
            all over.
        gloss: what to add for each ray; None where gloss is part of `radiance`.
        columns: samples per row (static).
        rows: rows (static).
    """

    places: Places
    radiance: tuple[Float[Array, " n"], ...]
    disparity: Float[Array, " n"]
    links: UInt[Array, " n"]
    background: tuple[Float[Array, " m"], ...]
    gloss: GlossPlanes | None
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)


def surface_of(layers: Layers) -> Surface:
    """The flat planes of `layers`; what is flat there is the same arrays."""
    return Surface(
        places=layers.places,
        radiance=_colours(layers.samples.radiance),
        disparity=layers.samples.disparity,
        links=layers.samples.links,
        background=_colours(layers.background),
        gloss=gloss_planes(layers),
        columns=layers.grid.columns,
        rows=layers.grid.rows,
    )


@jax.jit
def _colours(radiance: Float[Array, "*n 3"]) -> tuple[Float[Array, " m"], ...]:
    """Red, green and blue."""
    return tuple(radiance[..., k].reshape(-1) for k in range(3))


def disparity_of(surface: Surface, hit: Int[Array, ""]) -> Float[Array, ""]:
    """Disparity of sample `hit`, 0 if that is -1."""
    number = surface.places.number(jnp.maximum(hit, 0))
    return jnp.where(hit >= 0, surface.disparity[number], 0.0)


Corners = tuple[tuple[Int[Array, ""], Float[Array, ""]], ...]
"""Samples around a hit by their number, and the share of each; the first is the one that was hit."""


def corners_at(
    surface: Surface, ray: LensRay, hit: Int[Array, ""]
) -> tuple[Corners, Float[Array, ""], Int[Array, ""]]:
    """What the radiance that `ray` (in grid units) brings from sample `hit` is made of.

    Bilinear between the sample and the neighbours that continue its surface, whichever layer they are
    in; a neighbour that does not continue it is replaced by the sample itself.

    Returns:
        the samples and their shares; the disparity of the hit, 0 if `hit` is -1; and the place on the grid
        where the ray passes there.
    """
    (a_x, a_y), (b_x, b_y) = ray.a, ray.b
    columns, layer_size = surface.columns, surface.columns * surface.rows
    index = jnp.maximum(hit, 0)
    number, disparity = surface.places.number(index), disparity_of(surface, hit)
    x, y = a_x + b_x * disparity, a_y + b_y * disparity
    column = jnp.clip(jnp.floor(x).astype(jnp.int32), 0, columns - 1)
    row = jnp.clip(jnp.floor(y).astype(jnp.int32), 0, surface.rows - 1)
    in_layer = index % layer_size
    offset_x = jnp.clip(x - (in_layer % columns).astype(x.dtype) - 0.5, -0.5, 0.5)
    offset_y = jnp.clip(y - (in_layer // columns).astype(x.dtype) - 0.5, -0.5, 0.5)
    weight_x, weight_y = jnp.abs(offset_x), jnp.abs(offset_y)
    left, up = (offset_x < 0).astype(jnp.int32), (offset_y < 0).astype(jnp.int32)
    dx, dy = 1 - 2 * left, 1 - 2 * up
    links = surface.links[number]

    def neighbour(side: Int[Array, ""], step: Int[Array, ""]) -> Int[Array, ""]:
        code = ((links >> (4 * side).astype(jnp.uint32)) & 15).astype(jnp.int32)
        shift = jnp.where(code == UNJOINED, 0, (code - SAME_LAYER) * layer_size + step)
        return surface.places.number(index + shift)

    corners = (
        (number, (1 - weight_x) * (1 - weight_y)),
        (neighbour(left, dx), weight_x * (1 - weight_y)),
        (neighbour(2 + up, dy * columns), (1 - weight_x) * weight_y),
        (neighbour(4 + left + 2 * up, dy * columns + dx), weight_x * weight_y),
    )
    return corners, disparity, row * columns + column


def radiance_at(surface: Surface, ray: LensRay, hit: Int[Array, ""]) -> Float[Array, "3"]:
    """Radiance that `ray` (in grid units) brings from sample `hit`, or from infinity if that is -1."""
    met = hit >= 0
    corners, disparity, place = corners_at(surface, ray, hit)
    if __import__('os').environ.get('NEAREST'):
        corners = ((corners[0][0], jnp.ones_like(disparity)),)
    behind = place if surface.background[0].size > 1 else jnp.zeros_like(place)
    # Worked out once, not again in each of the look-ups that use them.
    corners, behind = jax.lax.optimization_barrier((corners, behind))
    channels = []
    for plane, far_plane in zip(surface.radiance, surface.background, strict=True):
        near = sum((plane[i] * weight for i, weight in corners), jnp.zeros_like(disparity))
        channels.append(jnp.where(met, near, far_plane[behind]))
    radiance = jnp.stack(channels)
    if surface.gloss is None:
        return radiance
    gloss = gloss_at(surface.gloss, ray, jnp.where(met, disparity, 1.0), corners)
    return radiance + jnp.where(met, gloss, 0.0)
