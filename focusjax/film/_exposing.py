"""What a chosen exposure may use: the light that is needed, and the ends of times and speeds."""

import dataclasses
import math
from collections.abc import Sequence
from typing import SupportsFloat

import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from focusjax.film._photometry import GREY
from focusjax.film._settings import CameraSettings, require_iso

LONGEST = 1 / 60
"""Seconds; the longest time that may be chosen when nothing is said."""

SHORTEST = 1 / 8000
"""Seconds; the shortest."""

ISO_RANGE = (100.0, 6400.0)
"""Lowest and highest ISO speed that may be chosen when nothing is said."""


@dataclasses.dataclass(frozen=True)
class Exposing:
    """An exposure that is to be chosen, checked.

    Attributes:
        needed: time x speed, in ISO seconds, that makes the grey a grey at the settings' f-number.
        times: shortest and longest time in seconds; both the settings' own where it is not free.
        speeds: lowest and highest ISO speed; both the settings' own where it is not free.
    """

    needed: Float[Array, ""]
    times: tuple[ArrayLike, ArrayLike]
    speeds: tuple[ArrayLike, ArrayLike]


def exposing(
    grey: ArrayLike,
    settings: CameraSettings,
    *,
    luminance: SupportsFloat,
    free: Sequence[str],
    compensation: SupportsFloat,
    longest_time: SupportsFloat,
    shortest_time: SupportsFloat,
    iso_range: tuple[SupportsFloat, SupportsFloat],
) -> Exposing:
    """Arguments as of `choose_settings`, checked.

    Raises:
        ValueError: as `choose_settings`.
    """
    light = _positive(luminance, "luminance of radiance 1", "cd/m^2 above 0, such as 4000")
    unknown = [name for name in free if name not in ("time", "iso")]
    if unknown or not free or isinstance(free, str):
        raise ValueError(f"free is {free!r}; expected some of ('time', 'iso')")
    longest = _positive(longest_time, "longest time", "seconds above 0, such as 1/60")
    shortest = _positive(shortest_time, "shortest time", "seconds above 0, such as 1/8000")
    slowest, fastest = (float(each) for each in iso_range)
    require_iso(slowest)
    require_iso(fastest)
    for what, least, most in (("time", shortest, longest), ("ISO speed", slowest, fastest)):
        if least > most:
            raise ValueError(f"the range of the {what} is from {least:g} to {most:g}; swap the two")
    if not isinstance(grey, Tracer) and not 0.0 < float(jnp.asarray(grey)) < math.inf:
        raise ValueError(
            f"the metered radiance is {float(jnp.asarray(grey)):g}, for which no settings are right; meter"
            " where there is light"
        )
    # The exposure's part that is settled.
    settled = settings.signal(jnp.asarray(grey) * light) / (settings.time * settings.iso)
    return Exposing(
        needed=GREY * 2.0 ** float(compensation) / settled,
        times=(shortest, longest) if "time" in free else (settings.time, settings.time),
        speeds=(slowest, fastest) if "iso" in free else (settings.iso, settings.iso),
    )


def _positive(value: SupportsFloat, what: str, expected: str) -> float:
    number = float(value)
    if not 0.0 < number < math.inf:
        raise ValueError(f"the {what} is {number:g}; expected {expected}")
    return number
