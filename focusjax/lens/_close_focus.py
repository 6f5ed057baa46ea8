"""Close focus: what image distance, f-number and framing have to do with each other near the lens.

A thin lens of focal length F that is focused on disparity w_f has its image at s = F / (1 - F w_f), with the
magnification m = s w_f. With an entrance pupil of radius A = F / (2 N), N the f-number that is set, the
circle of confusion of a point at disparity w has on the sensor the diameter

    2 s A |w_f - w| = F s / N |w_f - w|        (Lee09 eq. 1 and 3, 2006 eq. 5, Kyaw 2013 eq. 5.4).

A `Camera` whose focal length is s, with a `ThinLens` of radius A, has just this blur. Its `f_number`,
s / (2 A) = N (1 + m), is the working f-number, which gives the light on the sensor. The models of close focus
differ in what stays as the focus moves:

- "framing": the image distance, and with it the picture's framing. The focal length F = s / (1 + s w_f)
  falls, as in a lens of internal focusing.
- "breathing": the focal length. The lens moves away from the sensor, and the picture grows.
- "ignored": both, which no lens does. N is s / (2 A), and exposure is by N (1 + m) with F = s.

With N held, blur is linear in the focus setting v = 1 / (d + k), d the focus distance, k = s for framing and
-F for breathing: v is one over the distance from the sensor, or from the front focal point (Newton's form).
With f the stated length and E = f / (2 N),

    blur = 2 f E (v (1 + k w) - w),        w_f = v / (1 - k v).
"""

import dataclasses
from typing import Literal, SupportsFloat, TypeAlias, get_args

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._arguments import ArgumentError
from focusjax.geometry import Camera
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._thin import ThinLens, thin_lens
from focusjax.lens._tilt_shift import TiltShiftLens

CloseFocus: TypeAlias = Literal["ignored", "framing", "breathing"]
"""What the model of close focus holds as the focus moves; see this module."""


class LensSettings(eqx.Module):
    """What a photographer reads off a lens that is focused. `lens_settings` makes one.

    Attributes:
        focal_length: F in metres.
        image_distance: s in metres, from the lens to the sensor; F where close focus is ignored.
        f_number: N, as it is set.
        magnification: m, size of the image over size of the subject, of what is in focus.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=0.05)
        >>> near, lens = fj.close_focus_lens(camera, "breathing", focus_distance=0.1, f_number=4)
        >>> settings = fj.lens_settings(near, lens, "breathing")
        >>> [round(float(value), 6) for value in (settings.f_number, settings.working_f_number())]
        [4.0, 8.0]
    """

    focal_length: Float[Array, ""]
    image_distance: Float[Array, ""]
    f_number: Float[Array, ""]
    magnification: Float[Array, ""]

    def working_f_number(self) -> Float[Array, ""]:
        """N (1 + m), by which the light on the sensor goes (Kyaw 2013 eq. 4.5)."""
        return self.f_number * (1.0 + self.magnification)


class FocusScale(eqx.Module):
    """The setting v of the focus in which blur at a fixed f-number is linear; see this module.

    Attributes:
        offset: k in metres.
    """

    offset: Float[Array, ""]

    def setting(self, disparity: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The setting that focuses on a disparity."""
        return disparity / (1.0 + self.offset * disparity)

    def disparity(self, setting: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """The disparity that a setting focuses on."""
        return setting / (1.0 - self.offset * setting)

    def gain(self, disparity: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """How much more blur at a disparity follows the setting than blur at infinity does."""
        return 1.0 + self.offset * disparity

    def share(self, setting: Float[Array, ""]) -> Float[Array, ""]:
        """Pupil radius times image distance, over what they are with the focus at infinity."""
        return 1.0 - self.offset * setting


def focus_scale(camera: Camera, close_focus: CloseFocus) -> FocusScale:
    """The scale of a camera of the stated length; not for "ignored".

    Raises:
        ArgumentError: no model of close focus.
    """
    require_close_focus(close_focus)
    return FocusScale(camera.focal_length if close_focus == "framing" else -camera.focal_length)


def require_close_focus(close_focus: object) -> None:
    """Refuse what is no model of close focus.

    Raises:
        ArgumentError: says which there are.
    """
    known = get_args(CloseFocus)
    if not isinstance(close_focus, str) or close_focus not in known:
        expected = ", ".join(repr(each) for each in known)
        raise ArgumentError(f"close_focus is {close_focus!r}; expected one of {expected}", "close_focus")


def at_image_distance(camera: Camera, focus_disparity: Float[Array, ""], close_focus: CloseFocus) -> Camera:
    """The camera with its sensor where the lens has its image, from the camera of the stated length.

    Only with "breathing" does that differ. Differentiable.

    Args:
        camera: whose focal length is as it is stated: the lens's own with "breathing", else the image
            distance.
        focus_disparity: 1 / focus distance, in 1/m.
        close_focus: the model.
    """
    require_close_focus(close_focus)
    if close_focus != "breathing":
        return camera
    length = camera.focal_length
    return dataclasses.replace(camera, focal_length=length / (1.0 - length * focus_disparity))


def close_focus_lens(
    camera: Camera,
    close_focus: CloseFocus,
    *,
    focus_distance: SupportsFloat,
    f_number: SupportsFloat,
    aperture: AbstractAperture | None = None,
) -> tuple[Camera, ThinLens]:
    """The camera and the thin lens of what is set on a lens; `lens_settings` is the way back.

    Differentiable in focus distance, f-number and focal length.

    Args:
        camera: whose focal length is as it is stated: the lens's own with "breathing", else the image
            distance.
        close_focus: the model.
        focus_distance: metres from the lens; `inf` is allowed.
        f_number: as it is set.
        aperture: shape of the opening; a disk when not given.

    Returns:
        The camera with its sensor where the lens has its image, and the lens in it.

    Raises:
        ArgumentError: another model.
        ValueError: a value out of range, or a focus distance within the focal length.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=0.05)
        >>> near, lens = fj.close_focus_lens(camera, "breathing", focus_distance=0.5, f_number=2)
        >>> blur = lens.blur(near, near.principal_point, jnp.asarray(1.0))  # here a pixel is a millimetre
        >>> round(float(blur), 3), round(1000 * float(near.focal_length), 2)
        (1.389, 55.56)
    """
    require_close_focus(close_focus)
    length = camera.focal_length
    if close_focus == "framing":
        checked = thin_lens(focus_distance=focus_distance, aperture_radius=0.0)
        length = length / (1.0 + length * checked.focus_disparity)
    lens = thin_lens(focus_distance=focus_distance, focal_length=length, f_number=f_number, aperture=aperture)
    return at_image_distance(camera, lens.focus_disparity, close_focus), lens


def lens_settings(
    camera: Camera, lens: ThinLens | TiltShiftLens, close_focus: CloseFocus = "ignored"
) -> LensSettings:
    """What a photographer reads off a lens. Differentiable.

    Args:
        camera: with its sensor where the lens has its image, as `close_focus_lens` and `solve` return it.
        lens: whose focus counts on the view axis.
        close_focus: the model.

    Raises:
        ArgumentError: another model.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=0.05)
        >>> _, lens = fj.close_focus_lens(camera, "framing", focus_distance=0.05, f_number=2)
        >>> settings = fj.lens_settings(camera, lens, "framing")
        >>> [round(1000 * float(value), 3) for value in (settings.focal_length, settings.magnification)]
        [25.0, 1000.0]
    """
    require_close_focus(close_focus)
    distance, number = camera.focal_length, lens.f_number(camera)
    # Focused beyond infinity the lens is nearer to the sensor by next to nothing.
    focus = jnp.maximum(lens.focus_disparity, 0.0)
    if close_focus == "ignored":
        enlarged = distance * focus / (1.0 - distance * focus)
        return LensSettings(distance, distance, number, enlarged)
    enlarged = distance * focus
    return LensSettings(distance / (1.0 + enlarged), distance, number / (1.0 + enlarged), enlarged)
