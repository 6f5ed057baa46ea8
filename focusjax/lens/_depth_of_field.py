"""Depth of field: the range of distances that a lens has in focus, and the lens that has a range."""

import math
from dataclasses import dataclass
from typing import SupportsFloat

from focusjax._arguments import real_number, real_numbers
from focusjax.geometry import Camera
from focusjax.lens._close_focus import CloseFocus, lens_settings
from focusjax.lens._thin import ThinLens, thin_lens
from focusjax.lens._tilt_shift import TiltShiftLens

DIAGONAL_SHARE = 1 / 1500
"""Customary circle of confusion: this share of the sensor's diagonal."""


@dataclass(frozen=True)
class DepthOfField:
    """Where blur stays within a circle of confusion.

    Attributes:
        circle_mm: diameter of the circle on the sensor in millimetres.
        circle_px: the same in output pixels.
        near: nearest sharp distance in metres.
        far: farthest sharp distance in metres; infinite when everything behind is sharp.
        hyperfocal: focus distance in metres from which everything to infinity is just sharp.
    """

    circle_mm: float
    circle_px: float
    near: float
    far: float
    hyperfocal: float


def depth_of_field(
    camera: Camera, lens: ThinLens | TiltShiftLens, close_focus: CloseFocus = "ignored"
) -> DepthOfField:
    """The range of distances whose blur 2 f E |w_f - w| is at most the customary circle of confusion c.

    In disparity it is w_f +- c / (2 f E), and the hyperfocal disparity is c / (2 f E).
    Distances are along the view axis, wherever a tilted lens has its focus elsewhere.

    Args:
        camera: with its sensor where the lens has its image.
        lens: whose focus counts on the view axis.
        close_focus: what stays as the focus moves to the hyperfocal distance. Half the range in disparity is
            h (1 + k w_f), with h that of a focus at infinity, so that this distance is 1 / h - k: k is minus
            the focal length for "breathing", and the image distance for "framing".
    """
    diagonal_px = math.hypot(camera.width, camera.height)
    circle_px = diagonal_px * DIAGONAL_SHARE
    pixel_mm = float(camera.sensor_width) / camera.width * 1000
    pixels_per_dioptre = 2.0 * float(camera.focal_px * lens.aperture_radius)
    half_range = circle_px / pixels_per_dioptre if pixels_per_dioptre > 0 else math.inf
    focus = float(lens.focus_disparity)
    hyperfocal = 1.0 / half_range if half_range > 0 else math.inf
    if close_focus != "ignored":
        settings = lens_settings(camera, lens, close_focus)
        length = float(settings.focal_length)
        offset = float(settings.image_distance) if close_focus == "framing" else -length
        hyperfocal = max(hyperfocal * (1.0 + offset * focus) - offset, 0.0)
    return DepthOfField(
        circle_mm=circle_px * pixel_mm,
        circle_px=circle_px,
        near=1.0 / (focus + half_range) if focus > -half_range else math.inf,
        far=1.0 / (focus - half_range) if focus > half_range else math.inf,
        hyperfocal=hyperfocal,
    )


def depth_of_field_lens(
    camera: Camera,
    near: SupportsFloat,
    far: SupportsFloat,
    *,
    circle_px: SupportsFloat | None = None,
    f_number_range: tuple[SupportsFloat, SupportsFloat] = (1.0, 32.0),
) -> ThinLens:
    """The widest lens that blurs nothing between two distances by more than a circle of confusion.

    Blur is 2 f E |w_f - w|, so that the focus is the mean of the two disparities, and E is
    c / (f (w_n - w_f)). Where the lens would have to be wider than it opens, more is sharp than that.

    Args:
        camera: the pinhole that frames the picture.
        near: distance in metres along the view axis.
        far: distance in metres, beyond `near`; may be infinite.
        circle_px: largest diameter of the blur in pixels; that of the customary circle, the diagonal / 1500,
            if None.
        f_number_range: smallest and largest f-number of the lens.

    Raises:
        ValueError: distances out of order, a circle or a range that is none, or a range of distances for
            which the lens does not stop down enough, with the depth it has.

    Example:
        >>> from focusjax.geometry import look_at
        >>> camera = look_at((0, 0, 5), (0, 0, 0), width=640, height=480, focal_length=0.05)
        >>> lens = depth_of_field_lens(camera, 2.0, 4.0)
        >>> round(float(lens.focus_distance()), 3), round(float(lens.f_number(camera)), 1)
        (2.667, 10.4)
    """
    first, last = (
        real_number(value, f"the {end} end of what is to be sharp", "a distance in metres such as 2.0")
        for end, value in (("near", near), ("far", far))
    )
    if not 0.0 < first < last:
        raise ValueError(
            f"the range to be sharp is from {first:g} to {last:g} m; expected the nearer end first, above 0"
        )
    circle = (
        math.hypot(camera.width, camera.height) * DIAGONAL_SHARE
        if circle_px is None
        else real_number(circle_px, "the circle of confusion in pixels", "above 0, such as 1")
    )
    if not 0.0 < circle < math.inf:
        raise ValueError(f"the circle of confusion is {circle:g} px; expected above 0, such as 1")
    ends = real_numbers(
        f_number_range, "f_number_range", "two numbers, the smallest f-number and the largest"
    )
    if ends.shape != (2,):
        raise ValueError(
            f"f_number_range is {f_number_range}; expected two numbers, the smallest f-number and the largest"
        )
    widest, narrowest = ends.tolist()
    if not 0.0 < widest < narrowest:
        raise ValueError(
            f"the f-numbers are {widest:g} to {narrowest:g}; expected the smaller one first, above 0"
        )
    span = 1.0 / first - 1.0 / last
    number = float(camera.focal_length * camera.focal_px) * span / (2.0 * circle)
    if number > narrowest:
        half = narrowest * circle / float(camera.focal_length * camera.focal_px)
        middle = 0.5 * (1.0 / first + 1.0 / last)
        ends = 1.0 / (middle + half), 1.0 / (middle - half) if middle > half else math.inf
        raise ValueError(
            f"sharp from {first:g} to {last:g} m takes f/{number:.3g}, and the lens stops down to"
            f" f/{narrowest:g}, for {ends[0]:.3g} to {ends[1]:.3g} m; ask for less, or allow a larger circle"
        )
    return thin_lens(
        focus_distance=2.0 / (1.0 / first + 1.0 / last),
        focal_length=float(camera.focal_length),
        f_number=max(number, widest),
    )
