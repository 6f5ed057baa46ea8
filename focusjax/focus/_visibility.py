"""How much of a point is to be seen: its wish fades as something passes before it (Lee10 §5)."""

import numpy as np
from jaxtyping import Float

VISIBLE_WITHIN = 0.01
"""A surface point is visible when its disparity is within this share of the first surface's."""

HIDDEN_BEYOND = 0.05
"""A surface nearer by this share of the point's disparity hides it wholly."""

FADE_PX = 2.0
"""The weight fades while a silhouette passes over a disk of this radius around the point."""


def seen_at(disparity_map: Float[np.ndarray, "h w"], xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Disparity of the first surface at the pixel centres nearest to positions in the frame."""
    height, width = disparity_map.shape
    column, line = np.floor(xy).astype(int).T
    return disparity_map[np.clip(line, 0, height - 1), np.clip(column, 0, width - 1)]


def visibility(
    disparity_map: Float[np.ndarray, "h w"], xy: Float[np.ndarray, "2"], disparity: float
) -> float:
    """Share from 0 to 1 of a small disk around an image position where nothing lies before the point.

    The disk's weights fall to 0 at its rim, so that the share is continuous in the position; it is in
    the disparity, too, but for a point at infinity, which everything hides. The slope of the surface that
    is seen there is allowed for: a table seen at a grazing angle does not hide itself.

    Args:
        disparity_map: disparity of the first surface at every pixel centre in 1/m.
        xy: image position in pixels, in the frame.
        disparity: of the point, in 1/m.
    """
    height, width = disparity_map.shape
    column = np.clip(np.arange(-2, 3) + int(xy[0]), 0, width - 1)
    line = np.clip(np.arange(-2, 3) + int(xy[1]), 0, height - 1)
    patch = disparity_map[np.ix_(line, column)]
    right, down = column + 0.5 - xy[0], line + 0.5 - xy[1]
    weight = np.maximum(1.0 - (down[:, None] ** 2 + right**2) / FADE_PX**2, 0.0)
    # Of the slopes to both sides the smaller: an edge on one side is none of the surface's slope.
    across = _least_slope(patch[2, 1:4])
    along = _least_slope(patch[1:4, 2])
    nearer = patch - across * right - along * down[:, None] - disparity
    if disparity > 0:
        beyond = (nearer / disparity - VISIBLE_WITHIN) / (HIDDEN_BEYOND - VISIBLE_WITHIN)
        shown = 1.0 - np.clip(beyond, 0.0, 1.0)
    else:
        shown = (patch <= 0.0).astype(float)
    return float(np.sum(weight * shown) / np.sum(weight))


def _least_slope(three: Float[np.ndarray, "3"]) -> float:
    """The smaller of two neighbouring differences when they agree in sign, else 0."""
    back, ahead = np.diff(three)
    return float(np.sign(back) * min(abs(back), abs(ahead))) if back * ahead > 0 else 0.0
