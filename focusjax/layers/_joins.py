"""Which neighbouring samples show one surface, and the disparities each sample stands for.

A sample P with disparity w and plane slopes g (dioptres per sample) predicts w + g . d at its
neighbour Q, d samples away. P and Q are joined when

- the step |w_Q - w_P| moves a ray by at most one sample at the lens rim, so that nothing could be seen
  between the two anyway, or
- the planes of both predict the step to within half of it: a continuous surface, seen steeply.

The neighbour's sample in P's own layer is taken at once where both planes predict it. Otherwise those up
to two layers nearer and farther are asked as well, and the one with the least unpredicted step is taken,
since a surface changes layer where another one begins to hide it. A sample then stands for the disparities
from its own to half-way to its joined neighbours, so that slopes are watertight also where a ray steps
diagonally; at open silhouettes it ends half a sample out.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt

NEIGHBOURS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
"""(dx, dy) of the eight neighbours, in the order of the bits of `links`."""

_LAYER_WINDOW = 2
SAME_LAYER = 7
"""Code of a neighbour in the sample's own layer; one layer farther is one more."""
UNJOINED = 15
"""Code of a neighbour that does not continue the sample's surface."""
EXTENT_STEPS = 65534
EMPTY = 0x0000FFFF
"""Packed extent of a sample that holds nothing: its least disparity exceeds its largest."""


_SHIFTS = (0, *(shift for k in range(1, _LAYER_WINDOW + 1) for shift in (-k, k)))
_CERTAIN = 0.05
"""Samples of parallax that planes may miss the neighbour by without looking for a better one."""


def join(
    disparity: np.ndarray, slope_x: np.ndarray, slope_y: np.ndarray, parallax: float
) -> tuple[Float[Array, "l h w"], Float[Array, "l h w"], UInt[Array, "l h w"]]:
    """Least and largest disparity of each sample, and its packed joins.

    `links` holds four bits per neighbour: the neighbour's layer less the sample's own, plus 7, or 15
    where they are not joined.

    Args:
        disparity: 1/m [l, h, w], 0 where nothing is.
        slope_x: change of disparity [l, h, w] per sample to the right along the surface's plane.
        slope_y: the same downwards.
        parallax: samples per dioptre at the lens rim.
    """
    small_step = jnp.asarray(1.0 / max(parallax, 1e-12), dtype=disparity.dtype)
    planes = (jnp.asarray(disparity), jnp.asarray(slope_x), jnp.asarray(slope_y))
    low, high, certain = _join_within_layers(*planes, small_step)
    low, high, certain = np.array(low), np.array(high), np.asarray(certain)
    codes = np.where(certain, np.uint8(SAME_LAYER), np.uint8(UNJOINED))
    for number, (dx, dy) in enumerate(NEIGHBOURS):
        _join_across_layers(
            codes[:, number], low, high, (disparity, slope_x, slope_y), dx, dy, np.asarray(small_step)
        )
    return jnp.asarray(low), jnp.asarray(high), _packed_codes(jnp.asarray(codes))


def _misfit(step: Any, own: Any, theirs: Any) -> Any:
    """How far both planes, at their worst, are from predicting a step in disparity."""
    xp = np if isinstance(step, np.ndarray) else jnp
    return xp.maximum(xp.abs(step - own), xp.abs(step - theirs))


@jax.jit
def _join_within_layers(
    disparity: Float[Array, "l h w"],
    slope_x: Float[Array, "l h w"],
    slope_y: Float[Array, "l h w"],
    small_step: Float[Array, ""],
) -> tuple[Float[Array, "l h w"], Float[Array, "l h w"], Bool[Array, "l n h w"]]:
    """The joins inside each layer that need no second thought, and the extents they give."""

    def one_layer(planes: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        w, gx, gy = planes
        held = w > 0
        low = high = w
        joins = []
        for dx, dy in NEIGHBOURS:
            there, their_gx, their_gy = (_neighbour(a, dx, dy) for a in planes)
            own, step = gx * dx + gy * dy, there - w
            misfit = _misfit(step, own, their_gx * dx + their_gy * dy)
            certain = held & (there > 0) & (misfit <= _CERTAIN * small_step)
            half_way = jnp.where(certain, w + 0.5 * step, w)
            low, high = jnp.minimum(low, half_way), jnp.maximum(high, half_way)
            joins.append(certain)
        return low, high, jnp.stack(joins)

    return jax.lax.map(one_layer, (disparity, slope_x, slope_y))


def _neighbour(a: Float[Array, "h w"], dx: int, dy: int) -> Float[Array, "h w"]:
    """Value at (y + dy, x + dx); 0 outside."""
    padded = jnp.pad(a, 1)
    return jax.lax.dynamic_slice(padded, (1 + dy, 1 + dx), a.shape)


def _join_across_layers(
    codes: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    planes: tuple[np.ndarray, np.ndarray, np.ndarray],
    dx: int,
    dy: int,
    small_step: np.ndarray,
) -> None:
    """Join the samples still open towards neighbour (`dx`, `dy`), looking in all nearby layers; in place."""
    layers, rows, columns = planes[0].shape
    size = rows * columns
    disparity, slope_x, slope_y = (a.reshape(-1) for a in planes)
    here = np.flatnonzero((codes == UNJOINED) & (planes[0] > 0))
    column, row = here % columns, here // columns % rows
    inside = (row + dy >= 0) & (row + dy < rows) & (column + dx >= 0) & (column + dx < columns)
    here = here[inside]
    layer = here // size
    w = disparity[here]
    own = slope_x[here] * dx + slope_y[here] * dy
    best = np.full(w.shape, np.inf, dtype=w.dtype)
    code, other = np.full(w.shape, UNJOINED, dtype=np.uint8), np.zeros_like(w)
    for shift in _SHIFTS:
        # Most of what is open borders on nothing in nearby layers either.
        candidate = np.flatnonzero((layer + shift >= 0) & (layer + shift < layers))
        there = here[candidate] + (shift * size + dy * columns + dx)
        held = np.flatnonzero(disparity[there] > 0)
        candidate, there = candidate[held], there[held]
        step = disparity[there] - w[candidate]
        misfit = _misfit(step, own[candidate], slope_x[there] * dx + slope_y[there] * dy)
        length = np.abs(step)
        joined = (length <= small_step) | (misfit <= 0.5 * length)
        merit = np.minimum(misfit, length)
        better = np.flatnonzero(joined & (merit < best[candidate]))
        chosen = candidate[better]
        best[chosen], code[chosen] = merit[better], shift + SAME_LAYER
        other[chosen] = disparity[there[better]]
    at = np.unravel_index(here, codes.shape)
    codes[at] = code
    alone = 0.5 * np.clip(own, -small_step, small_step)
    half_way = np.maximum(w + np.where(code == UNJOINED, alone, 0.5 * (other - w)), 0)
    low[at], high[at] = np.minimum(low[at], half_way), np.maximum(high[at], half_way)


@jax.jit
def _packed_codes(codes: UInt[Array, "l n h w"]) -> UInt[Array, "l h w"]:
    shifts = jnp.arange(0, 4 * len(NEIGHBOURS), 4, dtype=jnp.uint32)
    return (codes.astype(jnp.uint32) << shifts[None, :, None, None]).sum(axis=1, dtype=jnp.uint32)


@jax.jit
def pack_extent(
    low: Float[Array, "l h w"], high: Float[Array, "l h w"], valid: Float[Array, "l h w"]
) -> tuple[UInt[Array, "l h w"], Float[Array, ""]]:
    """Interval as 16 + 16 bits (largest above least), rounded outwards, and dioptres per step."""
    scale = jnp.maximum(high.max(), jnp.finfo(high.dtype).tiny * 2**20) / EXTENT_STEPS
    least = jnp.floor(low / scale).astype(jnp.uint32)
    most = jnp.minimum(jnp.ceil(high / scale), EXTENT_STEPS).astype(jnp.uint32)
    return jnp.where(valid > 0, (most << 16) | least, jnp.uint32(EMPTY)), scale
