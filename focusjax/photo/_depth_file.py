"""Depth maps from files, as stored: PNG, TIFF, NPY, PFM and OpenEXR."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from focusjax.photo._errors import PhotoError, check_file, one_line
from focusjax.photo._picture_file import open_photo
from focusjax.scene import check_pixels, depth_channel, exr_channels

_KINDS = "expected a PNG or TIFF of 8 or 16 bits, NPY, PFM, or OpenEXR with a channel Z"


@dataclass(frozen=True)
class StoredDepth:
    """A depth map before units.

    Attributes:
        values: as stored [h, w]; NaN where the file itself has nothing.
        step: smallest difference that the file resolves, 0 for floats.
        is_exact: whether its edges are those of the picture: rendered, not measured.
        source: the file, for messages.
        unit: where the file says it; None where it has to be declared.
        is_along_ray: whether distances are those from the camera, not those along the view axis.
    """

    values: Float[np.ndarray, "h w"]
    step: float
    is_exact: bool
    source: str
    unit: str | None = None
    is_along_ray: bool = False


def read_depth(path: Path) -> StoredDepth:
    """The depth map at `path`.

    Raises:
        PhotoError: no such file, one that cannot be read, is too large, or of several channels.
    """
    check_file(path, "depth map")
    kind = path.suffix.lower()
    try:
        if kind == ".npy":
            return _of_array(_read_npy(path), path)
        if kind == ".pfm":
            return StoredDepth(_read_pfm(path.read_bytes(), path), 0.0, False, str(path))
        if kind == ".exr":
            return StoredDepth(_read_exr(path), 0.0, True, str(path))
        with open_photo(path) as opened:
            return _of_picture(opened, path)
    except PhotoError:
        raise
    except Exception as error:
        raise PhotoError(f"{path}: this depth map cannot be read ({one_line(error)}); {_KINDS}") from error


def _check_size(width: int, height: int, path: Path) -> None:
    try:
        check_pixels((width, height))
    except ValueError as error:
        raise PhotoError(f"{path}: {error}") from None


def _of_picture(image: Image.Image, path: Path) -> StoredDepth:
    """The greys of a picture; nothing where it is transparent."""
    has_more_bits = any(";16" in str(tile.args) for tile in getattr(image, "tile", ()))
    image.load()
    if image.mode in ("LA", "RGB", "RGBA") and has_more_bits:
        raise PhotoError(
            f"{path}: this depth map has 16 bits in each of several channels, of which only 8 can be read;"
            " save it with 16 bits in one channel"
        )
    found = _of_array(np.asarray(_grey(image, path)), path)
    if "A" in image.getbands():
        found.values[np.asarray(image.getchannel("A")) == 0] = np.nan
    return found


def _grey(image: Image.Image, path: Path) -> Image.Image:
    """An image of one channel, of three equal ones too."""
    if image.mode in ("L", "F") or image.mode.startswith("I"):
        return image
    if image.mode == "LA":
        return image.getchannel(0)
    if image.mode in ("RGB", "RGBA"):
        first, *rest = (np.asarray(image.getchannel(k)) for k in range(3))
        if all((first == other).all() for other in rest):
            return image.getchannel(0)
    raise PhotoError(
        f"{path}: this depth map is a colour picture ({image.mode}); expected one channel of depth, not a"
        " rendering of it in false colours, so export the grey map"
    )


def _read_npy(path: Path) -> np.ndarray:
    """The array of a file whose header has been looked at first."""
    with path.open("rb") as stream:
        version = np.lib.format.read_magic(stream)
        read = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, _, kind = read(stream)
        if len(shape) >= 2:
            _check_size(shape[1], shape[0], path)
        wanted, there = math.prod(shape) * kind.itemsize, path.stat().st_size - stream.tell()
    if wanted > there and not kind.hasobject:
        raise PhotoError(f"{path}: the NPY file is cut off ({there} of {wanted} bytes); copy it again")
    return np.load(path, allow_pickle=False)


def _of_array(values: np.ndarray, path: Path) -> StoredDepth:
    values = values[..., 0] if values.ndim == 3 and values.shape[2] == 1 else values
    if values.ndim != 2 or values.size == 0 or values.dtype.kind not in "fiu":
        raise PhotoError(
            f"{path}: the array has shape {values.shape} of {values.dtype}; expected numbers [h, w]"
        )
    whole = values.dtype.kind in "iu"
    return StoredDepth(values.astype(np.float64), 1.0 if whole else 0.0, False, str(path))


def _read_pfm(data: bytes, path: Path) -> Float[np.ndarray, "h w"]:
    """Grey PFM: three lines of text, then rows from the bottom up; a negative scale is little-endian."""
    lines = data.split(b"\n", 3)
    if len(lines) < 4 or lines[0].strip() != b"Pf":
        raise PhotoError(f"{path}: this is not a grey PFM file (it starts with {data[:2]!r}, expected b'Pf')")
    try:
        width, height = (int(text) for text in lines[1].split())
        scale = float(lines[2])
    except ValueError:
        raise PhotoError(
            f"{path}: the PFM file has no width, height and scale in its second and third line; save it again"
        ) from None
    if min(width, height) <= 0:
        raise PhotoError(
            f"{path}: the PFM file is of {width} x {height} pixels; expected 1 and more, so save it again"
        )
    _check_size(width, height, path)
    wanted = 4 * width * height
    if len(lines[3]) < wanted:
        raise PhotoError(
            f"{path}: the PFM file is cut off ({len(lines[3])} of {wanted} bytes); copy it again"
        )
    rows = np.frombuffer(lines[3][:wanted], dtype="<f4" if scale < 0 else ">f4").reshape(height, width)
    return np.flipud(rows).astype(np.float64)


def _read_exr(path: Path) -> Float[np.ndarray, "h w"]:
    channels = exr_channels(path)
    found = depth_channel(channels)
    if found is None:
        raise PhotoError(
            f"{path}: there is no one depth channel among {', '.join(channels)}; expected one named Z, so"
            " name it that, or give the depth in a file of its own"
        )
    return channels[found].astype(np.float64)
