"""When the light of a picture arrives: how long the shutter is open, how it opens, and row after row."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from focusjax._arguments import real_number

ALIGNMENTS = ("centre", "start", "end")
"""Where in the shutter's time the instant is that a frame stands for."""
DIRECTIONS = ("down", "up")
"""Which rows of the picture are exposed later: lower ones, or higher ones."""
_QUANTILES = 257


@dataclasses.dataclass(frozen=True)
class Shutter:
    """A shutter, in a photographer's units. `make_shutter` checks them.

    Times are seconds that a shutter which opens and closes at once would take for the same light, as shutters
    are engraved and as `[exposure]` counts: one that takes its time to open is open for longer.

    Attributes:
        time: seconds.
        curve: how far it is open [k], at evenly spaced times from its opening to its end, straight between.
        travel_time: seconds from when the first row of the picture is exposed to when the last one is; 0 for
            a shutter in the lens.
        direction: "down" when lower rows of the picture are exposed later, or "up".
        align: the instant that a frame stands for is at the "centre" of the time, its "start" or its "end".
    """

    time: float
    curve: tuple[float, ...] = (1.0, 1.0)
    travel_time: float = 0.0
    direction: str = "down"
    align: str = "centre"

    @property
    def open_time(self) -> float:
        """Seconds from when it begins to open to when it is closed, for each row of the picture."""
        return self.time / float(np.trapezoid(self.curve, dx=1.0 / (len(self.curve) - 1)) / max(self.curve))

    @property
    def begin(self) -> float:
        """Seconds from the frame's instant to when the middle row begins to be exposed."""
        return {"centre": -0.5, "start": 0.0, "end": -1.0}[self.align] * self.open_time

    @property
    def delay(self) -> float:
        """Seconds by which the bottom of the picture is later than its top."""
        return self.travel_time if self.direction == "down" else -self.travel_time

    def interval(self) -> tuple[float, float]:
        """Seconds from the frame's instant to the first and to the last light of the whole picture."""
        half = 0.5 * self.travel_time
        return self.begin - half, self.begin + self.open_time + half

    def quantiles(self) -> Float[np.ndarray, " q"]:
        """Seconds from the frame's instant at which even shares of the middle row's light are there."""
        where = np.linspace(0.0, 1.0, len(self.curve))
        # Light that has arrived grows as a parabola between two places of the curve: finely enough by
        # straight lines.
        fine = np.union1d(np.linspace(0.0, 1.0, 4 * _QUANTILES - 3), where)
        opened = np.interp(fine, where, self.curve)
        light = np.concatenate([[0.0], np.cumsum(0.5 * (opened[1:] + opened[:-1]) * np.diff(fine))])
        # A shutter that is closed for a while lets nothing pass then: of equal shares the last time counts.
        rising = np.concatenate([[True], np.diff(light) > 0])
        shares = np.linspace(0.0, 1.0, _QUANTILES) * light[-1]
        return self.begin + self.open_time * np.interp(shares, light[rising], fine[rising])


def make_shutter(
    time: float,
    *,
    ramp: float = 0.0,
    curve: Sequence[float] | None = None,
    travel_time: float = 0.0,
    direction: str = "down",
    align: str = "centre",
) -> Shutter:
    """A shutter with checked values.

    Args:
        time: seconds; see `Shutter`.
        ramp: share of `time`, 0 to 1, that the blades take to open, evenly, and to close again; 0 is a
            shutter that opens at once (box), 1 one that closes as soon as it is open.
        curve: instead of `ramp`, how far it is open at evenly spaced times, at least two numbers of any
            scale.
        travel_time: seconds that a focal-plane shutter takes over the picture (rolling shutter).
        direction: "down" or "up": the rows of the picture that come later.
        align: "centre", "start" or "end".

    Raises:
        ValueError: a time that is not positive and finite, or another value out of range.

    Example:
        >>> leaf = make_shutter(1 / 50, ramp=0.25)
        >>> round(leaf.open_time, 6)
        0.025
    """
    for what, value in (("time", time), ("travel time", travel_time), ("ramp", ramp)):
        real_number(value, f"the shutter's {what}", "a number, such as 0.02")
    if not 0 < time < np.inf:
        raise ValueError(
            f"the shutter time is {time} s; expected a positive, finite number of seconds such as 0.02, or no"
            " shutter at all for a picture of one instant"
        )
    if not 0 <= travel_time < np.inf:
        raise ValueError(
            f"the shutter's travel time is {travel_time} s; expected 0 or a positive number of seconds"
        )
    if not 0 <= ramp <= 1:
        raise ValueError(f"the shutter's ramp is {ramp}; expected a share of its time from 0 to 1")
    for name, value, known in (("direction", direction, DIRECTIONS), ("align", align, ALIGNMENTS)):
        if value not in known:
            raise ValueError(
                f"the shutter's {name} is {value!r}; expected one of {', '.join(map(repr, known))}"
            )
    if curve is None:
        opened = _trapezoid(ramp)
    elif ramp:
        raise ValueError("the shutter has a ramp and a curve; give one or the other")
    else:
        opened = tuple(float(value) for value in curve)
        if len(opened) < 2 or not np.isfinite(opened).all() or min(opened) < 0 or not max(opened) > 0:
            raise ValueError(
                f"the shutter's curve is {list(curve)}; expected two or more numbers of 0 or above, one of"
                " them above it"
            )
    return Shutter(float(time), opened, float(travel_time), direction, align)


def _trapezoid(ramp: float) -> tuple[float, ...]:
    """Open for the share `ramp` less than its time, and that long on the way there and back."""
    if ramp == 0:
        return (1.0, 1.0)
    if ramp == 1:
        return (0.0, 1.0, 0.0)
    places = np.linspace(0.0, 1.0, _QUANTILES)
    return tuple(float(v) for v in np.minimum(1.0, np.minimum(places, 1.0 - places) * (1.0 + ramp) / ramp))
