"""Automatic exposure: the shutter time and the ISO speed that expose a grey as a grey."""

import dataclasses
from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax.film._exposing import ISO_RANGE, LONGEST, SHORTEST, exposing
from focusjax.film._settings import CameraSettings

_LIMITS = ("longest time", "shortest time", "lowest ISO speed", "highest ISO speed")


class ChosenSettings(eqx.Module):
    """Settings that `choose_settings` found.

    Attributes:
        settings: with their time and speed.
        stops_off: log2 of the exposure over that which was wanted; below 0 the picture is too dark.
        at_limit: [4] whether the longest and the shortest time, the lowest and the highest speed keep it from
            being right.
    """

    settings: CameraSettings
    stops_off: Float[Array, ""]
    at_limit: Bool[Array, "4"]

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
    longest_time: SupportsFloat = LONGEST,
    shortest_time: SupportsFloat = SHORTEST,
    iso_range: tuple[SupportsFloat, SupportsFloat] = ISO_RANGE,
) -> ChosenSettings:
    """The time and the speed that expose radiance `grey` as a metered grey, at the settings' f-number.

    The speed stays as low as the longest time allows, since it brings noise; what is not free stays as it is.
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
        ValueError: a grey that is black or not finite, no such setting, or limits that are none.

    Example:
        >>> settings = camera_settings(f_number=2.0, time=1, iso=100)
        >>> chosen = choose_settings(0.18, settings, luminance=100.0).settings
        >>> round(1 / float(chosen.time), 3), round(float(chosen.iso), 1)
        (60.0, 169.8)
    """
    asked = exposing(
        grey, settings, luminance=luminance, free=free, compensation=compensation,
        longest_time=longest_time, shortest_time=shortest_time, iso_range=iso_range,
    )  # fmt: skip
    time, iso, needed = settings.time, settings.iso, asked.needed
    if "time" in free:
        time = jnp.clip(needed / asked.speeds[0], *asked.times)
    if "iso" in free:
        iso = jnp.clip(needed / time, *asked.speeds)
    off = jnp.log2(time * iso / needed)
    dark, bright = off < -1e-3, off > 1e-3
    timed, rated = "time" in free, "iso" in free
    reached = jnp.stack([dark & timed, bright & timed, bright & rated, dark & rated])
    return ChosenSettings(dataclasses.replace(settings, time=time, iso=iso), off, reached)
