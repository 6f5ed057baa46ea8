"""Clear radii of lens files that reach a little beyond where two surfaces meet.

Programs write semi-diameters by the rays they traced, and need not ask whether there is room for glass: two
concave sides that face one another may touch at their edges within them. No ray passes there in a lens of
glass, so such surfaces end where they meet.
"""

from collections.abc import Sequence

import numpy as np

from focusjax.optics._prescription import CROSSING, gap_between
from focusjax.optics._surfaces import AbstractSurface

_LEAST_SHARE = 0.8
"""Of both clear radii within which surfaces must not cross: farther in, a number of the file is wrong."""
_HALVINGS = 40


def narrowed_to_meet(
    surfaces: Sequence[AbstractSurface],
    thicknesses: Sequence[float],
    radii: Sequence[float],
    stop: int,
) -> tuple[list[float], list[int]]:
    """Clear radii of which no two neighbours cross, where a fifth less of both is enough for that.

    The stop's is left as it is. What crosses farther in does so afterwards.

    Args:
        surfaces: of the lens.
        thicknesses: mm from each to the next.
        radii: their clear radii in mm.
        stop: number of the stop.

    Returns:
        The radii, and the numbers of the first of each two surfaces that were narrowed.
    """
    found, narrowed = [float(radius) for radius in radii], []
    for number in range(len(surfaces) - 1):
        pair = slice(number, number + 2)
        if stop in (number, number + 1):
            continue
        place = _meeting(surfaces[number], surfaces[number + 1], thicknesses[number], min(found[pair]))
        if place is not None and place >= _LEAST_SHARE * max(radii[pair]):
            found[pair] = place, place
            narrowed.append(number)
    return found, narrowed


def _meeting(
    surface: AbstractSurface, following: AbstractSurface, thickness: float, radius: float
) -> float | None:
    """How far from the axis, up to `radius`, two surfaces first meet; None where they do not."""
    across = np.linspace(0.0, radius, 65)
    crossed = gap_between(surface, following, thickness, across) < -CROSSING
    if crossed[0] or not crossed.any():
        return None
    apart, beyond = across[crossed.argmax() - 1], across[crossed.argmax()]
    for _ in range(_HALVINGS):
        middle = (apart + beyond) / 2.0
        if gap_between(surface, following, thickness, np.array([middle]))[0] < 0.0:
            beyond = middle
        else:
            apart = middle
    return float(apart)
