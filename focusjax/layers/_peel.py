"""Depth peeling with the extended umbra: layers that hold every surface some lens ray can reach.

Lee10 section 3.1: a sample of surface at depth d hides from a lens of radius E what lies within
x = d s / (E - s) behind it, s being the world width of a sample there. In disparity that is plain:

    w_cut = w - 1 / (f E),

the step that moves a ray by one sample at the lens rim (f E in samples per dioptre).

The paper widens each sample to the centres of its neighbours to gain that whole sample, and asks the
tracer to draw silhouettes wider too. We keep silhouettes where they are, so a lone sample is half a sample
wide to each side and hides half the umbra from rays to its centre, w_cut = w - 0.5 / (f E). In exchange we
use the surfaces that samples belong to: where all samples up to r away continue one another, a ray must
travel at least r under the surface to get here, starting at most at the nearest of them,

    w_cut = max over (2 r + 1)^2 of w  -  r / (f E),        r = 1, 2, 4, ...,

so that what a solid object hides is dropped but for a border as wide as the parallax.

A sample that is there in part only, of glass or at the outline of a leaf, hides nothing: the next surface
has only to lie below it. Where there are such, w is the nearest opaque surface found so far, in this layer
or in those before.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax.layers._grid import Grid
from focusjax.layers._raster import Fragments

_AT_ONCE = 1 << 18
_SOLID_LAYERS = 2
_SPARSE = 0.25
"""Fragments per sample of the grid below which looking at them costs less than looking at the grid."""
SEPARATION = 1e-5
"""Relative step in disparity below which two surfaces count as one (coincident triangles)."""


@functools.partial(jax.jit, donate_argnums=0)
def _nearest(
    best: Float[Array, " n"], sample: Int[Array, " f"], disparity: Float[Array, " f"]
) -> Float[Array, " n"]:
    return best.at[sample].max(disparity, mode="drop")


@functools.partial(jax.jit, donate_argnums=0)
def _owners(
    owner: Int[Array, " n"],
    best: Float[Array, " n"],
    sample: Int[Array, " f"],
    disparity: Float[Array, " f"],
    first: Int[Array, ""],
) -> Int[Array, " n"]:
    """The fragment (its position counted from `first`) that gave each sample its nearest disparity."""
    wins = disparity == best.at[sample].get(mode="fill", fill_value=-1.0)
    number = first + jnp.arange(sample.shape[0], dtype=owner.dtype)
    return owner.at[sample].max(jnp.where(wins, number, -1), mode="drop")


@functools.partial(jax.jit, static_argnames="widest")
def _cut(
    best: Float[Array, "h w"],
    parallax: Float[Array, ""],
    levels: Int[Array, ""],
    solid: Float[Array, "h w"] | None,
    *,
    widest: int,
) -> Float[Array, "h w"]:
    """Disparity that the next surface must stay below, by windows of radius 1, 2, 4, ..., `levels` of them.

    `widest` is the radius of the last. `solid` is the opaque surface that hides what lies farther, 0 where
    there is none; if it is None, that is `best` itself.
    """
    hiding = best if solid is None else solid
    umbra = 1.0 / jnp.maximum(parallax, 1e-30)

    def over_window(a: Array, reach: Array, op: Callable[[Array, Array], Array]) -> Array:
        """`op` over the nine places 0 and `reach` away in x and y; nothing is beyond the grid."""
        for axis in (0, 1):
            padded = jnp.pad(a, [(widest, widest) if k == axis else (0, 0) for k in (0, 1)])
            before, after = (
                jax.lax.dynamic_slice_in_dim(padded, widest + shift, a.shape[axis], axis=axis)
                for shift in (-reach, reach)
            )
            a = op(op(before, a), after)
        return a

    one = jnp.int32(1)
    nearest, farthest = over_window(hiding, one, jnp.maximum), over_window(hiding, one, jnp.minimum)
    continued = (farthest > 0) & (nearest - farthest <= umbra)

    def goes_on(state: tuple[Array, Array, Array, Array, Array]) -> Bool[Array, ""]:
        return (state[0] < levels) & jnp.any(state[3])

    def widen(state: tuple[Array, Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
        # Windows grow by doubling: that of radius 2 r is nine of radius r, steps of r apart.
        # Continuity has to hold within one sample of every sample but the outermost.
        level, cut, nearest, continued, reach = state
        behind = nearest - reach.astype(best.dtype) * umbra
        cut = jnp.where(continued, jnp.minimum(cut, behind), cut)
        nearest = over_window(nearest, reach, jnp.maximum)
        return level + 1, cut, nearest, over_window(continued, reach, jnp.logical_and), 2 * reach

    below = hiding - 0.5 * umbra if solid is None else jnp.where(solid > 0, solid - 0.5 * umbra, jnp.inf)
    cut = jnp.minimum(best * (1.0 - SEPARATION), below)
    return jax.lax.while_loop(goes_on, widen, (0 * one, cut, nearest, continued, one))[1]


def hidden_below(
    best: Float[np.ndarray, "h w"], parallax: float, *, windows: int = 1
) -> Float[np.ndarray, "h w"]:
    """Disparity below which no ray passes the surface `best`; infinite where that is 0, nothing.

    Args:
        best: disparity of a surface at each sample; 0 where there is none.
        parallax: f E in samples per dioptre.
        windows: how many of the radii 1, 2, 4, ... to look at for solid surface.
    """
    inputs = jnp.asarray(best), jnp.asarray(np.asarray(parallax, dtype=best.dtype)), jnp.int32(windows), None
    return np.where(best > 0, np.asarray(_cut(*inputs, widest=1 << (windows - 1))), np.inf)


def windows_within(parallax: float, nearest: float) -> int:
    """How many windows it takes to reach farther than rays move under a surface at disparity `nearest`."""
    return int(parallax * nearest).bit_length() + 1


def peel_fragments(
    fragments: Fragments,
    grid: Grid,
    parallax: float,
    max_layers: int,
    *,
    umbra: bool = True,
    opacity: Float[np.ndarray, " f"] | None = None,
) -> tuple[list[Int[np.ndarray, " _"]], bool]:
    """The fragments that each layer holds, in the order of their samples; and whether none was left over.

    `parallax` is f E in samples per dioptre; 0 (a pinhole) hides everything behind the first opaque surface.
    Without `umbra` each layer is the next surface (Everitt 2001), and nothing is hidden but what lies in the
    same place. `opacity` is that of each fragment, None where all are opaque.
    """
    sample, disparity = fragments.sample, fragments.disparity
    alive = np.arange(len(sample))
    layers: list[np.ndarray] = []
    solid: np.ndarray | None = None
    levels = windows_within(parallax, float(disparity.max(initial=0.0)))
    while len(alive) and len(layers) < max_layers:
        if len(layers) >= _SOLID_LAYERS and opacity is None and len(alive) < _SPARSE * grid.size:
            sparse, left = _peel_sparse(
                fragments.take(alive), grid, parallax, max_layers - len(layers), umbra=umbra
            )
            return layers + [alive[layer] for layer in sparse], left == 0
        best, owner = _first_surface(sample, disparity, grid)
        held = np.flatnonzero(owner >= 0)
        layers.append(np.take(alive, np.take(owner, held)))
        if umbra and opacity is None and parallax == 0:
            return layers, True
        if umbra and opacity is not None:
            opaque = opacity[layers[-1]] == 1.0
            solid = np.zeros(grid.size, dtype=disparity.dtype) if solid is None else solid
            solid[held[opaque]] = np.asarray(best)[held[opaque]]
        if umbra:
            # Wide windows hide much behind the first surfaces; later ones are patches too small for them.
            windows = levels if len(layers) <= _SOLID_LAYERS or solid is not None else 1
            shape = (grid.rows, grid.columns)
            cut = _cut(
                best.reshape(shape),
                jnp.asarray(np.asarray(parallax, dtype=best.dtype)),
                jnp.int32(windows),
                None if solid is None else jnp.array(solid.reshape(shape)),
                widest=1 << (levels - 1),
            )
            below = np.asarray(cut).reshape(-1)
        else:
            below = np.asarray(best) * np.float32(1.0 - SEPARATION)
        left = np.flatnonzero(disparity < np.take(below, sample))
        alive, sample, disparity = (np.take(a, left) for a in (alive, sample, disparity))
    return layers, len(alive) == 0


def _first_surface(
    sample: Int[np.ndarray, " f"], disparity: Float[np.ndarray, " f"], grid: Grid
) -> tuple[Float[Array, " n"], Int[np.ndarray, " n"]]:
    """Largest disparity at every sample of the grid, 0 where none is, and the last fragment that has it."""
    parts = [
        (start, *(_block(a, start, fill) for a, fill in ((sample, grid.size), (disparity, 0.0))))
        for start in range(0, len(sample), _AT_ONCE)
    ]
    best = jnp.zeros(grid.size, dtype=disparity.dtype)
    for _, where, what in parts:
        best = _nearest(best, where, what)
    owner = jnp.full(grid.size, -1, dtype=jnp.int32)
    for start, where, what in parts:
        owner = _owners(owner, best, where, what, jnp.int32(start))
    return best, np.asarray(owner)


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


def _block(array: np.ndarray, start: int, fill: float) -> Array:
    part = array[start : start + _AT_ONCE]
    if len(part) < _AT_ONCE:
        part = np.concatenate([part, np.full(_AT_ONCE - len(part), fill, dtype=array.dtype)])
    return jnp.asarray(part)
