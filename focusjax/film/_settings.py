"""What a photographer sets on a camera, and what reaches the film with it."""

import math
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._arguments import real_number
from focusjax.film._photometry import (
    GREY,
    GREY_EXPOSURE,
    effective_f_number,
    exposure_value,
    illuminance,
    magnification,
)
from focusjax.geometry import Camera
from focusjax.lens import (
    CloseFocus,
    PrescriptionLens,
    ThinLens,
    TiltedPrescriptionLens,
    TiltShiftLens,
    lens_settings,
)

WIDEST_F_NUMBER = 0.5
"""The f-number at which light comes from all sides (Kyaw 2013 section 4.3)."""

SPEEDS = (1.0, 1e7)
"""ISO speeds between the slowest emulsions in use and the fastest sensors."""


class CameraSettings(eqx.Module):
    """Aperture, shutter and speed, and what the lens does to them. `camera_settings` makes one.

    Attributes:
        f_number: relative aperture N.
        time: seconds that the shutter is open.
        iso: arithmetic ISO speed.
        transmittance: share of the light that the glass lets through.
        magnification: size of the image over size of the subject, of what is in focus.
        pupil_magnification: diameter of the exit pupil over that of the entrance pupil.

    Example:
        >>> settings = fj.camera_settings(f_number=2, time=1 / 4, iso=100)
        >>> round(float(settings.exposure_value()), 6)
        4.0
    """

    f_number: Float[Array, ""]
    time: Float[Array, ""]
    iso: Float[Array, ""]
    transmittance: Float[Array, ""]
    magnification: Float[Array, ""]
    pupil_magnification: Float[Array, ""]

    def effective_f_number(self) -> Float[Array, ""]:
        """N (1 + m / P)."""
        return effective_f_number(self.f_number, self.magnification, self.pupil_magnification)

    def exposure_value(self) -> Float[Array, ""]:
        """EV at ISO 100, log2(N^2 / t) - log2(S / 100)."""
        return exposure_value(self.f_number, self.time, self.iso)

    def illuminance(self, luminance: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Lux on the axis for `luminance` in cd/m^2."""
        return luminance * illuminance(
            1.0,
            self.f_number,
            magnification=self.magnification,
            pupil_magnification=self.pupil_magnification,
            transmittance=self.transmittance,
        )

    def exposure(self, luminance: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """Lux seconds on the axis, H = E t (Kyaw 2013 eq. 4.1)."""
        return self.illuminance(luminance) * self.time

    def signal(self, luminance: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """What film of this speed makes of it, 0.018 S H: 0.18 is a metered grey and 1 white."""
        return self.exposure(luminance) * (self.iso * (GREY / GREY_EXPOSURE))


def camera_settings(
    *,
    f_number: SupportsFloat,
    time: SupportsFloat,
    iso: SupportsFloat = 100.0,
    transmittance: SupportsFloat = 1.0,
    magnification: SupportsFloat = 0.0,
    pupil_magnification: SupportsFloat = 1.0,
) -> CameraSettings:
    """`CameraSettings` with checked values.

    Raises:
        ValueError: a shutter time that is zero, infinite or below, a speed outside 1 to 10 000 000, an
            f-number below 0.5, a transmittance outside 0 to 1, or a magnification that is none.

    Example:
        >>> settings = camera_settings(f_number=2.8, time=1 / 60, iso=400)
        >>> round(float(settings.exposure_value()), 2)
        6.88
    """
    number = real_number(f_number, "the f-number", "a number, such as 2.8")
    seconds = real_number(time, "the shutter time", "seconds, such as 1 / 60")
    speed = real_number(iso, "the ISO speed", "a number, such as 400")
    if not WIDEST_F_NUMBER <= number < math.inf:
        raise ValueError(
            f"the f-number is {number:g}; expected a number from 0.5 on, where light comes from all sides,"
            " such as 2.8"
        )
    if not 0.0 < seconds < math.inf:
        raise ValueError(
            f"the shutter time is {seconds:g} s; expected a positive, finite time such as 1/60: a shutter"
            " that never opens, or never closes, exposes no picture"
        )
    require_iso(speed)
    if not 0.0 < float(transmittance) <= 1.0:
        raise ValueError(f"the transmittance is {float(transmittance):g}; expected above 0 and at most 1")
    if not 0.0 <= float(magnification) < math.inf:
        raise ValueError(f"the magnification is {float(magnification):g}; expected 0 or more, such as 0.5")
    if not 0.0 < float(pupil_magnification) < math.inf:
        raise ValueError(f"the pupil magnification is {float(pupil_magnification):g}; expected above 0")
    values = (number, seconds, speed, transmittance, magnification, pupil_magnification)
    return CameraSettings(*(jnp.asarray(float(value), dtype=float) for value in values))


def settings_through(
    lens: ThinLens | TiltShiftLens | PrescriptionLens | TiltedPrescriptionLens,
    camera: Camera,
    *,
    time: SupportsFloat,
    iso: SupportsFloat = 100.0,
    transmittance: SupportsFloat = 1.0,
    close_focus: CloseFocus = "ignored",
) -> CameraSettings:
    """`CameraSettings` with the f-number of a lens, and the light that it loses where it is focused.

    Args:
        lens: whose f-number and focus count.
        camera: the camera it stands in.
        time: seconds.
        iso: arithmetic ISO speed.
        transmittance: of the glass.
        close_focus: the model in which the f-number is set, for a camera with its sensor where a thin lens
            has its image; not of a real lens.

    Raises:
        ValueError: as `camera_settings`; a model of close focus for a real lens; a lens focused within its
            focal length; a pinhole.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2.8, focal_length=0.05)
        >>> settings = fj.settings_through(lens, camera, time=1 / 60)
        >>> round(float(settings.f_number), 3), round(float(settings.magnification), 4)
        (2.8, 0.0256)
    """
    pupils = (
        lens.pupil_magnification() if isinstance(lens, PrescriptionLens | TiltedPrescriptionLens) else 1.0
    )
    length, disparity = float(camera.focal_length), float(lens.focus_disparity)
    number = float(lens.f_number(camera))
    if math.isinf(number):
        raise ValueError("the lens is a pinhole, which has no f-number; open its aperture")
    if close_focus != "ignored":
        if isinstance(lens, PrescriptionLens | TiltedPrescriptionLens):
            raise ValueError(
                f"close_focus is {close_focus!r} and the lens is a {type(lens).__name__}, whose glass says"
                " what light is lost; leave close_focus out"
            )
        found = lens_settings(camera, lens, close_focus)
        values = float(found.f_number), float(found.magnification)
        return camera_settings(
            f_number=values[0], time=time, iso=iso, transmittance=transmittance, magnification=values[1]
        )
    # Focused beyond infinity the lens is nearer to the film by next to nothing.
    enlarged = float(magnification(length, max(disparity, 0.0), float(pupils)))
    if not enlarged >= 0.0:
        raise ValueError(
            f"the lens is focused {1 / disparity:g} m away, within its focal length {length:g} m; focus"
            " farther away"
        )
    return camera_settings(
        f_number=number,
        time=time,
        iso=iso,
        transmittance=transmittance,
        magnification=enlarged,
        pupil_magnification=float(pupils),
    )


def require_iso(speed: float) -> None:
    """Refuse what is no ISO speed.

    Raises:
        ValueError: it is outside `SPEEDS`.
    """
    if not SPEEDS[0] <= speed <= SPEEDS[1]:
        raise ValueError(f"the ISO speed is {speed:g}; expected from 1 to 10000000, such as 400")
