"""What foregrounds hide: a guess of depth and colour behind them, as far as a lens can look.

A lens of parallax P (pixels per dioptre at the rim) sees past an edge at disparity w_n down to a surface at
w_f over a strip of P (w_n - w_f) pixels. So the far side of every tear is carried on behind the near side,
step by step, up to that width. Disparity and colour are then the harmonic functions

    sum over neighbours q of p of (u_q - u_p) = 0,

on what was carried, with the values of the visible far side as boundary and no flow across other edges: the
smoothest membrane that continues what is seen, separately for every surface that goes on behind another.
Such a fill has no detail of its own, which is right on the average where nothing is known.
"""

import numpy as np
from jaxtyping import Bool, Float

from focusjax.photo._tears import GAP

_BEYOND = 2
"""Pixels that the guess reaches farther than any ray."""
_TOLERANCE, _STEPS = 1e-3, 300
_SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))


def carried_behind(
    disparity: Float[np.ndarray, "h w"],
    band: Bool[np.ndarray, "h w"],
    far_band: Bool[np.ndarray, "h w"],
    near_band: Bool[np.ndarray, "h w"],
    parallax: float,
) -> Float[np.ndarray, "h w"]:
    """Disparity [h, w] of the surface behind, as carried from the nearest tear; NaN where there is none.

    Args:
        disparity: 1/m of what is seen.
        band: pixels at tears, of which no colour is trusted.
        far_band: those of them that show the far side: their own depth is the one behind.
        near_band: those that show the near side.
        parallax: pixels per dioptre at the lens rim.
    """
    hidden = np.where(far_band, disparity, np.nan)
    front = far_band
    least = GAP / max(parallax, 1e-12)
    reach = parallax * (disparity.max() - disparity.min())
    step = 0
    while front.any() and step <= reach + _BEYOND + 1:
        step += 1
        best = np.full(disparity.shape, np.inf, dtype=disparity.dtype)
        known = np.where(front, hidden, np.inf)
        for dy, dx in _SIDES:
            np.minimum(best, _shifted(known, dy, dx, np.inf), out=best)
        # A tear at first, and then anything that hides what is carried.
        fresh = np.isfinite(best) & np.isnan(hidden) & (disparity - best > least)
        fresh &= near_band if step == 1 else ~band | near_band
        fresh &= step <= parallax * (disparity - best) + _BEYOND
        hidden[fresh] = best[fresh]
        front = fresh
    return hidden


def _shifted(a: np.ndarray, dy: int, dx: int, fill: float) -> np.ndarray:
    """Value at (y + dy, x + dx)."""
    out = np.full_like(a, fill)
    height, width = a.shape
    to = np.s_[max(0, -dy) : height - max(0, dy), max(0, -dx) : width - max(0, dx)]
    of = np.s_[max(0, dy) : height + min(0, dy), max(0, dx) : width + min(0, dx)]
    out[to] = a[of]
    return out


def membrane(
    hidden: Float[np.ndarray, "h w"],
    visible: Float[np.ndarray, "h w"],
    trusted: Bool[np.ndarray, "h w"],
    values: Float[np.ndarray, "h w c"],
    start: Float[np.ndarray, "h w c"],
    step: float,
) -> Float[np.ndarray, "h w c"]:
    """`values` continued over `hidden` by membranes; elsewhere as they are.

    Args:
        hidden: disparity of what is to be filled, NaN elsewhere.
        visible: disparity of what is seen.
        trusted: pixels that may serve as boundary where they are as far away.
        values: what is known.
        start: a first guess, kept where a piece has no boundary.
        step: dioptres by which neighbours of one surface differ at most.
    """
    inside = np.isfinite(hidden)
    if not inside.any():
        return values.copy()
    from scipy.sparse import coo_matrix, diags
    from scipy.sparse.linalg import cg

    number = np.cumsum(inside.ravel()).reshape(inside.shape) - 1
    count = int(inside.sum())
    rows, columns = [], []
    degree = np.full(count, 1e-4)
    right = 1e-4 * start[inside].astype(np.float64)
    depth = np.where(inside, hidden, visible)
    for dy, dx in _SIDES:
        there = _shifted(depth, dy, dx, np.nan)
        close = inside & (np.abs(there - depth) <= step)
        joined = close & (_shifted(inside.astype(np.int8), dy, dx, 0) > 0)
        edge = close & ~joined & (_shifted(trusted.astype(np.int8), dy, dx, 0) > 0)
        rows.append(number[joined])
        columns.append(_shifted(number, dy, dx, 0)[joined])
        np.add.at(degree, number[joined | edge], 1.0)
        for channel in range(values.shape[2]):
            of = _shifted(values[..., channel], dy, dx, 0.0)
            np.add.at(right[:, channel], number[edge], of[edge])
    flow = coo_matrix(
        (np.ones(sum(map(len, rows))), (np.concatenate(rows), np.concatenate(columns))), (count, count)
    ).tocsr()
    system, scale = diags(degree) - flow, diags(1.0 / degree)
    out = values.copy()
    for channel in range(values.shape[2]):
        first = start[inside][:, channel].astype(np.float64)
        found, _ = cg(system, right[:, channel], x0=first, rtol=_TOLERANCE, maxiter=_STEPS, M=scale)
        out[inside, channel] = found
    return out
