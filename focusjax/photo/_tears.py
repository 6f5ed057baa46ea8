"""Where a depth map continues from pixel to pixel, and where it is torn.

With the parallax P = f E of the widest lens in pixels per dioptre (f focal length in pixels, E pupil radius),
a step s of disparity between neighbouring pixels opens a gap of P |s| pixels for a ray at the lens rim: half
the change of the possible blur. The surface is torn there if the gap is wider than `GAP` and the slopes on
both sides do not predict the step to within half of it, or if it is wider than `STEEPEST` whatever the
slopes: a surface seen so nearly edge-on looks like a silhouette.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

GAP = 1.0
"""Pixels at the lens rim above which a step may be a silhouette."""
STEEPEST = 8.0
"""Pixels at the lens rim above which every step is one."""


@dataclass(frozen=True)
class Links:
    """Which neighbouring pixels show one surface.

    Attributes:
        across: whether pixel [h, w - 1] continues to the one on its right.
        down: whether pixel [h - 1, w] continues to the one below.
    """

    across: Bool[np.ndarray, "_ _"]
    down: Bool[np.ndarray, "_ _"]


def links(disparity: Float[np.ndarray, "h w"], parallax: float) -> Links:
    """The links of a depth map in 1/m; `parallax` in pixels per dioptre."""
    across = _along_rows(disparity, parallax)
    return Links(across, _along_rows(disparity.T, parallax).T)


def _along_rows(disparity: Float[np.ndarray, "h w"], parallax: float) -> Bool[np.ndarray, "_ _"]:
    step = np.diff(disparity, axis=1)
    # At the frame nothing speaks against a slope.
    before = np.pad(step, ((0, 0), (1, 0)), mode="edge")[:, :-1]
    after = np.pad(step, ((0, 0), (0, 1)), mode="edge")[:, 1:]
    gap = parallax * np.abs(step)
    misfit = np.maximum(np.abs(step - before), np.abs(step - after))
    return (gap <= GAP) | ((misfit <= 0.5 * np.abs(step)) & (gap <= STEEPEST))


def torn_sides(
    disparity: Float[np.ndarray, "h w"], joined: Links
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Pixels on the near and on the far side of tears."""
    near, far = np.zeros(disparity.shape, dtype=bool), np.zeros(disparity.shape, dtype=bool)
    for torn, first, second in (
        (~joined.across, np.s_[:, :-1], np.s_[:, 1:]),
        (~joined.down, np.s_[:-1], np.s_[1:]),
    ):
        first_near = disparity[first] > disparity[second]
        near[first] |= torn & first_near
        far[second] |= torn & first_near
        near[second] |= torn & ~first_near
        far[first] |= torn & ~first_near
    return near, far


def without_slivers(disparity: Float[np.ndarray, "h w"], parallax: float) -> Float[np.ndarray, "h w"]:
    """A depth map in which no pixel lies between the two sides of a silhouette.

    Depth maps are soft, so that some pixels along a silhouette have a depth that is neither the foreground's
    nor the background's. As surfaces of their own they would hide the background, which then goes on behind
    them no farther than one pixel, and rays that pass between the two would see nothing at all. Each takes
    the depth of that neighbour, of those that are no slivers, which is most like its own.

    Args:
        disparity: 1/m.
        parallax: pixels per dioptre at the rim of the widest lens.
    """
    near, far = torn_sides(disparity, links(disparity, parallax))
    sliver = near & far
    out = disparity.copy()
    while sliver.any():
        known = np.pad(np.where(sliver, np.nan, out), 1, constant_values=np.nan)
        best, apart = out.copy(), np.full(out.shape, np.inf, dtype=out.dtype)
        height, width = out.shape
        for dy in range(3):
            for dx in range(3):
                value = known[dy : dy + height, dx : dx + width]
                off = np.abs(value - disparity)
                nearer = off < apart
                best[nearer], apart[nearer] = value[nearer], off[nearer]
        found = sliver & np.isfinite(apart)
        if not found.any():
            break
        out[found] = best[found]
        sliver &= ~found
    return out
