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
