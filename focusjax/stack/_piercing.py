"""The fewest points that meet all of some intervals."""

import numpy as np
from jaxtyping import Float, Int


def fewest_points(
    lower: Float[np.ndarray, "n"], upper: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "m 2"], Int[np.ndarray, "n"]]:
    """Groups of closed intervals with something in common, as few as can be.

    The first point is the smallest upper end: some point has to meet that interval, and of those that do
    none meets more of the others. The intervals that it meets are one group, and the same goes for the rest.
    That is optimal (Gavril 1972, for cliques that cover an interval graph).

    Args:
        lower: lower ends.
        upper: upper ends, none below its lower end.

    Returns:
        What the intervals of each group have in common, its lower and upper end, in ascending order; and the
        group of each interval.

    Example:
        >>> common, group = fewest_points(np.array([0.0, 1.0, 3.0]), np.array([2.0, 4.0, 5.0]))
        >>> common.tolist(), group.tolist()
        ([[1.0, 2.0], [3.0, 5.0]], [0, 0, 1])
    """
    group = np.full(len(lower), -1)
    common: list[tuple[float, float]] = []
    for number in np.argsort(upper, kind="stable").tolist():
        if group[number] >= 0:
            continue
        members = (group < 0) & (lower <= upper[number]) & (upper >= upper[number])
        group[members] = len(common)
        common.append((float(lower[members].max()), float(upper[number])))
    return np.array(common).reshape(-1, 2), group
