"""The sharp picture, everything in focus, which needs no rays at all."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._device import device_array
from focusjax._programs import jit
from focusjax.layers import Layers, RowsOfLayers, by_rows, covered, interval
from focusjax.trace._gloss import radiance_from_centre

_PLACES = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
"""Offsets (dx, dy) in samples at which each sample is looked at, all in different rows and columns."""


def render_pinhole(layers: Layers) -> Float[Array, "h w 3"]:
    """The picture that a pinhole would take of the same scene: linear radiance.

    The nearest surface at four places of each layer sample, averaged over the pixel; where a surface is
    there in part only, those behind it show through the rest. It is also what the picture of any lens tends
    to when its aperture closes.

    Example:
        >>> white = fj.make_object("white", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)], colour=1.0)
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> picture = fj.render_pinhole(fj.peel(fj.make_scene([white], unlit=True), camera, lens))
        >>> picture.shape, round(float(picture[3, 4, 0]), 2)
        ((6, 8, 3), 1.0)
    """
    grid = layers.grid
    edges = (
        slice(grid.margin, grid.margin + size * grid.supersampling) for size in (grid.height, grid.width)
    )
    seen = np.asarray(_seen(layers))[*edges]
    blocks = seen.reshape(grid.height, grid.supersampling, grid.width, grid.supersampling, 3)
    return device_array(blocks.mean(axis=(1, 3)))


@jit
def _seen(layers: Layers) -> Float[Array, "h w 3"]:
    """Mean radiance of each sample of the grid."""
    radiance = radiance_from_centre(layers)
    return by_rows(layers, lambda rows: _seen_in(rows, radiance))


def _seen_in(rows: RowsOfLayers, radiance: Float[Array, "n 3"]) -> Float[Array, "r w 3"]:
    """The same of some rows."""
    cells, radiances, background = rows.cells, rows.spread(radiance, 0.0), rows.background
    shape, opacity = cells.shape[1:], rows.layers.samples.opacity
    shares = None if opacity is None else rows.spread(opacity, 0.0)

    def at_place(place: Float[Array, "2"]) -> Float[Array, "r w 3"]:
        dx, dy = (jnp.broadcast_to(place[k], shape) for k in (0, 1))
        far = jnp.broadcast_to(background, (*shape, 3))
        if shares is not None:
            return _blended(cells, radiances, shares, far, dx, dy)
        nearest = jnp.zeros(shape, dtype=jnp.int32)
        colour = far
        for words, of_layer in zip(cells, radiances, strict=True):
            # Of two within one step of disparity, the one in the earlier layer is nearer.
            most = interval(words)[1]
            shows = covered(words, dx, dy) & (most > nearest)
            nearest = jnp.where(shows, most, nearest)
            colour = jnp.where(shows[..., None], of_layer, colour)
        return colour

    return jax.lax.map(at_place, jnp.asarray(_PLACES, dtype=background.dtype)).mean(axis=0)


def _blended(
    cells: UInt[Array, "l h w"],
    radiances: Float[Array, "l h w 3"],
    opacity: Float[Array, "l h w"],
    far: Float[Array, "h w 3"],
    dx: Float[Array, "h w"],
    dy: Float[Array, "h w"],
) -> Float[Array, "h w 3"]:
    """Every surface at one place of each sample over those behind it and what is `far`, front to back."""
    shape = cells.shape[1:]
    # Layers are in order but for their fringe samples.
    shows = jax.vmap(lambda words: covered(words, dx, dy))(cells)
    nearest = jnp.where(shows, interval(cells)[1], 0)
    order = jnp.argsort(nearest, axis=0, descending=True, stable=True)

    def over(seen: tuple[Array, Array], layer: Int[Array, "h w"]) -> tuple[tuple[Array, Array], None]:
        colour, through = seen

        def of_layer(a: Array) -> Array:
            index = layer[None] if a.ndim == 3 else layer[None, ..., None]
            return jnp.take_along_axis(a, index, axis=0)[0]

        share = through * jnp.where(of_layer(nearest) > 0, of_layer(opacity), 0.0)
        return (colour + share[..., None] * of_layer(radiances), through - share), None

    nothing = jnp.zeros((*shape, 3), dtype=far.dtype)
    (colour, through), _ = jax.lax.scan(over, (nothing, jnp.ones(shape, dtype=nothing.dtype)), order)
    return colour + through[..., None] * far
