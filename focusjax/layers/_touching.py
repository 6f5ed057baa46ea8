"""Which triangles cover what of which squares of the grid, where few of its squares matter.

Triangles are found by boxes, what lies in boxes by lines of squares; how much of a square a triangle covers
is then looked at in 32 points.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax import _parallel
from focusjax._device import device_array
from focusjax._parallel import in_parallel
from focusjax._programs import jit
from focusjax.layers._blocks import in_blocks, pad_rows
from focusjax.layers._boxes import Boxes, boxes_on, joined
from focusjax.layers._clip import Edges, ScreenTriangles, edge_functions
from focusjax.layers._grid import Grid

T = TypeVar("T")

POINTS = 32
_SAMPLES_AT_ONCE = 1 << 20
"""In the boxes that one call looks at, of which one may be larger."""
_BOXES_AT_ONCE, _PAIRS_AT_ONCE = 1 << 15, 1 << 15
"""In one call of the compiled program."""
_LEAST_AT_ONCE, _MOST_AT_ONCE = 1 << 14, 1 << 17
"""Squares in a band, as far as whole rows have so many."""
_THREADS = 8
"""At most: more wait longer for Python's lock than they help."""
_SLACK = 1e-5
"""Samples by which a triangle is fattened, so that rounding loses nothing."""
_GRID_AT_ONCE = 1 << 22
"""Samples of the grid, in whole rows, of which tables are held at a time."""
_WIDEST = 8
"""Edge in samples of the largest boxes that are left out beforehand where they lie behind all squares."""


def _points() -> Float[np.ndarray, "points 2"]:
    """Hammersley points around the centre of the unit square: every row and column of 32 has one."""
    number = np.arange(POINTS)
    mirrored = sum(((number >> bit) & 1) << (4 - bit) for bit in range(5))
    return (np.stack([number, mirrored], axis=1) + 0.5) / POINTS - 0.5


OFFSETS = _points()


@dataclasses.dataclass(frozen=True)
class Band:
    """Squares in some rows of the grid.

    Attributes:
        squares: which of all squares.
        rows: of the grid.
        boxes: of all triangles that may touch one of them, and of others.
    """

    squares: slice
    rows: range
    boxes: Boxes


@dataclasses.dataclass(frozen=True)
class Touching:
    """Pairs of a square and a triangle that covers some of it.

    Attributes:
        square: index [n] of the square.
        triangle: index [n] of the triangle.
        points: which of the points [n] around the square's centre it covers, a bit each.
        centre: whether [n] it covers the centre.
        plane: its disparity [n] at the centre, and the change of that in x and in y.
    """

    square: np.ndarray
    triangle: np.ndarray
    points: np.ndarray
    centre: np.ndarray
    plane: tuple[np.ndarray, ...]


def in_bands(
    function: Callable[[Band], T], triangles: ScreenTriangles, grid: Grid, cell: Int[np.ndarray, " s"]
) -> list[T]:
    """What `function` makes of squares at the grid samples `cell`, some rows at a time, on several cores.

    `cell` is in increasing order; several squares may be in one place.
    """
    rows = max(1, _GRID_AT_ONCE // grid.columns)
    first = int(cell[0]) // grid.columns if len(cell) else grid.rows
    made: list[T] = []
    while first < grid.rows:
        end = min(first + rows, grid.rows)
        start, stop = (int(k) for k in np.searchsorted(cell, (first * grid.columns, end * grid.columns)))
        if start < stop:
            wanted = np.zeros((end - first, grid.columns), dtype=bool)
            wanted.reshape(-1)[cell[start:stop] - first * grid.columns] = True
            boxes = joined(boxes_on(grid, triangles, wanted=wanted, first_row=first))
            made += in_parallel(
                function, _bands(boxes, range(first, end), grid, cell, start, stop), threads=_THREADS
            )
        # Nothing is looked at of rows without squares.
        first = int(cell[stop]) // grid.columns if stop < len(cell) else grid.rows
    return made


def _bands(
    boxes: Boxes, rows: range, grid: Grid, cell: Int[np.ndarray, " s"], start: int, stop: int
) -> list[Band]:
    """The squares from `start` to `stop`, which are those in `rows`, in bands of about as many."""
    squares, threads = stop - start, min(_parallel.CORES, _THREADS)
    count = max(squares // _LEAST_AT_ONCE, 1)
    if count > threads:
        # As many for each thread, so that none waits for long.
        count = threads * -(-squares // (threads * _MOST_AT_ONCE))
    at_once = -(-squares // count)
    ends = np.unique(cell[start + at_once : stop : at_once] // grid.columns)
    ends = [rows.start, *(int(row) for row in ends if row > rows.start), rows.stop]
    places = np.searchsorted(cell, np.multiply(ends, grid.columns))
    return [
        Band(slice(int(first), int(last)), range(top, under), boxes)
        for (first, last), (top, under) in zip(
            itertools.pairwise(places), itertools.pairwise(ends), strict=True
        )
        if first < last
    ]


def touching(
    band: Band,
    triangles: ScreenTriangles,
    grid: Grid,
    cell: Int[np.ndarray, " s"],
    low: Float[np.ndarray, " s"],
    high: Float[np.ndarray, " s"],
) -> Touching:
    """What triangles cover of squares at whose centres their disparity is between `low` and `high`.

    `cell` is the grid sample of each square of the band, in increasing order; several may be in one place.
    """
    low, high = low.astype(np.float32), high.astype(np.float32)
    cell = (cell - band.rows.start * grid.columns).astype(np.int32)
    shape = len(band.rows), grid.columns
    before = np.zeros(shape[0] * shape[1] + 1, dtype=np.int32)
    np.cumsum(np.bincount(cell, minlength=len(before) - 1), out=before[1:])

    def some(boxes: Boxes) -> tuple[np.ndarray, ...]:
        corners = triangles.around(boxes.triangle, boxes.column, boxes.row)
        edges = edge_functions(*corners, np)
        line = np.repeat(np.arange(len(boxes.triangle), dtype=np.int32), boxes.height)
        down = np.arange(len(line), dtype=np.int32)
        down -= np.take(np.cumsum(boxes.height, dtype=np.int32) - boxes.height, line)
        first, end = _covered_lines(boxes, edges, line, down)
        start = np.take(_first_of(boxes, band.rows, grid), line)
        start += down * np.int32(grid.columns)
        # The squares in a line come one after the other.
        begin, times = np.take(before, start + first), np.take(before, start + end)
        times -= begin
        begin -= np.cumsum(times, dtype=np.int32) - times
        square = np.repeat(begin, times)
        square += np.arange(len(square), dtype=np.int32)
        # Most are of other surfaces.
        nearest, farthest = np.take(high, square), np.take(low, square)
        least, most = (np.take(end.astype(np.float32), line) for end in _extremes(corners[2]))
        meant = np.repeat(least, times) <= nearest
        meant &= np.repeat(most, times) >= farthest
        meant = np.flatnonzero(meant)
        square, nearest, farthest = (np.take(a, meant) for a in (square, nearest, farthest))
        pair = np.take(np.repeat(np.arange(len(line), dtype=np.int32), times), meant)
        box, below = np.take(line, pair), np.take(down, pair)
        right = np.take(cell, square) - np.take(start, pair)
        table = _table(edges, corners[2])

        def program(*pairs: Array) -> tuple[Array, ...]:
            return _covered(table, *pairs)

        covered = in_blocks(program, (box, right, below, farthest, nearest), _PAIRS_AT_ONCE)
        kept = np.flatnonzero((covered[0] > 0) | covered[1])
        triangle = np.take(boxes.triangle, np.take(box, kept))
        return np.take(square, kept), triangle, *(np.take(a, kept) for a in covered)

    least = _least_disparities(shape, cell, low)
    boxes = band.boxes.within(band.rows)
    work = _not_behind(boxes, triangles, _first_of(boxes, band.rows, grid), least)
    pieces = [_nothing(), *in_parallel(some, work)]
    square, triangle, points, centre, *plane = (np.concatenate(a) for a in zip(*pieces, strict=True))
    return Touching(square, triangle, points, centre, tuple(plane))


def _nothing() -> list[np.ndarray]:
    """The columns of what `touching` returns of no squares."""
    kinds = (np.int32, np.int32, np.uint32, bool, np.float32, np.float32, np.float32)
    return [np.zeros(0, dtype=each) for each in kinds]


def _first_of(boxes: Boxes, rows: range, grid: Grid) -> Int[np.ndarray, " b"]:
    """The first sample of each box, counted from the first of `rows`."""
    return (boxes.row - np.int32(rows.start)) * np.int32(grid.columns) + boxes.column


def _least_disparities(
    shape: tuple[int, ...], cell: Int[np.ndarray, " s"], low: Float[np.ndarray, " s"]
) -> list[Float[np.ndarray, " samples"]]:
    """The least `low` of the squares in boxes that begin at each sample, 2, 4 and 8 samples wide and high."""
    least = np.full(shape, np.inf, dtype=np.float32)
    np.minimum.at(least.reshape(-1), cell, low)
    found, edge = [], 1
    while edge < _WIDEST:
        least = least.copy()
        least[:-edge] = np.minimum(least[:-edge], least[edge:])
        least[:, :-edge] = np.minimum(least[:, :-edge], least[:, edge:])
        edge *= 2
        found.append(least.reshape(-1))
    return found


def _not_behind(
    boxes: Boxes,
    triangles: ScreenTriangles,
    place: Int[np.ndarray, " b"],
    farthest: Sequence[Float[np.ndarray, " samples"]],
) -> list[Boxes]:
    """The small boxes whose triangles are not behind all squares in them, and the large ones, in portions.

    Boxes begin at the samples `place` of those that `farthest` has.
    """
    nearest = triangles.span(2, boxes.triangle)[1].astype(np.float32)
    edge = np.maximum(boxes.width, boxes.height)
    kept = edge > _WIDEST
    for level, least in enumerate(farthest):
        mine = np.flatnonzero((edge <= 2 << level) & (edge > (1 << level if level else 0)))
        kept[mine] = nearest[mine] >= np.take(least, place[mine])
    boxes = boxes.take(np.flatnonzero(kept))
    cost = np.maximum(boxes.samples, _SAMPLES_AT_ONCE / _BOXES_AT_ONCE)
    return list(boxes.portions(cost, _SAMPLES_AT_ONCE))


def _table(edges: Edges, w: Sequence[np.ndarray]) -> Float[Array, "14 boxes"]:
    """Where the triangle of each box is, in single precision: places are near the box's first sample.

    The three coefficients of each side; disparity at the first sample, its changes, its least and largest.
    """
    # Of triangles without area there are no pairs, but infinite distances.
    with np.errstate(invalid="ignore"):
        plane = [sum(edge[k] * edge[3] for edge in edges) for k in (2, 0, 1)]
    rows = [*(values for edge in edges for values in edge[:3]), *plane, *_extremes(w)]
    return device_array(np.stack([pad_rows(row.astype(np.float32), _BOXES_AT_ONCE) for row in rows]))


@jit
def _covered(
    table: Float[Array, "14 boxes"],
    box: Int[Array, " n"],
    right: Int[Array, " n"],
    below: Int[Array, " n"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
) -> tuple[UInt[Array, " n"], Bool[Array, " n"], Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """As `Touching` has it, from `points` on, for the squares `right` of and `below` the first of a box."""
    x, y = right.astype(jnp.float32), below.astype(jnp.float32)
    *sides, there, slope_x, slope_y, least, most = (row[box] for row in table)
    there = there + slope_x * x + slope_y * y
    within = jnp.clip(there, least, most)
    counts = (within >= low) & (within <= high)
    edges = [
        (across, along, offset + across * x + along * y)
        for across, along, offset in (sides[k : k + 3] for k in (0, 3, 6))
    ]

    def inside(x_off: float, y_off: float) -> Bool[Array, " n"]:
        """Whether squares are covered at an offset from their centres."""
        first, second, third = (x_off * across + y_off * along + middle for across, along, middle in edges)
        return counts & (jnp.minimum(jnp.minimum(first, second), third) >= -_SLACK)

    # Point by point: each step is one long loop over squares. XLA for CPU is slow at short sums.
    bits = jnp.zeros(box.shape, dtype=jnp.uint32)
    for number, (x_off, y_off) in enumerate(OFFSETS):
        bits |= inside(float(x_off), float(y_off)).astype(jnp.uint32) << number
    return bits, inside(0.0, 0.0), there, slope_x, slope_y


def _extremes(values: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest of three [n]."""
    first, second, third = values
    least, most = (op(op(first, second), third) for op in (np.minimum, np.maximum))
    return least, most


def _covered_lines(
    boxes: Boxes, edges: Edges, line: np.ndarray, down: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First sample [n] whose square the triangle touches in each line of samples of its box, and the end."""
    left, right = np.zeros(len(line)), np.take(boxes.width - 1.0, line)
    for across, along, offset, _ in edges:
        # Inside is across x >= least.
        least = np.take(-_SLACK - offset - 0.5 * (np.abs(across) + np.abs(along)), line)
        least -= np.take(along, line) * down
        across = np.take(across, line) + 0.0
        with np.errstate(divide="ignore", invalid="ignore"):
            limit = least / across
        np.fmax(left, limit, out=left, where=across >= 0)
        np.fmin(right, limit, out=right, where=across < 0)
    end = np.floor(np.maximum(right, -1.0)).astype(np.int32) + 1
    return np.ceil(np.minimum(left, end)).astype(np.int32), end
