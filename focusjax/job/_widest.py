"""The widest aperture with which wishes for focus are still met as well as they can be."""

from collections.abc import Callable

from focusjax.focus import Solution

_HALVINGS = 12
"""Of the range of f-numbers: 9 stops to 0.002."""

_NEAR_PX = 3e-3
"""Of a wish of weight 1: what it may lose for being called met as well as before."""


def widest_as_good(
    within: Callable[[float, float], Solution], solution: Solution, least: float, low: float, most: float
) -> Solution:
    """The solution of the smallest f-number in `low` to `most` that costs no more than `solution`.

    What solutions cost with f-numbers up to N falls as N rises, so that N is found by halving the range.

    Args:
        within: the solution within a range of f-numbers.
        solution: the best one within all of it.
        least: smallest f-number of the lens.
        low: f-number below which nothing is gained.
        most: that of `solution`.
    """
    enough = float(solution.cost) + 0.5 * _NEAR_PX**2
    found = within(least, low)
    if float(found.cost) <= enough:
        return found
    found, failed, good = solution, low, most
    for _ in range(_HALVINGS):
        middle = (failed * good) ** 0.5
        tried = within(least, middle)
        if float(tried.cost) <= enough:
            found, good = tried, middle
        else:
            failed = middle
    return found
