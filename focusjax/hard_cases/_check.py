"""What is looked at in a hard case: one number against a bound."""

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Check:
    """How far something is from the truth, and how far it may be.

    Attributes:
        group: "wishes", "pictures" or "glass".
        case: what is hard about it.
        quantity: what was computed, and in which precision.
        truth: what it was compared with.
        error: how far off it is, as a share of what `truth` says; NaN where a value was not finite.
        bound: the most that it may be off.
        why: what makes the bound wider than those of other cases.
        usual: the bound of other cases; an error beyond it is a known defect.
    """

    group: str
    case: str
    quantity: str
    truth: str
    error: float
    bound: float
    why: str = ""
    usual: float = math.inf

    @property
    def finite(self) -> bool:
        """Whether all that was computed is finite."""
        return math.isfinite(self.error)

    @property
    def kept(self) -> bool:
        """Whether the bound holds; never where something is not finite."""
        return self.error <= self.bound

    @property
    def verdict(self) -> str:
        """In words; a known defect is within its own bound and beyond the usual one."""
        if not self.finite:
            return "not finite"
        if not self.kept:
            return "broken"
        return "known defect" if self.error > self.usual else "kept"

    @property
    def share(self) -> float:
        """Error over bound: 1 is the edge, NaN where something is not finite."""
        return self.error / self.bound if self.bound else 0.0 if self.error == 0.0 else math.inf
