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

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt

from focusjax._parallel import in_parallel
from focusjax._programs import jit
from focusjax.layers._places import scattered

NEIGHBOURS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
"""(dx, dy) of the eight neighbours, in the order of the bits of `links`."""

_LAYER_WINDOW = 2
_SPARSE = 0.05
SAME_LAYER = 8
"""Code of a neighbour in the sample's own layer; one layer farther is one more."""
UNJOINED = 0
"""Code of a neighbour that does not continue the sample's surface."""
_CLOSED = np.uint32(sum(SAME_LAYER << 4 * side for side in range(len(NEIGHBOURS))))
"""Links of a sample that all of its neighbours in its own layer continue."""


_SHIFTS = (0, *(shift for k in range(1, _LAYER_WINDOW + 1) for shift in (-k, k)))
_CERTAIN = 0.05
"""Samples of parallax that planes may miss the neighbour by without looking for a better one."""


@dataclasses.dataclass(frozen=True)
class Planes:
    """Samples of surface as pieces of plane.

    Attributes:
        shape: layers, rows and columns of the grid.
        held: flat index [n] of each sample, increasing.
        disparity: 1/m [n], above 0.
        slope_x: change of disparity [n] per sample to the right.
        slope_y: the same downwards.
    """

    shape: tuple[int, int, int]
    held: np.ndarray
    disparity: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray


@dataclasses.dataclass(frozen=True)
class Joins:
    """What samples stand for.

    Attributes:
        low: least disparity [n] that each spans.
        high: largest disparity [n].
        links: four bits per neighbour [n]: the neighbour's layer less the sample's own, plus 8, or 0 where
            they are not joined.
    """

    low: np.ndarray
    high: np.ndarray
    links: np.ndarray


def join(planes: Planes, parallax: float) -> Joins:
    """Which neighbours continue each sample; `parallax` in samples per dioptre at the lens rim."""
    held, columns = planes.held, (planes.disparity, planes.slope_x, planes.slope_y)
    small_step = np.asarray(1.0 / max(parallax, 1e-12), dtype=planes.disparity.dtype)
    low, links = planes.disparity.copy(), np.zeros(len(held), dtype=np.uint32)
    high = low.copy()
    # Deep layers hold little; looking at all of their samples costs more than at the few that are there.
    layers, *frame = planes.shape
    size = math.prod(frame)
    ends = np.searchsorted(held, size * np.arange(layers + 1))

    def inside(layer: int) -> None:
        # One layer at a call, so that their number does not ask for another program.
        part = slice(ends[layer], ends[layer + 1])
        there = held[part] - size * layer
        inputs: Any = (*(scattered((*frame,), there, a[part]) for a in columns), small_step)
        found = _join_within_layer(*inputs)
        for whole, values in zip((low, high, links), found, strict=True):
            np.take(np.asarray(values), there, out=whole[part], mode="clip")

    in_parallel(inside, np.flatnonzero(np.diff(ends) > _SPARSE * size).tolist())
    nearby = _Nearby.of(planes, ends)
    some = np.flatnonzero(links != _CLOSED)

    def towards(side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        open_ = some[links[some] & np.uint32(15 << 4 * side) == 0]
        return open_, *_join_across_layers(open_, planes, nearby, NEIGHBOURS[side], small_step)

    for side, (open_, code, half_way) in enumerate(in_parallel(towards, range(len(NEIGHBOURS)))):
        links[open_] |= code.astype(np.uint32) << np.uint32(4 * side)
        low[open_], high[open_] = np.minimum(low[open_], half_way), np.maximum(high[open_], half_way)
    return Joins(low, high, links)


@dataclasses.dataclass(frozen=True)
class _Nearby:
    """Where the neighbours of samples are, on a grid with nothing around it: none is beyond its ends.

    Attributes:
        place: of each sample [n] on that grid.
        number: one more than the sample's position in `place` at each place of the grid, 0 if none is there.
        row: places from one row to the next.
        layer: places from one layer to the next.
    """

    place: np.ndarray
    number: np.ndarray
    row: int
    layer: int

    @classmethod
    def of(cls, planes: Planes, ends: np.ndarray) -> "_Nearby":
        """`ends` are the first sample of each layer and, after them, the number of all."""
        layers, rows, columns = planes.shape
        size = (rows + 2) * (columns + 2)
        # Two columns more in each row above, two rows more in each layer before, and all that is before the
        # first: empty layers, a row and a column.
        place = planes.held.astype(np.int64) // columns
        place *= 2
        place += planes.held
        before = (_LAYER_WINDOW * size + columns + 3) + np.arange(layers) * (size - (columns + 2) * rows)
        place += np.repeat(before, np.diff(ends))
        count = np.arange(1, len(place) + 1, dtype=np.int32)
        return cls(place, scattered(((layers + 2 * _LAYER_WINDOW) * size,), place, count), columns + 2, size)


def _misfit(step: Any, own: Any, theirs: Any) -> Any:
    """How far both planes, at their worst, are from predicting a step in disparity."""
    xp = np if isinstance(step, np.ndarray) else jnp
    return xp.maximum(xp.abs(step - own), xp.abs(step - theirs))


@jit
def _join_within_layer(
    w: Float[Array, "h w"], gx: Float[Array, "h w"], gy: Float[Array, "h w"], small_step: Float[Array, ""]
) -> tuple[Float[Array, "h w"], Float[Array, "h w"], UInt[Array, "h w"]]:
    """The extents that joins inside a layer give where they need no second thought, and the links.

    Of samples of disparity `w` and slopes `gx` and `gy`.
    """
    held = w > 0
    low = high = w
    links = jnp.zeros(w.shape, dtype=jnp.uint32)
    for number, (dx, dy) in enumerate(NEIGHBOURS):
        there, their_gx, their_gy = (_neighbour(a, dx, dy) for a in (w, gx, gy))
        own, step = gx * dx + gy * dy, there - w
        misfit = _misfit(step, own, their_gx * dx + their_gy * dy)
        certain = held & (there > 0) & (misfit <= _CERTAIN * small_step)
        half_way = jnp.where(certain, w + 0.5 * step, w)
        low, high = jnp.minimum(low, half_way), jnp.maximum(high, half_way)
        links |= jnp.where(certain, jnp.uint32(SAME_LAYER << 4 * number), jnp.uint32(0))
    return low, high, links


def _neighbour(a: Float[Array, "h w"], dx: int, dy: int) -> Float[Array, "h w"]:
    """Value at (y + dy, x + dx); 0 outside."""
    padded = jnp.pad(a, 1)
    return jax.lax.dynamic_slice(padded, (1 + dy, 1 + dx), a.shape)


def _join_across_layers(
    samples: np.ndarray,
    planes: Planes,
    nearby: _Nearby,
    neighbour: tuple[int, int],
    small_step: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Codes of the joins of some `samples` to one neighbour, among all nearby layers.

    Also the disparities half-way to it, or half a sample out along the plane where nothing is joined.
    """
    dx, dy = neighbour
    place = np.take(nearby.place, samples) + (dy * nearby.row + dx)
    w = np.take(planes.disparity, samples)
    own = np.take(planes.slope_x, samples) * dx + np.take(planes.slope_y, samples) * dy
    best = np.full(w.shape, np.inf, dtype=w.dtype)
    code, other = np.full(w.shape, UNJOINED, dtype=np.uint8), np.zeros_like(w)
    for shift in _SHIFTS:
        # Most of what is open borders on nothing in nearby layers either.
        there = np.take(nearby.number, place + shift * nearby.layer)
        candidate = np.flatnonzero(there)
        there = np.take(there, candidate) - 1
        theirs = np.take(planes.disparity, there)
        step = theirs - w[candidate]
        slope = np.take(planes.slope_x, there) * dx + np.take(planes.slope_y, there) * dy
        misfit, length = _misfit(step, own[candidate], slope), np.abs(step)
        merit = np.minimum(misfit, length)
        better = (length <= small_step) | (misfit <= 0.5 * length)
        better &= merit < best[candidate]
        chosen = candidate[better]
        best[chosen], code[chosen] = merit[better], shift + SAME_LAYER
        other[chosen] = theirs[better]
    alone = 0.5 * np.clip(own, -small_step, small_step)
    half_way = np.maximum(w + np.where(code == UNJOINED, alone, 0.5 * (other - w)), 0)
    return code, half_way
