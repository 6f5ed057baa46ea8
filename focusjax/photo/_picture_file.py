"""The colours of a photograph: read, turned upright, and made linear."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import ExifTags, Image, ImageOps

from focusjax.photo._errors import PhotoError, check_file, one_line
from focusjax.scene import check_pixels, open_picture, read_image

SRGB, LINEAR = "srgb", "linear"
_WHITE_16 = 65535
"""White of greys with more than 8 bits."""
_BRIGHT = 0.8
"""Linear value from which on highlights are expanded."""
_FILM_DIAGONAL_MM = 43.2666
"""Of 36 x 24 mm, which lengths "in 35 mm film" are about."""
_QUARTER_TURNS = {3: 2, 4: 2, 5: 3, 6: 3, 7: 1, 8: 1}
"""By the EXIF orientation, counter-clockwise."""
_MIRRORED = (2, 4, 5, 7)
"""Orientations that swap left and right after that."""


@dataclass(frozen=True)
class PictureFile:
    """A picture as its file has it.

    Attributes:
        shown: values [h, w, 3] as stored, 0 to 1, upright; linear where `is_linear`.
        is_linear: whether the file holds linear light.
        orientation: the EXIF number by which it was turned upright, 1 for not at all.
        focal_length_35mm: mm as on 36 x 24 mm film with the same diagonal; None where the file does not say.
    """

    shown: Float[np.ndarray, "h w 3"]
    is_linear: bool
    orientation: int
    focal_length_35mm: float | None


def read_picture(path: Path) -> PictureFile:
    """The picture at `path`: JPEG, PNG, TIFF, WebP, HEIC or OpenEXR.

    Raises:
        PhotoError: no such file, or none that can be read.
    """
    check_file(path, "photograph")
    if path.suffix.lower() == ".exr":
        return PictureFile(read_exr(path), True, 1, None)
    try:
        if is_heif(path):
            return _read_heif(path)
        with open_photo(path) as opened:
            opened.load()
            return picture_of(opened, opened.getexif(), path)
    except PhotoError:
        raise
    except Exception as error:
        raise PhotoError(
            f"{path}: this photograph cannot be read ({one_line(error)}); expected a whole JPEG, PNG, TIFF,"
            " HEIC or OpenEXR file, so export it again"
        ) from error


def open_photo(path: Path) -> Image.Image:
    """A picture that is not decoded yet.

    Raises:
        PhotoError: it has too many pixels.
        OSError: no picture.
    """
    try:
        return open_picture(path)
    except ValueError as error:
        raise PhotoError(f"{path}: {error}") from None


def read_exr(path: Path) -> Float[np.ndarray, "h w 3"]:
    """Linear colours of an OpenEXR file.

    Raises:
        PhotoError: it cannot be read, or has no colours.
    """
    try:
        light = read_image(path)
    except ValueError as error:
        raise PhotoError(str(error)) from error
    if not np.isfinite(light).all():
        raise PhotoError(
            f"{path}: {int((~np.isfinite(light)).any(axis=2).sum())} pixels are not finite; repair the file"
        )
    return np.maximum(light, 0.0)


def picture_of(image: Image.Image, exif: Image.Exif, path: Path) -> PictureFile:
    """The opened picture of `path`, upright.

    Raises:
        PhotoError: samples of which it is not known what white is.
    """
    orientation = int(exif.get(ExifTags.Base.Orientation, 1) or 1)
    size = image.size
    if image.mode == "F" or image.mode.startswith("I"):
        # A conversion to RGB would cut these off at 255.
        shown = np.repeat(_grey(image, path)[..., None], 3, axis=2)
    else:
        shown = _shown(image)
    return PictureFile(turned_upright(shown, orientation), False, orientation, focal_length_of(exif, size))


def _shown(image: Image.Image) -> Float[np.ndarray, "h w 3"]:
    return np.asarray(image.convert("RGB"), dtype=np.float32) / np.float32(255)


def _grey(image: Image.Image, path: Path) -> Float[np.ndarray, "h w"]:
    """Greys of more than 8 bits, 0 to 1."""
    if image.mode == "F":
        raise PhotoError(
            f"{path}: the greys of this photograph are floats, which do not say what white is; save it as"
            " OpenEXR with channels R, G and B, or with 16 bits"
        )
    values = np.asarray(image)
    low, high = int(values.min()), int(values.max())
    if low < 0 or high > _WHITE_16:
        raise PhotoError(
            f"{path}: the greys of this photograph go from {low} to {high}; expected 0 to {_WHITE_16}, so"
            " save it with 16 bits"
        )
    return values.astype(np.float32) / np.float32(_WHITE_16)


def is_heif(path: Path) -> bool:
    """Whether a file is of the ISO base media format with a HEIF brand, whatever its name."""
    with path.open("rb") as stream:
        head = stream.read(12)
    return head[4:8] == b"ftyp" and head[8:12] in (b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1")


def open_heif(path: Path) -> Any:
    """The file as pi-heif opens it, not decoded yet, stored values as they are.

    Raises:
        PhotoError: pi-heif is not installed.
    """
    try:
        import pi_heif
    except ImportError:
        raise PhotoError(
            f'{path}: HEIC files need pi-heif; install it with pip install "focusjax[photo]", or save the'
            " photograph as a JPEG and its depth as a PNG"
        ) from None
    return pi_heif.open_heif(path)


def _read_heif(path: Path) -> PictureFile:
    opened = open_heif(path)
    check_pixels(opened.size)
    image = opened.to_pillow()
    exif = Image.Exif()
    if opened.info.get("exif"):
        exif.load(opened.info["exif"])
    # The decoder has turned the picture already, and says so by an orientation of 1 in what it gives.
    turned = int(opened.info.get("original_orientation") or 1)
    return PictureFile(_shown(image), False, turned, focal_length_of(exif, image.size))


def focal_length_of(exif: Image.Exif, size: tuple[int, int]) -> float | None:
    """Focal length in mm as on 36 x 24 mm film; None where EXIF does not say.

    From FocalLengthIn35mmFilm, or from FocalLength and the pixels per length in the focal plane.
    """
    more = exif.get_ifd(ExifTags.IFD.Exif)
    film = _positive(more.get(ExifTags.Base.FocalLengthIn35mmFilm))
    if film is not None:
        return film
    length = _positive(more.get(ExifTags.Base.FocalLength))
    density = _positive(more.get(ExifTags.Base.FocalPlaneXResolution))
    unit = {2: 25.4, 3: 10.0, 4: 1.0}.get(more.get(ExifTags.Base.FocalPlaneResolutionUnit, 2))
    full = _positive(more.get(ExifTags.Base.ExifImageWidth)) or max(size)
    if length is None or density is None or unit is None:
        return None
    focal_px = length * density / unit * max(size) / full
    return focal_px * _FILM_DIAGONAL_MM / float(np.hypot(*size))


def film_focal_px(focal_length_35mm: float, width: int, height: int) -> float:
    """Focal length in pixels of one in mm as on 36 x 24 mm film: the diagonals of the pictures are equal."""
    return focal_length_35mm / _FILM_DIAGONAL_MM * float(np.hypot(width, height))


def film_width(width: int, height: int) -> float:
    """Width in metres of a sensor of the picture's shape with the diagonal of 36 x 24 mm film."""
    return _FILM_DIAGONAL_MM / 1000 * width / float(np.hypot(width, height))


def _positive(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < np.inf else None


def linear_light(
    picture: PictureFile, curve: str | float, highlight_stops: float
) -> Float[np.ndarray, "h w 3"]:
    """Linear light of the stored values.

    Args:
        picture: what was read.
        curve: "srgb" (IEC 61966-2-1), "linear", or the exponent of a power curve, such as 2.2. Linear
            light in files is taken as it is.
        highlight_stops: by how many stops white is brighter than it could be stored. With m the largest of a
            pixel's three values and t = (m - 0.8) / 0.2, cut to 0 to 1, light is multiplied by 2^(s t^2).
    """
    stored = picture.shown.astype(np.float32)
    if picture.is_linear or curve == LINEAR:
        light = stored
    elif curve == SRGB:
        light = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    else:
        light = stored ** float(curve)
    if highlight_stops:
        share = np.clip((light.max(axis=2, keepdims=True) - _BRIGHT) / (1.0 - _BRIGHT), 0.0, 1.0)
        light = light * 2.0 ** (highlight_stops * share**2)
    return light.astype(np.float32)


def turned_upright(values: np.ndarray, orientation: int) -> np.ndarray:
    """A picture [h, w, ...] as it is stored, or a map of it, turned as its EXIF orientation says."""
    turned = np.rot90(values, _QUARTER_TURNS.get(orientation, 0))
    return np.ascontiguousarray(np.fliplr(turned) if orientation in _MIRRORED else turned)


def image_of(data: bytes) -> Image.Image:
    """A picture from bytes, decoded and upright by its own EXIF."""
    with open_picture(io.BytesIO(data)) as opened:
        opened.load()
        return ImageOps.exif_transpose(opened)
