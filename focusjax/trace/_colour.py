"""The radiance a ray brings back, interpolated over the surface it met."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, UInt

from focusjax.geometry import LensRay
from focusjax.layers import SAME_LAYER, UNJOINED, Layers, Places, radiance_slopes
from focusjax.trace._gloss import GlossPlanes, gloss_at, gloss_planes


class Surface(eqx.Module):
    """The layers' appearance as flat planes.

    Attributes:
        places: from the flat index of a sample to its position in the next five.
        radiance: red, green and blue, each [n]: means over the squares of samples.
        across: change of each of them per sample to the right [n].
        down: the same downwards.
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
    across: tuple[Float[Array, " n"], ...]
    down: tuple[Float[Array, " n"], ...]
    disparity: Float[Array, " n"]
    links: UInt[Array, " n"]
    background: tuple[Float[Array, " m"], ...]
    gloss: GlossPlanes | None
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)


def surface_of(layers: Layers) -> Surface:
    """The flat planes of `layers`; what is flat there is the same arrays."""
    across, down = radiance_slopes(layers)
    return Surface(
        places=layers.places,
        radiance=_colours(layers.samples.radiance),
        across=_colours(across),
        down=_colours(down),
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


class _Place(eqx.Module):
    """Where a ray passes through the surface that it meets.

    Attributes:
        disparity: 1/m, 0 if it meets none.
        number: of the sample that it meets.
        dx: from the sample's centre to the right, in samples, -0.5 to 0.5.
        dy: the same downwards.
        on_grid: flat index of the place on the grid.
    """

    disparity: Float[Array, ""]
    number: Int[Array, ""]
    dx: Float[Array, ""]
    dy: Float[Array, ""]
    on_grid: Int[Array, ""]


def _place_of(surface: Surface, ray: LensRay, hit: Int[Array, ""]) -> _Place:
    """Where `ray` (in grid units) passes at sample `hit`, or at infinity if that is -1."""
    (a_x, a_y), (b_x, b_y) = ray.a, ray.b
    columns, layer_size = surface.columns, surface.columns * surface.rows
    index = jnp.maximum(hit, 0)
    disparity = disparity_of(surface, hit)
    x, y = a_x + b_x * disparity, a_y + b_y * disparity
    column = jnp.clip(jnp.floor(x).astype(jnp.int32), 0, columns - 1)
    row = jnp.clip(jnp.floor(y).astype(jnp.int32), 0, surface.rows - 1)
    in_layer = index % layer_size
    dx = jnp.clip(x - (in_layer % columns).astype(x.dtype) - 0.5, -0.5, 0.5)
    dy = jnp.clip(y - (in_layer // columns).astype(x.dtype) - 0.5, -0.5, 0.5)
    return _Place(disparity, surface.places.number(index), dx, dy, row * columns + column)


Corners = tuple[tuple[Int[Array, ""], Float[Array, ""]], ...]
"""Samples around a hit by their number, and the share of each; the first is the one that was hit."""


def corners_at(
    surface: Surface, ray: LensRay, hit: Int[Array, ""]
) -> tuple[Corners, Float[Array, ""], Int[Array, ""]]:
    """The samples around the place where `ray` (in grid units) passes sample `hit`.

    Bilinear between the sample and the neighbours that continue its surface, whichever layer they are
    in; a neighbour that does not continue it is replaced by the sample itself.

    Returns:
        the samples and their shares; the disparity of the hit, 0 if `hit` is -1; and the place on the grid
        where the ray passes there.
    """
    place = _place_of(surface, ray, hit)
    columns, layer_size, index = surface.columns, surface.columns * surface.rows, jnp.maximum(hit, 0)
    weight_x, weight_y = jnp.abs(place.dx), jnp.abs(place.dy)
    left, up = (place.dx < 0).astype(jnp.int32), (place.dy < 0).astype(jnp.int32)
    dx, dy = 1 - 2 * left, 1 - 2 * up
    links = surface.links[place.number]

    def neighbour(side: Int[Array, ""], step: Int[Array, ""]) -> Int[Array, ""]:
        code = ((links >> (4 * side).astype(jnp.uint32)) & 15).astype(jnp.int32)
        shift = jnp.where(code == UNJOINED, 0, (code - SAME_LAYER) * layer_size + step)
        return surface.places.number(index + shift)

    corners = (
        (place.number, (1 - weight_x) * (1 - weight_y)),
        (neighbour(left, dx), weight_x * (1 - weight_y)),
        (neighbour(2 + up, dy * columns), (1 - weight_x) * weight_y),
        (neighbour(4 + left + 2 * up, dy * columns + dx), weight_x * weight_y),
    )
    return corners, place.disparity, place.on_grid


def radiance_at(surface: Surface, ray: LensRay, hit: Int[Array, ""]) -> Float[Array, "3"]:
    """Radiance that `ray` (in grid units) brings from sample `hit`, or from infinity if that is -1.

    Linear across the sample, with the slopes of `radiance_slopes`.
    """
    met = hit >= 0
    place = _place_of(surface, ray, hit)
    behind = place.on_grid if surface.background[0].size > 1 else jnp.zeros_like(place.on_grid)
    # Worked out once, not again in each of the look-ups that use them.
    place, behind = jax.lax.optimization_barrier((place, behind))
    channels = []
    planes = zip(surface.radiance, surface.across, surface.down, surface.background, strict=True)
    for mean, across, down, far_plane in planes:
        near = mean[place.number] + place.dx * across[place.number] + place.dy * down[place.number]
        channels.append(jnp.where(met, near, far_plane[behind]))
    radiance = jnp.stack(channels)
    if surface.gloss is None:
        return radiance
    corners, disparity, _ = corners_at(surface, ray, hit)
    gloss = gloss_at(surface.gloss, ray, jnp.where(met, disparity, 1.0), corners)
    return radiance + jnp.where(met, gloss, 0.0)
