"""The f-numbers at which there is a time and a speed that expose rightly."""

from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from focusjax.film._exposing import ISO_RANGE, LONGEST, SHORTEST, exposing
from focusjax.film._settings import CameraSettings


class FNumbersForLight(eqx.Module):
    """What the light leaves of the aperture. `f_numbers_for_light` makes one.

    Attributes:
        widest: f-number below which the picture is too bright at the shortest time and the lowest speed.
        narrowest: f-number above which it is too dark at the longest time and the highest speed.
        quietest: f-number up to which the lowest speed does, at the longest time.
    """

    widest: Float[Array, ""]
    narrowest: Float[Array, ""]
    quietest: Float[Array, ""]


def f_numbers_for_light(
    grey: ArrayLike,
    settings: CameraSettings,
    *,
    luminance: SupportsFloat,
    free: Sequence[str] = ("time", "iso"),
    compensation: SupportsFloat = 0.0,
    longest_time: SupportsFloat = LONGEST,
    shortest_time: SupportsFloat = SHORTEST,
    iso_range: tuple[SupportsFloat, SupportsFloat] = ISO_RANGE,
) -> FNumbersForLight:
    """The f-numbers at which `choose_settings` exposes radiance `grey` rightly.

    N^2 is in proportion to time x speed: the ends of these are ends of the f-number, focused where the
    settings are. Differentiable in `grey` and the settings.

    Args:
        grey: radiance that is to be a grey.
        settings: the lens's losses, the values of what is not free, and any f-number.
        luminance: cd/m^2 of radiance 1.
        free: of "time" and "iso".
        compensation: stops by which the picture is to be brighter.
        longest_time: seconds.
        shortest_time: seconds.
        iso_range: lowest and highest ISO speed.

    Raises:
        ValueError: as `choose_settings`.

    Example:
        >>> from focusjax.film import camera_settings
        >>> settings = camera_settings(f_number=8, time=1, iso=100)
        >>> found = f_numbers_for_light(0.18, settings, luminance=100.0)
        >>> round(float(found.quietest), 2), round(float(found.narrowest / found.quietest), 6)
        (1.53, 8.0)
    """
    asked = exposing(
        grey, settings, luminance=luminance, free=free, compensation=compensation,
        longest_time=longest_time, shortest_time=shortest_time, iso_range=iso_range,
    )  # fmt: skip
    per_root = settings.f_number / jnp.sqrt(asked.needed)
    (shortest, longest), (slowest, fastest) = asked.times, asked.speeds
    return FNumbersForLight(
        widest=per_root * jnp.sqrt(jnp.asarray(shortest) * slowest),
        narrowest=per_root * jnp.sqrt(jnp.asarray(longest) * fastest),
        quietest=per_root * jnp.sqrt(jnp.asarray(longest) * slowest),
    )
