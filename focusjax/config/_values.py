"""The kinds of value a config holds, and what all its tables have in common."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
# TOML arrays arrive as lists; only the numbers inside them are checked strictly.
Vector = Annotated[tuple[Number, Number, Number], Strict(False)]
Radiance = Annotated[float, Field(ge=0, le=1e15)]
"""Linear light, of which squares and sums of squares fit single precision."""
Colour = Annotated[tuple[Radiance, Radiance, Radiance], Strict(False)]
Light = Radiance | Colour
"""Linear light: one number for a grey, or three for red, green and blue."""
Millimetres = Annotated[float, Field(ge=0.1, allow_inf_nan=False)]
"""A lens or sensor length: anything below 0.1 mm is a length in metres under the wrong key."""


def seconds_of(value: Any) -> Any:
    """Seconds from text such as 1/60, which is how shutters are engraved; other values as they are."""
    if not isinstance(value, str):
        return value
    over, slash, under = value.partition("/")
    try:
        return float(over) / (float(under) if slash else 1.0)
    except (ValueError, ZeroDivisionError):
        raise ValueError(f'is "{value}"; expected seconds, such as "1/60" or 0.5') from None


Time = Annotated[Positive, BeforeValidator(seconds_of)]


class Table(BaseModel):
    """A table of the config: keys it does not know are refused, and nothing is converted silently.

    Each field's description completes the sentence "give ...", which error messages use as remedy.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
