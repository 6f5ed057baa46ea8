"""Time at equal error: how long a method takes to a given PSNR, read off its measured curve."""

import dataclasses
import math
from collections.abc import Sequence


@dataclasses.dataclass(frozen=True)
class Reach:
    """How long a method takes to reach an error.

    Attributes:
        seconds: that long; infinite if no setting gets there.
        at_most: whether already the quickest setting is better, so that `seconds` is only a bound.
    """

    seconds: float
    at_most: bool


def time_to_reach(points: Sequence[tuple[float, float]], decibels: float) -> Reach:
    """Seconds to `decibels`, between the points (seconds, dB) that nothing quicker beats.

    Between two of them the logarithm of the time is linear in the decibels.

    Args:
        points: seconds and PSNR of a method's settings, in any order.
        decibels: PSNR to reach.

    Example:
        >>> time_to_reach([(1.0, 30.0), (4.0, 40.0)], 35.0)
        Reach(seconds=2.0, at_most=False)
    """
    best: list[tuple[float, float]] = []
    for seconds, score in sorted(points):
        if not best or score > best[-1][1]:
            best.append((seconds, score))
    if not best or best[-1][1] < decibels:
        return Reach(math.inf, at_most=False)
    if best[0][1] >= decibels:
        return Reach(best[0][0], at_most=best[0][1] > decibels)
    after = next(k for k, (_, score) in enumerate(best) if score >= decibels)
    (early, low), (late, high) = best[after - 1 : after + 1]
    # A picture that equals the reference is no help in saying where between the two it got there.
    share = (decibels - low) / (high - low) if math.isfinite(high) else 1.0
    return Reach(early * (late / early) ** share, at_most=False)
