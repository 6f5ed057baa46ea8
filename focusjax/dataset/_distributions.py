"""Numbers that are drawn: their tables in a spec, their checks, and the drawing."""

import json
import math
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
import scipy.special
from pydantic import AfterValidator, BeforeValidator, Field, Strict, model_validator

from focusjax.config import Table

_KINDS = ("uniform", "log_uniform", "choice", "normal")
_SUCH_AS = "give a number, or a table such as {uniform = [1, 2]}"
_LEAST_SHARE = 1e-6
"""Of a normal distribution that has to be within its bounds."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Pair = Annotated[tuple[Number, Number], Strict(False)]


class Distribution(Table):
    """One of four distributions; a plain number in a spec is a choice of one."""

    uniform: Pair | None = Field(default=None, description="its two ends, such as [1, 2]")
    log_uniform: Pair | None = Field(
        default=None, description="two ends above 0, such as [1, 16], between which the logarithm is uniform"
    )
    choice: Annotated[tuple[Number, ...], Strict(False), Field(min_length=1)] | None = Field(
        default=None, description="the numbers to choose from, such as [1.4, 2, 2.8]"
    )
    normal: Pair | None = Field(default=None, description="mean and standard deviation, such as [0, 3]")
    within: Pair | None = Field(
        default=None, description="the two ends that a normal distribution is cut off at, such as [-9, 9]"
    )

    @model_validator(mode="after")
    def _possible(self) -> "Distribution":
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            said = " and ".join(given) or "no distribution"
            raise ValueError(f"has {said}; expected one of {', '.join(_KINDS)}")
        for name in ("uniform", "log_uniform", "within"):
            ends = getattr(self, name)
            if ends is not None and ends[0] > ends[1]:
                raise ValueError(
                    f"has {name} = {_shown(ends)}, from the larger to the smaller; exchange the two"
                )
        if self.log_uniform is not None and self.log_uniform[0] <= 0:
            raise ValueError(
                f"has log_uniform = {_shown(self.log_uniform)}; expected two ends above 0, or uniform"
            )
        if (self.normal is None) != (self.within is None):
            raise ValueError(
                "has normal without within, or within without normal; give both, such as"
                " {normal = [0, 3], within = [-9, 9]}"
            )
        if self.normal is not None:
            if self.normal[1] <= 0:
                raise ValueError(
                    f"has normal = {_shown(self.normal)}, whose second is the standard deviation; expected"
                    " one above 0"
                )
            below, above = self._shares()
            if above - below < _LEAST_SHARE:
                raise ValueError(
                    f"has normal = {_shown(self.normal)}, which is hardly ever within"
                    f" {_shown(self.within)}; move the mean there, or widen within"
                )
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the largest number that can be drawn."""
        if self.choice is not None:
            return min(self.choice), max(self.choice)
        ends = self.uniform or self.log_uniform or self.within
        assert ends is not None
        return ends

    @property
    def whole(self) -> bool:
        """Whether it is for whole numbers: a choice of such, or uniform with such ends."""
        values = self.choice or self.uniform
        return values is not None and all(value == int(value) for value in values)

    def draw(self, random: np.random.Generator) -> float:
        """A number; it takes one from the generator, whatever the distribution."""
        share = random.uniform()
        if self.choice is not None:
            return float(self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)])
        low, high = self.ends
        if self.uniform is not None:
            return low + share * (high - low)
        if self.log_uniform is not None:
            return min(max(math.exp(math.log(low) + share * math.log(high / low)), low), high)
        assert self.normal is not None
        below, above = self._shares()
        mean, deviation = self.normal
        value = mean + deviation * float(scipy.special.ndtri(below + share * (above - below)))
        return min(max(value, low), high)

    def draw_whole(self, random: np.random.Generator) -> int:
        """A whole number, both ends of a uniform distribution as often as others."""
        if self.uniform is None:
            return int(self.draw(random))
        low, high = (int(end) for end in self.uniform)
        return min(low + int(random.uniform() * (high - low + 1)), high)

    def _shares(self) -> tuple[float, float]:
        """The shares of the normal distribution below the two ends of `within`."""
        assert self.normal is not None
        assert self.within is not None
        mean, deviation = self.normal
        below, above = (float(scipy.special.ndtr((end - mean) / deviation)) for end in self.within)
        return below, above


def _as_table(value: Any) -> Any:
    """A plain number as a choice of one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return {"choice": [value]}
    if not isinstance(value, dict | Distribution):
        raise ValueError(f"is {json.dumps(value, default=str)}; {_SUCH_AS}")
    return value


def _between(low: float, high: float, unit: str) -> Callable[[Distribution], Distribution]:
    expected = f"from {low:g} to {high:g}{unit}"

    def check(drawn: Distribution) -> Distribution:
        for end in drawn.ends:
            if not low <= end <= high:
                raise ValueError(f"may be {end:g}{unit}; expected numbers {expected}")
        return drawn

    return check


def _whole(drawn: Distribution) -> Distribution:
    if not drawn.whole:
        raise ValueError(
            "is of numbers that may not be whole; give a whole number, a choice of such, or uniform with such"
            " ends"
        )
    return drawn


def drawn(low: float, high: float, unit: str = "") -> Any:
    """The type of a key that is drawn and may be from `low` to `high`."""
    return Annotated[Distribution, BeforeValidator(_as_table), AfterValidator(_between(low, high, unit))]


def drawn_whole(low: int, high: int) -> Any:
    """The type of a key that is a whole number, and drawn."""
    checks = AfterValidator(_whole), AfterValidator(_between(low, high, ""))
    return Annotated[Distribution, BeforeValidator(_as_table), *checks]


def uniform(low: float, high: float) -> Distribution:
    """As `{uniform = [low, high]}`."""
    return Distribution(uniform=(low, high))


def log_uniform(low: float, high: float) -> Distribution:
    """As `{log_uniform = [low, high]}`."""
    return Distribution(log_uniform=(low, high))


def always(value: float) -> Distribution:
    """As a plain number."""
    return Distribution(choice=(value,))


def _shown(values: Any) -> str:
    return "[" + ", ".join(f"{value:g}" for value in values) + "]"
