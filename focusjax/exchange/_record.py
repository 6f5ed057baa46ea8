"""What every writer is given: a camera with its lens, in plain numbers, one set a frame.

Lengths are metres, angles radians. The world has +y up and the camera looks along its own -z axis.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from focusjax._arguments import ArgumentError, require_kind, require_known
from focusjax.exchange._opening import Opening, opening_of
from focusjax.geometry import Camera
from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    AbstractLensWrapper,
    ChromaticLens,
    FittedLens,
    FocalSurfaceLens,
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    TiltShiftLens,
    is_tilted,
)

_USAGE = "export_camera(camera, lens, path)"
_UPRIGHT = 1e-7
"""Radians of tilt below which a lens is upright."""


@dataclasses.dataclass(frozen=True)
class Frame:
    """The camera in one frame.

    Attributes:
        pose: rigid transform world_from_camera [4, 4].
        focal_length: from the lens centre to the sensor, which stays there at every focus (no breathing).
        sensor_width: of what the frame's pixels cover.
        shift: how far the lens slides to the right over the sensor: the frame sees more of what is there.
        rise: how far it slides up.
        aperture_radius: of the circle around the opening; 0 is a pinhole.
        plane: the plane in focus n . P = 1 in 1/m, in camera axes (right, up, ahead).
    """

    pose: Float[np.ndarray, "4 4"]
    focal_length: float
    sensor_width: float
    shift: float
    rise: float
    aperture_radius: float
    plane: tuple[float, float, float]

    @property
    def focus_distance(self) -> float:
        """Metres along the view axis to the plane in focus; infinite beyond all measure."""
        return 1.0 / self.plane[2] if self.plane[2] > 0 else math.inf

    @property
    def f_number(self) -> float:
        """Focal length over aperture diameter; infinite for a pinhole."""
        return self.focal_length / (2.0 * self.aperture_radius) if self.aperture_radius else math.inf

    @property
    def tilt(self) -> float:
        """Of the lens, positive forwards (its axis down)."""
        return -math.asin(min(1.0, max(-1.0, self.focal_length * self.plane[1])))

    @property
    def swing(self) -> float:
        """Of the lens, positive to the right."""
        right, up = (self.focal_length * value for value in self.plane[:2])
        return math.atan2(right, math.sqrt(max(0.0, 1.0 - right**2 - up**2)))

    @property
    def tilted(self) -> bool:
        """Whether the lens is turned against the sensor."""
        return self.focal_length * math.hypot(*self.plane[:2]) > _UPRIGHT


@dataclasses.dataclass(frozen=True)
class Record:
    """A camera to be written.

    Attributes:
        name: what targets are to call it.
        width: pixels per row.
        height: rows.
        frames: one, or all of a shot, the first of which is frame 1.
        opening: the shape of the lens's opening.
        fps: frames per second.
        surface: focal disparity in 1/m and aperture scale at pixel corners, where these differ over the
            picture; of a single frame.
        glass: the real lens, of a single frame.
        beyond: what else the lens does that an ideal one does not, in words.
        lenses: the lenses themselves, by which approximations are judged, one a frame.
        cameras: the cameras themselves.
    """

    name: str
    width: int
    height: int
    frames: tuple[Frame, ...]
    opening: Opening
    fps: float
    surface: tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns"]] | None
    glass: PrescriptionLens | None
    beyond: tuple[str, ...]
    lenses: tuple[AbstractLens, ...]
    cameras: tuple[Camera, ...]

    @property
    def is_shot(self) -> bool:
        """Whether there are several frames."""
        return len(self.frames) > 1


def record_of(
    camera: Camera | Sequence[Camera],
    lens: AbstractLens | Sequence[AbstractLens],
    *,
    name: str = "Camera",
    fps: float = 24.0,
) -> Record:
    """The record of a camera and its lens, or of those of a shot, one each a frame.

    Args:
        camera: one, or one a frame, all of one picture size.
        lens: one, or one a frame.
        name: what targets are to call the camera.
        fps: frames per second.

    Raises:
        ArgumentError: what is neither camera nor lens, values traced by JAX, other numbers of cameras than of
            lenses, several sizes, or lenses of several kinds.
    """
    cameras: tuple[Camera, ...] = (camera,) if isinstance(camera, Camera) else tuple(camera)
    lenses: tuple[AbstractLens, ...] = (lens,) if isinstance(lens, AbstractLens) else tuple(lens)
    for number, (each, through) in enumerate(zip(cameras, lenses, strict=False)):
        at = "" if len(cameras) == 1 else f" of frame {number + 1}"
        require_kind(each, Camera, _USAGE, "`look_at` and `make_camera` make one", f"camera{at}")
        require_kind(through, AbstractLens, _USAGE, "`thin_lens` makes one", f"lens{at}")
        require_known((each, through), _USAGE, "a file holds numbers; export outside of jit", "camera")
    if not cameras or len(cameras) != len(lenses):
        raise ArgumentError(
            f"{_USAGE} has {len(cameras)} cameras and {len(lenses)} lenses; expected one each per frame",
            "lens",
        )
    if len({(each.width, each.height) for each in cameras}) > 1:
        raise ArgumentError(f"the cameras of {_USAGE} differ in their pixels; expected one size", "camera")
    if not 0 < fps < math.inf:
        raise ArgumentError(f"fps is {fps}; expected frames per second above 0", "fps")
    found = [_ideal(each) for each in lenses]
    ideals, words = [each[0] for each in found], found[0][1]
    surface, glass = None, _glass(lenses[0])
    several = len(cameras) > 1
    if several and (glass is not None or isinstance(ideals[0], FocalSurfaceLens)):
        what = "has a focal surface" if glass is None else "is a real lens"
        raise ArgumentError(
            f"the lens of {_USAGE} {what}, which is exported for a single picture and not for a shot;"
            " give one camera and one lens",
            "lens",
        )
    if isinstance(ideals[0], FocalSurfaceLens):
        surface = (
            np.asarray(ideals[0].focus_disparity, dtype=float),
            np.asarray(ideals[0].aperture_scale, dtype=float),
        )
    pairs = zip(cameras, ideals, lenses, strict=True)
    return Record(
        name=name,
        width=cameras[0].width,
        height=cameras[0].height,
        frames=tuple(_frame(each, ideal, through) for each, ideal, through in pairs),
        opening=opening_of(lenses[0].opening()),
        fps=float(fps),
        surface=surface,
        glass=glass,
        beyond=words,
        lenses=lenses,
        cameras=cameras,
    )


def lens_of(frame: Frame, opening: Opening) -> ThinLens | TiltShiftLens:
    """The lens of a frame as focusjax has it."""
    plane = np.asarray(frame.plane, dtype=float)
    radius, aperture = _array(frame.aperture_radius), opening.aperture()
    if frame.tilted:
        return TiltShiftLens(_array(plane), radius, aperture)
    return ThinLens(_array(plane[2]), radius, aperture)


def _array(value: Any) -> jax.Array:
    return jax.numpy.asarray(value, dtype=float)


def _ideal(lens: AbstractLens) -> tuple[AbstractLens, tuple[str, ...]]:
    """The ideal lens inside of `lens`, and what is around it in words; a real lens as it is."""
    words: list[str] = []
    while not isinstance(lens, ThinLens | TiltShiftLens | FocalSurfaceLens) and _glass(lens) is None:
        if is_tilted(lens):
            raise ArgumentError(
                f"lens of {_USAGE} is a real lens that is tilted, which no target has; give the TiltShiftLens"
                " of its settings, or the real lens level",
                "lens",
            )
        if isinstance(lens, AberratedLens):
            words.append("aberrations")
        elif isinstance(lens, ChromaticLens):
            words.append("colour errors")
        elif isinstance(lens, AbstractLensWrapper):
            words.append("vignetting")
        inner = getattr(lens, "lens", None)
        if not isinstance(inner, AbstractLens):
            raise ArgumentError(
                f"lens of {_USAGE} is a {type(lens).__name__}, which no target has; give the ThinLens or"
                " TiltShiftLens that was solved for",
                "lens",
            )
        lens = inner
    return lens, tuple(words)


def _glass(lens: AbstractLens) -> PrescriptionLens | None:
    """The real lens that a lens is."""
    if isinstance(lens, SpectralLens):
        return _glass(lens.lens)
    if isinstance(lens, FittedLens):
        return lens.exact
    return lens if isinstance(lens, PrescriptionLens) else None


def _frame(camera: Camera, ideal: AbstractLens, lens: AbstractLens) -> Frame:
    focal_length = _plain(camera.focal_length)
    if isinstance(ideal, TiltShiftLens):
        radius, plane = _plain(ideal.aperture_radius), [_plain(value) for value in ideal.plane]
    elif isinstance(ideal, FocalSurfaceLens):
        middle = ideal.thin_lens_at(camera, camera.principal_point)
        radius, plane = _plain(ideal.aperture_radius), [0.0, 0.0, _plain(middle.focus_disparity)]
    elif isinstance(ideal, ThinLens):
        radius, plane = _plain(ideal.aperture_radius), [0.0, 0.0, _plain(ideal.focus_disparity)]
    else:
        glass = _glass(lens)
        assert glass is not None
        radius = focal_length / (2.0 * _plain(glass.f_number(camera)))
        plane = [0.0, 0.0, _plain(glass.focus_disparity)]
    pose = np.array([[_plain(value) for value in row] for row in np.asarray(camera.world_from_camera)])
    # The nearest rotation, which single precision misses in its last digits.
    left, _, right = np.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    return Frame(
        pose=pose,
        focal_length=focal_length,
        sensor_width=_plain(camera.sensor_width),
        shift=_plain(camera.shift),
        rise=_plain(camera.rise),
        aperture_radius=radius,
        plane=(plane[0], plane[1], plane[2]),
    )


def _plain(value: Any) -> float:
    """The number that a person would write for one of single precision: 0.036, not 0.0359999985."""
    known = np.asarray(value)
    return float(str(known)) if known.dtype == np.float32 else float(known)
