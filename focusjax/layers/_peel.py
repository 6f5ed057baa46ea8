"""Depth peeling with the extended umbra: layers that hold every surface some lens ray can reach.

The first layer is the nearest surface, the next one the nearest of what that does not hide, and so on; what
is hidden, `_umbra` says.

A sample that is there in part only, of glass or at the outline of a leaf, hides nothing: the next surface
has only to lie below it. Where there are such, w is the nearest opaque surface found so far, in this layer
or in those before.
"""

import numpy as np
from jaxtyping import Float, Int

from focusjax._parallel import in_parallel, parts
from focusjax.layers._grid import Grid
from focusjax.layers._raster import Fragments
from focusjax.layers._umbra import SEPARATION, hidden_below, windows_within

_AT_ONCE = 1 << 18
_SOLID_LAYERS = 2
_SPARSE = 0.25
"""Fragments per sample of the grid below which looking at them costs less than looking at the grid."""


def peel_fragments(
    fragments: Fragments,
    grid: Grid,
    parallax: float,
    max_layers: int,
    *,
    umbra: bool = True,
    opacity: Float[np.ndarray, " f"] | None = None,
) -> tuple[list[Int[np.ndarray, " _"]], int]:
    """The fragments that each layer holds, in the order of their samples; and how many were left over.

    `parallax` is f E in samples per dioptre; 0 (a pinhole) hides everything behind the first opaque surface.
    Without `umbra` each layer is the next surface (Everitt 2001), and nothing is hidden but what lies in the
    same place. `opacity` is that of each fragment, None where all are opaque.
    """
    sample, disparity = fragments.sample, fragments.disparity
    alive = np.arange(len(sample), dtype=np.int32)
    layers: list[np.ndarray] = []
    solid: np.ndarray | None = None
    shape = (grid.rows, grid.columns)
    levels = windows_within(parallax, float(disparity.max(initial=0.0)))
    while len(alive) and len(layers) < max_layers:
        if len(layers) >= _SOLID_LAYERS and opacity is None and len(alive) < _SPARSE * grid.size:
            sparse, left = _peel_sparse(
                fragments.take(alive), grid, parallax, max_layers - len(layers), umbra=umbra
            )
            return layers + [alive[layer] for layer in sparse], left
        best, owner = first_surface(sample, disparity, grid)
        held = np.flatnonzero(owner >= 0)
        layers.append(np.take(alive, np.take(owner, held)))
        if umbra and opacity is None and parallax == 0:
            return layers, 0
        if umbra and opacity is not None:
            opaque = opacity[layers[-1]] == 1.0
            solid = np.zeros(shape, dtype=disparity.dtype) if solid is None else solid
            solid.reshape(-1)[held[opaque]] = best[held[opaque]]
        if umbra:
            # Wide windows hide much behind the first surfaces; later ones are patches too small for them.
            windows = levels if len(layers) <= _SOLID_LAYERS or solid is not None else 1
            below = hidden_below(best.reshape(shape), parallax, windows=windows, solid=solid).reshape(-1)
        else:
            below = best * np.float32(1.0 - SEPARATION)
        alive, sample, disparity = _behind(below, alive, sample, disparity)
    return layers, len(alive)


def _behind(below: np.ndarray, *fragments: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of fragments, given by any numbers, samples and disparities, those that are behind `below`."""

    def some(part: slice) -> tuple[np.ndarray, ...]:
        alive, sample, disparity = (a[part] for a in fragments)
        left = np.flatnonzero(disparity < np.take(below, sample))
        return tuple(np.take(a, left) for a in (alive, sample, disparity))

    found = in_parallel(some, parts(len(fragments[0]), _AT_ONCE))
    return tuple(np.concatenate(a) for a in zip(*found, strict=True))


def first_surface(
    sample: Int[np.ndarray, " f"], disparity: Float[np.ndarray, " f"], grid: Grid
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Largest disparity at every sample, 0 where there is none; and the last fragment that has it, or -1."""
    best = np.zeros(grid.size, dtype=disparity.dtype)
    for part in parts(len(sample), _AT_ONCE):
        np.maximum.at(best, sample[part].astype(np.intp), disparity[part])

    def winners(part: slice) -> np.ndarray:
        return part.start + np.flatnonzero(disparity[part] == np.take(best, sample[part]))

    owner = np.full(grid.size, -1, dtype=np.int32)
    for winning in in_parallel(winners, parts(len(sample), _AT_ONCE)):
        owner[sample[winning]] = winning
    return best, owner


def _peel_sparse(
    fragments: Fragments, grid: Grid, parallax: float, max_layers: int, *, umbra: bool
) -> tuple[list[Int[np.ndarray, " _"]], int]:
    """The same for few fragments, and how many were left: those of a sample in a row, nearest first.

    Windows of radius 1 only.
    """
    separation, step = np.float32(1.0 - SEPARATION), np.float32(1.0 / max(parallax, 1e-30))
    # Of fragments in one place the last is taken, as it is where there are many.
    order = np.lexsort((-fragments.disparity[::-1], fragments.sample[::-1]))
    order = len(order) - 1 - order
    sample, disparity = fragments.sample[order].astype(np.intp), fragments.disparity[order]
    around = np.array([dy * (grid.columns + 2) + dx for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
    surface = np.zeros((grid.rows + 2) * (grid.columns + 2), dtype=disparity.dtype)
    framed = (sample // grid.columns + 1) * (grid.columns + 2) + sample % grid.columns + 1
    layers: list[np.ndarray] = []
    while len(order) and len(layers) < max_layers:
        new = np.diff(sample, prepend=-1) > 0
        first = np.flatnonzero(new)
        layers.append(order[first])
        best, place = disparity[first], framed[first]
        cut = best * separation
        if umbra:
            surface[place] = best
            nearby = surface[place[:, None] + around]
            surface[place] = 0.0
            nearest, farthest = nearby.max(axis=1), nearby.min(axis=1)
            continued = (farthest > 0) & (nearest - farthest <= step)
            cut = np.minimum(cut, best - np.float32(0.5) * step)
            cut = np.where(continued, np.minimum(cut, nearest - step), cut)
        left = np.flatnonzero(disparity < cut[np.cumsum(new) - 1])
        order, sample, disparity, framed = order[left], sample[left], disparity[left], framed[left]
    return layers, len(order)
