"""Photometry of a camera: from the luminance of a scene to the light on the film, and what meters say of it.

Luminance is in cd/m^2, illuminance in lux, exposure in lux seconds, times in seconds, lengths in metres, and
speeds are arithmetic ISO speeds. All of it is differentiable, and everything broadcasts.

The picture of a lens is radiance that its film point sees (1 on the axis for a scene of 1), so that the
illuminance of a pixel is its value times that of radiance 1 on the axis.
"""

import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

GREY = 0.18
"""The signal, and the reflectance, of a metered grey."""

GREY_EXPOSURE = 10.0
"""Lux seconds times ISO speed that make a metered grey: standard output sensitivity (ISO 12232)."""

SATURATION = 78.0 * GREY / GREY_EXPOSURE
"""The signal at which a sensor is full: saturation-based speed is 78 / H (ISO 12232), 0.49 stops above 1."""

METER_CONSTANT = 12.5
"""K of reflected-light meters: N^2 / t = L S / K (ISO 2720), within 0.03 stops of `GREY_EXPOSURE`."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""How much linear red, green and blue count (ITU-R BT.709)."""


def illuminance(
    luminance: ArrayLike,
    f_number: ArrayLike,
    *,
    magnification: ArrayLike = 0.0,
    pupil_magnification: ArrayLike = 1.0,
    transmittance: ArrayLike = 1.0,
    angle: ArrayLike = 0.0,
    passed: ArrayLike = 1.0,
) -> Array:
    """Lux on the film (Kyaw 2013 eq. 4.9): V pi T L cos(angle)^4 / (4 N^2 (1 + m / P)^2).

    His eq. 4.6, T L / (4 N^2), is this on the axis and focused on infinity, with L in 1 / pi cd/m^2.

    Args:
        luminance: L of the scene in cd/m^2.
        f_number: N, relative aperture.
        magnification: m >= 0, size of the image over size of the subject; see `magnification`.
        pupil_magnification: P, diameter of the exit pupil over that of the entrance pupil.
        transmittance: T of the glass.
        angle: between the axis and the ray through the middle of the entrance pupil, in radians.
        passed: V, share of the opening that vignetting leaves.

    Example:
        >>> round(float(illuminance(4000.0, 2.0)), 1)
        785.4
    """
    number = effective_f_number(f_number, magnification, pupil_magnification)
    lit = jnp.asarray(passed) * transmittance * luminance * jnp.cos(angle) ** 4
    return jnp.pi / 4.0 * lit / number**2


def effective_f_number(
    f_number: ArrayLike,
    magnification: ArrayLike = 0.0,
    pupil_magnification: ArrayLike = 1.0,
) -> Array:
    """N' = N (1 + m / P), the f-number that exposes as the lens does when it is focused closer (eq. 4.5).

    Of a symmetrical lens it is v / e, the distance of the film over the diameter of the entrance pupil.

    Example:
        >>> float(effective_f_number(4.0, 1.0))
        8.0
    """
    return jnp.asarray(f_number) * (1.0 + jnp.asarray(magnification) / pupil_magnification)


def magnification(
    focal_length: ArrayLike,
    focus_disparity: ArrayLike,
    pupil_magnification: ArrayLike = 1.0,
) -> Array:
    """Size of the image over size of the subject, m = f w / (1 - f w / P); the sign is left out.

    The entrance pupil is f / P behind the front focal point, and m is f over the subject's distance from
    there (Kyaw 2013 eq. 3.3).

    Args:
        focal_length: f in metres.
        focus_disparity: w in 1/m, one over the focus distance from the entrance pupil; 0 is infinity.
        pupil_magnification: P.

    Example:
        >>> round(float(magnification(0.05, 10.0)), 6)
        1.0
    """
    w = jnp.asarray(focal_length) * focus_disparity
    return w / (1.0 - w / pupil_magnification)


def f_number_of_area(focal_length: ArrayLike, area: ArrayLike) -> Array:
    """The f-number f / (2 sqrt(A / pi)) of an entrance pupil that is not round (eq. 4.4)."""
    return jnp.asarray(focal_length) / (2.0 * jnp.sqrt(jnp.asarray(area) / jnp.pi))


def equivalent_time(time: ArrayLike, f_number: ArrayLike, other: ArrayLike) -> Array:
    """The time that exposes at f-number `other` as `time` does at `f_number`: t2 = t1 N2^2 / N1^2 (eq. 4.13).

    Raises:
        ValueError: one of the three is not above 0, and not traced by JAX.

    Example:
        >>> round(1 / float(equivalent_time(1 / 60, 2.0, 4.0)), 6)
        15.0
    """
    for what, value in (("time", time), ("f-number", f_number), ("other f-number", other)):
        if not isinstance(value, Tracer) and not (jnp.asarray(value) > 0.0).all():
            raise ValueError(f"the {what} is {value}; expected above 0")
    return jnp.asarray(time) * (jnp.asarray(other) / f_number) ** 2


def exposure_value(f_number: ArrayLike, time: ArrayLike, iso: ArrayLike = 100.0) -> Array:
    """EV = log2(N^2 / t) - log2(S / 100): the light value, at ISO 100, that the settings are right for.

    Example:
        >>> round(float(exposure_value(8.0, 1 / 64)), 6)
        12.0
    """
    return 2.0 * jnp.log2(f_number) - jnp.log2(time) - jnp.log2(jnp.asarray(iso) / 100.0)


def light_value(luminance: ArrayLike) -> Array:
    """The exposure value at ISO 100 that a reflected-light meter reads off `luminance` in cd/m^2.

    Example:
        >>> round(float(light_value(4096.0)), 6)
        15.0
    """
    return jnp.log2(jnp.asarray(luminance) * (100.0 / METER_CONSTANT))


def luminance_of_light_value(value: ArrayLike) -> Array:
    """The luminance of radiance 1, in cd/m^2, where a meter reads `value` off a grey of radiance 0.18.

    Sunlight is about 15, an overcast day 12, a lit room 7, a street at night 3.

    Example:
        >>> round(0.18 * float(fj.luminance_of_light_value(12.0)), 3)  # a grey: 2**12 / 8
        512.0
    """
    return 2.0 ** jnp.asarray(value) * (METER_CONSTANT / 100.0 / GREY)


def brightness(image: Float[Array, "*n 3"]) -> Float[Array, "*n"]:
    """Relative luminance of linear RGB."""
    return image @ jnp.asarray(LUMINANCE, dtype=image.dtype)
