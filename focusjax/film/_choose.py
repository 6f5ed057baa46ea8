"""Automatic exposure: the shutter time and the ISO speed that expose a grey as a grey."""

import dataclasses
import math
from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._arguments import real_number
from focusjax.film._photometry import GREY
from focusjax.film._settings import CameraSettings, require_iso

_LONGEST = 1 / 60
"""Seconds; the longest time that may be chosen when nothing is said."""

_SHORTEST = 1 / 8000
"""Seconds; the shortest."""

_ISO_RANGE = (100.0, 6400.0)
"""Lowest and highest ISO speed that may be chosen when nothing is said."""

MOST_STOPS = 50.0
"""By which a picture may be wished brighter or darker than metered: more is a slip."""

_LIMITS = ("longest time", "shortest time", "lowest ISO speed", "highest ISO speed")


class FNumbersForLight(eqx.Module):
    """What the light leaves of the aperture: N^2 is in proportion to time x speed.

    Attributes:
        widest: f-number below which the picture is too bright at the shortest time and the lowest speed.
        narrowest: f-number above which it is too dark at the longest time and the highest speed.
        quietest: f-number up to which the lowest speed does, at the longest time.
    """

    widest: Float[Array, ""]
    narrowest: Float[Array, ""]
    quietest: Float[Array, ""]


class ChosenSettings(eqx.Module):
    """Settings that `choose_settings` found.

    Attributes:
        settings: with their time and speed.
        stops_off: log2 of the exposure over that which was wanted; below 0 the picture is too dark.
        at_limit: [4] whether the longest and the shortest time, the lowest and the highest speed keep it from
            being right.
        f_numbers: those at which other times and speeds within the limits would be right, focused where the
            settings are.
    """

    settings: CameraSettings
    stops_off: Float[Array, ""]
    at_limit: Bool[Array, "4"]
    f_numbers: FNumbersForLight

    @property
    def limits(self) -> tuple[str, ...]:
        """The limits in the way, in words; none when the exposure is right."""
        return tuple(name for name, reached in zip(_LIMITS, self.at_limit.tolist(), strict=True) if reached)

    def right_f_number(self) -> Float[Array, ""]:
        """The f-number at which time and speed would expose rightly."""
        return self.settings.f_number * 2.0 ** (0.5 * self.stops_off)


def choose_settings(
    grey: ArrayLike,
    settings: CameraSettings,
    *,
    luminance: SupportsFloat,
    free: Sequence[str] = ("time", "iso"),
    compensation: SupportsFloat = 0.0,
    longest_time: SupportsFloat = _LONGEST,
    shortest_time: SupportsFloat = _SHORTEST,
    iso_range: tuple[SupportsFloat, SupportsFloat] = _ISO_RANGE,
) -> ChosenSettings:
    """The time and the speed that expose radiance `grey` as a metered grey, at the settings' f-number.

    The speed stays as low as the longest time allows, since it adds noise; what is not free stays as it is.
    Where the limits leave the exposure wrong, it is as near as they let it. Differentiable in `grey` and the
    settings, with derivative 0 of what is at a limit.

    Args:
        grey: radiance, such as `meter` gives.
        settings: the f-number, the lens's losses, and the values of what is not free.
        luminance: cd/m^2 of radiance 1.
        free: of "time" and "iso".
        compensation: stops by which the picture is to be brighter.
        longest_time: seconds; a hand holds about one over the focal length in millimetres.
        shortest_time: seconds.
        iso_range: lowest and highest ISO speed.

    Raises:
        ValueError: a grey that is black or not finite, no such setting, limits that are none, or a
            compensation by more than 50 stops.

    Example:
        >>> settings = fj.camera_settings(f_number=2.0, time=1, iso=100)
        >>> chosen = choose_settings(0.18, settings, luminance=100.0).settings
        >>> round(1 / float(chosen.time), 3), round(float(chosen.iso), 1)
        (60.0, 169.8)
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
    stops = real_number(compensation, "the compensation", "stops, such as -0.5")
    if not abs(stops) <= MOST_STOPS:
        raise ValueError(f"the compensation is {stops:g} stops; expected at most {MOST_STOPS:g}, such as 0.5")
    # Time x speed that is needed, and the exposure's part that is settled.
    settled = settings.signal(jnp.asarray(grey) * light) / (settings.time * settings.iso)
    needed = GREY * 2.0**stops / settled
    timed, rated = "time" in free, "iso" in free
    # Only the settings' own is there to choose of what is not free.
    times = (shortest, longest) if timed else (settings.time, settings.time)
    speeds = (slowest, fastest) if rated else (settings.iso, settings.iso)
    time = jnp.clip(needed / speeds[0], *times) if timed else settings.time
    iso = jnp.clip(needed / time, *speeds) if rated else settings.iso
    off = jnp.log2(time * iso / needed)
    dark, bright = off < -1e-3, off > 1e-3

    def right_at(time: ArrayLike, iso: ArrayLike) -> Float[Array, ""]:
        return settings.f_number * jnp.sqrt(jnp.asarray(time) * iso / needed)

    return ChosenSettings(
        dataclasses.replace(settings, time=time, iso=iso),
        off,
        jnp.stack([dark & timed, bright & timed, bright & rated, dark & rated]),
        FNumbersForLight(
            widest=right_at(times[0], speeds[0]),
            narrowest=right_at(times[1], speeds[1]),
            quietest=right_at(times[1], speeds[0]),
        ),
    )


def _positive(value: SupportsFloat, what: str, expected: str) -> float:
    number = float(value)
    if not 0.0 < number < math.inf:
        raise ValueError(f"the {what} is {number:g}; expected {expected}")
    return number
