"""What foregrounds hide: a guess of depth and colour behind them, as far as a lens can look.

A lens of parallax P (pixels per dioptre at the rim) sees past an edge at disparity w_n down to a surface at
w_f over a strip of P (w_n - w_f) pixels. So the far side of every tear is carried on behind the near side,
step by step, up to that width. Disparity and colour are then the harmonic functions

    sum over neighbours q of p of (u_q - u_p) = 0,

on what was carried, with the values of the visible far side as boundary and no flow across other edges: the
smoothest membrane that continues what is seen, separately for every surface that goes on behind another.
Such a fill has no detail of its own, which is right on the average where nothing is known. Pixels at tears
mix both sides and count as boundary by `MIXED` only: where thin things stand close together there are no
others. Lamps are dimmed first: brighter than white and narrow, they do not go on behind anything.
"""

import numpy as np
import scipy
from jaxtyping import Bool, Float

from focusjax.photo._tears import GAP

_BEYOND = 2
"""Pixels that the guess reaches farther than any ray."""
_TOLERANCE, _STEPS = 1e-5, 600
_UNKNOWN = 1e-6
"""Weight of the first guess against the boundary."""
MIXED, MIXED_EXACT = 2e-4, 0.02
"""Weight of pixels at tears as boundary of a membrane; the second where depth is right to the pixel."""
LAMP = 0.03
"""Share of a picture's longer side that a lamp takes at most."""
_SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))


def carried_behind(
    disparity: Float[np.ndarray, "h w"],
    band: Bool[np.ndarray, "h w"],
    far_band: Bool[np.ndarray, "h w"],
    near_band: Bool[np.ndarray, "h w"],
    far_sides: Bool[np.ndarray, "h w"],
    parallax: float,
) -> Float[np.ndarray, "h w"]:
    """Disparity [h, w] of the surface behind, as carried from the nearest tear; NaN where there is none.

    Args:
        disparity: 1/m of what is seen.
        band: pixels at tears, of which no colour is trusted.
        far_band: those of them that show the far side: their own depth is the one behind.
        near_band: those that show the near side.
        far_sides: pixels on the far side of a tear; what stands between two silhouettes is on both sides.
        parallax: pixels per dioptre at the lens rim.
    """
    hidden = np.where(far_band, disparity, np.nan)
    front = far_band | far_sides
    least = GAP / max(parallax, 1e-12)
    reach = parallax * (disparity.max() - disparity.min())
    step = 0
    while front.any() and step <= reach + _BEYOND + 1:
        step += 1
        best = np.full(disparity.shape, np.inf, dtype=disparity.dtype)
        known = np.where(front, disparity if step == 1 else hidden, np.inf)
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
    height, width = a.shape[:2]
    to = np.s_[max(0, -dy) : height - max(0, dy), max(0, -dx) : width - max(0, dx)]
    of = np.s_[max(0, dy) : height + min(0, dy), max(0, dx) : width + min(0, dx)]
    out[to] = a[of]
    return out


def without_lamps(light: Float[np.ndarray, "h w 3"], widest: int) -> Float[np.ndarray, "h w 3"]:
    """The picture with lamps dimmed to white, or to what surrounds them if that is brighter.

    A lamp is brighter than 1 and narrower than `widest` pixels, also after gaps as narrow are filled: a sky
    that shows between bars is none.
    """
    top = light.max(axis=2)
    if top.max() <= 1.0:
        return light
    size = max(3, widest)
    surround = scipy.ndimage.grey_opening(scipy.ndimage.grey_closing(top, size=size), size=size)
    return light * np.minimum(np.maximum(surround, 1.0) / np.maximum(top, 1.0), 1.0)[..., None]


def membrane(
    hidden: Float[np.ndarray, "h w"],
    visible: Float[np.ndarray, "h w"],
    weight: Float[np.ndarray, "h w"],
    values: Float[np.ndarray, "h w c"],
    start: Float[np.ndarray, "h w c"],
    step: float,
) -> Float[np.ndarray, "h w c"]:
    """`values` continued over `hidden` by membranes; elsewhere as they are.

    Args:
        hidden: disparity of what is to be filled, NaN elsewhere.
        visible: disparity of what is seen.
        weight: how much a pixel counts as boundary, 0 to 1, for what is as far away as what it shows.
        values: what is known.
        start: a first guess, of which the mean is kept where a piece has no boundary.
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
    degree = np.full(count, _UNKNOWN)
    right = _UNKNOWN * start[inside].astype(np.float64)

    def bound(where: np.ndarray, by: np.ndarray, to: np.ndarray) -> None:
        degree[number[where]] += by[where]
        right[number[where]] += by[where][:, None] * to[where]

    bound(inside & (np.abs(visible - hidden) <= step), weight, values)
    for dy, dx in _SIDES:
        joined = np.abs(_shifted(hidden, dy, dx, np.nan) - hidden) <= step
        rows.append(number[joined])
        columns.append(_shifted(number, dy, dx, 0)[joined])
        degree[number[joined]] += 1.0
        by = _shifted(weight, dy, dx, 0.0)
        edge = (by > 0) & (np.abs(_shifted(visible, dy, dx, np.nan) - hidden) <= step)
        bound(edge, by, _shifted(values, dy, dx, 0.0))
    flow = coo_matrix(
        (np.ones(sum(map(len, rows))), (np.concatenate(rows), np.concatenate(columns))), (count, count)
    ).tocsr()
    system, scale = diags(degree) - flow, diags(1.0 / degree)
    out = values.copy()
    for channel in range(values.shape[2]):
        first = start[inside][:, channel].astype(np.float64)
        found, _ = cg(system, right[:, channel], x0=first, rtol=_TOLERANCE, maxiter=_STEPS, M=scale)
        # No harmonic function exceeds its boundary; one that is not solved to the end might.
        out[inside, channel] = np.clip(found, values[..., channel].min(), values[..., channel].max())
    return out
