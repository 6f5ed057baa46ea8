"""Settings in a photographer's words: how much is sharp, and from where everything is."""

import math
from dataclasses import dataclass

from focusjax.geometry import Camera
from focusjax.lens import DIAGONAL_SHARE, ThinLens, TiltShiftLens


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


def depth_of_field(camera: Camera, lens: ThinLens | TiltShiftLens) -> DepthOfField:
    """The range of distances whose blur 2 f E |w_f - w| is at most the customary circle of confusion c.

    In disparity it is w_f +- c / (2 f E), and the hyperfocal disparity is c / (2 f E).
    Distances are along the view axis, wherever a tilted lens has its focus elsewhere.
    """
    diagonal_px = math.hypot(camera.width, camera.height)
    circle_px = diagonal_px * DIAGONAL_SHARE
    pixel_mm = float(camera.sensor_width) / camera.width * 1000
    pixels_per_dioptre = 2.0 * float(camera.focal_px * lens.aperture_radius)
    half_range = circle_px / pixels_per_dioptre if pixels_per_dioptre > 0 else math.inf
    focus = float(lens.focus_disparity)
    return DepthOfField(
        circle_mm=circle_px * pixel_mm,
        circle_px=circle_px,
        near=1.0 / (focus + half_range) if focus > -half_range else math.inf,
        far=1.0 / (focus - half_range) if focus > half_range else math.inf,
        hyperfocal=1.0 / half_range if half_range > 0 else math.inf,
    )
