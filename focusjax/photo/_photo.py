"""A photograph with its depth, in front of the camera that took it."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from focusjax._arguments import real_number
from focusjax.geometry import Camera, make_camera
from focusjax.photo._align import aligned
from focusjax.photo._depth_file import StoredDepth, read_depth
from focusjax.photo._embedded import embedded_depth
from focusjax.photo._errors import PhotoError
from focusjax.photo._picture_file import (
    LINEAR,
    SRGB,
    PictureFile,
    film_focal_px,
    film_width,
    linear_light,
    read_picture,
    turned_upright,
)
from focusjax.photo._scene import photo_scene
from focusjax.photo._units import UNITS, DepthUnit, along_axis, disparity_of
from focusjax.scene import Scene

_ALIGN_PX = 2.0
_EDGE_PX = 3
"""Pixels on either side of a silhouette that a camera and its software mix."""
_SAME_SHAPE = 0.02
"""Share by which the shapes of a photograph and its depth may differ."""


@dataclasses.dataclass(frozen=True)
class Photo:
    """A photograph with depth.

    Attributes:
        light: linear [h, w, 3].
        disparity: 1/m [h, w] of every pixel; a guess where it was not measured.
        measured: where [h, w] the depth map has a value.
        camera: the camera that took it, at the origin, on a sensor with the diagonal of 36 x 24 mm.
        edge_px: pixels on either side of a silhouette that may hold a mixture of both sides.
        source: the file.

    Example:
        >>> fj.save_png("desk.png", np.full((24, 36, 3), 0.5))
        >>> np.save("desk_depth.npy", np.full((24, 36), 2.0))
        >>> photo = fj.load_photo("desk.png", depth="desk_depth.npy", depth_unit="m", focal_length_px=50)
        >>> photo.light.shape, round(float(photo.disparity[0, 0]), 6), float(photo.camera.focal_px)
        ((24, 36, 3), 0.5, 50.0)
    """

    light: Float[np.ndarray, "h w 3"]
    disparity: Float[np.ndarray, "h w"]
    measured: Bool[np.ndarray, "h w"]
    camera: Camera
    edge_px: int
    source: Path

    def scene(self, *, f_number: float = 1.4) -> Scene:
        """The photograph as a scene of unlit triangles, for lenses of this f-number and narrower ones.

        Its objects are `photograph`, `holes`, `edges` and `guess`: what was seen, that of which the depth was
        not measured, mixtures at silhouettes, and what is guessed behind foregrounds and beyond the frame. A
        wider lens would look past the guess.

        Raises:
            ValueError: an f-number that is not positive.
        """
        expected = "a positive f-number, such as 1.4"
        number = real_number(f_number, "f_number", expected)
        if not 0 < number < math.inf:
            raise ValueError(f"f_number is {f_number!r}; expected {expected}")
        radius = float(self.camera.focal_length) / (2.0 * number)
        return photo_scene(self.light, self.disparity, self.measured, self.camera, radius, self.edge_px)


def photo_camera(
    path: str | Path,
    *,
    focal_length_35mm: float | None = None,
    focal_length_px: float | None = None,
) -> Camera:
    """The camera that took the photograph at `path`; arguments and errors as for `load_photo`."""
    return _camera(read_picture(Path(path)), Path(path), focal_length_35mm, focal_length_px)


def load_photo(
    path: str | Path,
    *,
    depth: str | Path | None = None,
    depth_unit: str | None = None,
    depth_scale: float = 1.0,
    depth_invalid: float | None = None,
    depth_focal_px: float | None = None,
    depth_offset_px: float = 0.0,
    baseline_m: float | None = None,
    anchors: Sequence[Sequence[float]] = (),
    focal_length_35mm: float | None = None,
    focal_length_px: float | None = None,
    curve: str | float = SRGB,
    highlight_stops: float = 0.0,
    align_px: float | None = None,
) -> Photo:
    """A photograph with depth, from two files or from one that holds both.

    Args:
        path: JPEG, PNG, TIFF, HEIC (extra `photo`) or OpenEXR; EXIF turns it upright.
        depth: depth map: PNG or TIFF of 8 or 16 bits, NPY, PFM, or OpenEXR with Z. Left out, the depth inside
            the photograph (HEIC, GDepth, Dynamic Depth) or its own channel Z is taken.
        depth_unit: "m", "mm", "1/m", "px" (stereo disparity) or "relative"; needed unless the file says it.
        depth_scale: what a stored value of 1 is in that unit: 1/5000 for 5000 a metre.
        depth_invalid: the stored value that marks holes; 0 by default, for m, mm and px. NaN always does.
        depth_focal_px: focal length of the stereo pair in the depth map's pixels, for px.
        depth_offset_px: what is added to disparities in px: the principal points' difference.
        baseline_m: distance of the stereo pair's cameras, for px.
        anchors: two of [x, y, metres] (a place in the photograph) or two of [value, metres], for relative
            depth.
        focal_length_35mm: mm as on 36 x 24 mm film, in place of EXIF's.
        focal_length_px: in pixels of the photograph, in place of EXIF's.
        curve: "srgb", "linear", or the exponent of a power curve.
        highlight_stops: how much brighter white is than it could be stored, in stops; `linear_light` has the
            rule.
        align_px: pixels of the depth map by which its edges may lie off the colours'; 2 by default, and 0 for
            rendered depth (OpenEXR), which is left as it is.

    Raises:
        PhotoError: a file that cannot be used, a unit or focal length that is missing, or sizes that do not
            belong together; one sentence with the file and what to do.

    Example:
        >>> fj.save_png("desk.png", np.full((24, 36, 3), 0.5))
        >>> np.save("desk_depth.npy", np.full((24, 36), 2.0))
        >>> photo = fj.load_photo("desk.png", depth="desk_depth.npy", depth_unit="m", focal_length_35mm=50)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=1.4, focal_length=photo.camera.focal_length)
        >>> layers = fj.peel(photo.scene(f_number=1.4), photo.camera, lens)
        >>> round(1 / float(layers.disparity[0, 12, 18]), 2)
        2.0
    """
    path = Path(path)
    _check_options(path, curve, highlight_stops, align_px)
    picture = read_picture(path)
    size = picture.shown.shape[1], picture.shown.shape[0]
    stored = _stored_depth(path, None if depth is None else Path(depth))
    unit = _unit(
        stored,
        depth_unit,
        scale=depth_scale,
        invalid=depth_invalid,
        focal_length_px=depth_focal_px,
        baseline_m=baseline_m,
        offset_px=depth_offset_px,
        anchors=tuple(tuple(anchor) for anchor in anchors),
    )
    own = depth is None
    stored = dataclasses.replace(stored, values=_upright(stored, picture, path, size, embedded=own))
    disparity, known, step = disparity_of(stored, unit, size)
    camera = _camera(picture, path, focal_length_35mm, focal_length_px)
    if stored.is_along_ray:
        disparity = along_axis(disparity, camera)
    exact = stored.is_exact
    reach = (0.0 if exact else _ALIGN_PX) if align_px is None else float(align_px)
    light = linear_light(picture, curve, highlight_stops)
    shown = np.minimum(light, 1.0) ** (1 / 2.2) if picture.is_linear else picture.shown
    depth_map, measured = aligned(disparity, known, step, shown, reach)
    return Photo(light, depth_map, measured, camera, 1 if exact else _EDGE_PX, path)


def _check_options(path: Path, curve: str | float, highlight_stops: float, align_px: float | None) -> None:
    powers = isinstance(curve, int | float) and not isinstance(curve, bool) and 0 < curve < math.inf
    if curve not in (SRGB, LINEAR) and not powers:
        raise PhotoError(
            f"{path}: the curve is {curve!r}; expected 'srgb', 'linear' or an exponent such as 2.2"
        )
    for name, value in (("highlight_stops", highlight_stops), ("align_px", align_px)):
        if value is not None and not 0 <= real_number(value, name, "a number of at least 0") <= 64:
            raise PhotoError(f"{path}: {name} is {value}; expected 0 to 64")


def _stored_depth(path: Path, depth: Path | None) -> StoredDepth:
    """Depth of its own file, or from within the photograph."""
    if depth is not None:
        return read_depth(depth)
    if path.suffix.lower() == ".exr":
        return read_depth(path)
    found = embedded_depth(path)
    if found is None:
        raise PhotoError(
            f"{path}: there is no depth in this photograph; give a depth map of its own with --depth (depth ="
            " in a config), or a portrait HEIC or depth JPEG as the phone saved it"
        )
    return found


def _unit(stored: StoredDepth, declared: str | None, *, invalid: float | None, **rest: object) -> DepthUnit:
    """As declared, or as the file says; never guessed."""
    if stored.unit is not None:
        if declared not in (None, stored.unit):
            raise PhotoError(
                f"{stored.source}: the file says that its depth is in {stored.unit}, and depth_unit is"
                f" {declared!r}; leave depth_unit out"
            )
        return DepthUnit(stored.unit, invalid=None)
    if declared is None:
        raise PhotoError(
            f"{stored.source}: nothing says what the values of this depth map mean; give depth_unit as one of"
            f" {', '.join(UNITS)}"
        )
    usual = 0.0 if declared in ("m", "mm", "px") else None
    return DepthUnit(declared, invalid=usual if invalid is None else invalid, **rest)  # type: ignore[arg-type]


def _upright(
    stored: StoredDepth, picture: PictureFile, path: Path, size: tuple[int, int], *, embedded: bool
) -> Float[np.ndarray, "h w"]:
    """The depth map turned as the photograph was, if its shape does not say that it was already.

    Where the shape cannot say, a map inside the photograph is taken to be as the stored pixels are.
    """
    values, turn = stored.values, picture.orientation
    upright, lying = _alike(values, size), turn >= 5 and _alike(values, (size[1], size[0]))
    is_turned = turn >= 5 and upright and not lying
    if (lying and not upright) or (embedded and not is_turned):
        values = turned_upright(values, turn)
    elif not embedded and turn > 1 and (turn < 5 or size[0] == size[1]):
        raise PhotoError(
            f"{path}: EXIF turns this photograph (orientation {turn}), and its depth {stored.source} may be"
            " turned or not; save both upright, without the EXIF orientation"
        )
    if not _alike(values, size):
        raise PhotoError(
            f"{stored.source}: the depth map is {values.shape[1]} x {values.shape[0]} pixels and the"
            f" photograph {path.name} {size[0]} x {size[1]}, which is another shape; give the depth of this"
            " very picture, not cropped or turned"
        )
    return values


def _alike(values: np.ndarray, size: tuple[int, int]) -> bool:
    return abs(values.shape[1] / values.shape[0] / (size[0] / size[1]) - 1.0) <= _SAME_SHAPE


def _camera(
    picture: PictureFile, path: Path, focal_length_35mm: float | None, focal_length_px: float | None
) -> Camera:
    """At the origin, on a sensor of the picture's shape with the diagonal of 36 x 24 mm."""
    height, width = picture.shown.shape[:2]
    if focal_length_35mm is not None and focal_length_px is not None:
        raise PhotoError(f"{path}: give one of focal_length_35mm and focal_length_px, not both")
    for name, value in (("focal_length_35mm", focal_length_35mm), ("focal_length_px", focal_length_px)):
        if value is not None and not 0 < real_number(value, name, "a positive length") < math.inf:
            raise PhotoError(f"{path}: {name} is {value}; expected a positive length")
    pixels = focal_length_px
    if pixels is None:
        film = focal_length_35mm or picture.focal_length_35mm
        if film is None:
            raise PhotoError(
                f"{path}: EXIF does not say the focal length; give focal_length_35mm (mm as on 36 x 24 mm"
                " film, about 26 for a phone) or focal_length_px"
            )
        pixels = film_focal_px(film, width, height)
    sensor = film_width(width, height)
    return make_camera(
        np.eye(4), width=width, height=height, sensor_width=sensor, focal_length=pixels * sensor / width
    )
