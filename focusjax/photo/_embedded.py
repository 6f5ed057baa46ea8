"""Depth that comes inside a photograph: HEIC of iPhones, JPEG of Android phones.

HEIC: an auxiliary image; its metadata say between which disparities or depths its values lie (the SEI
message "depth representation information" of HEVC, ITU-T H.265 section G.14.2.7; phones give 1/m).

JPEG, GDepth (developers.google.com/depthmap-metadata) and Dynamic Depth 1.0: with stored values 0 <= d <= 1
between a near depth n and a far depth f,

    RangeInverse   z = f n / (f - d (f - n)),  which is  w = 1/f + (1 - d) (1/n - 1/f) ... in 1 - d
    RangeLinear    z = n + d (f - n).

Distances are along the view axis (MeasureType OpticalAxis) or from the camera (OpticRay).
"""

import math
from pathlib import Path

import numpy as np

from focusjax.photo._depth_file import StoredDepth
from focusjax.photo._errors import PhotoError, one_line
from focusjax.photo._jpeg import JpegMetadata, decoded_base64, jpeg_metadata
from focusjax.photo._picture_file import image_of, is_heif, open_heif

_UNIFORM_INVERSE_Z, _UNIFORM_DISPARITY, _UNIFORM_Z = 0, 1, 2
_UNITS = {"m": 1.0, "meters": 1.0, "metres": 1.0, "mm": 1e-3, "millimeters": 1e-3}


def embedded_depth(path: Path) -> StoredDepth | None:
    """The depth map inside the photograph at `path`, None where there is none.

    As the file has it: turned as the picture's stored pixels are, or upright already.

    Raises:
        PhotoError: there is one that cannot be read.
    """
    if is_heif(path):
        return _of_heif(path)
    with path.open("rb") as stream:
        if stream.read(2) != b"\xff\xd8":
            return None
    data = path.read_bytes()
    found = jpeg_metadata(data, str(path))
    if found.gdepth:
        return _of_gdepth(found, path)
    if found.dynamic:
        return _of_dynamic_depth(found, data, path)
    return None


def _of_heif(path: Path) -> StoredDepth | None:
    try:
        images = open_heif(path).info.get("depth_images") or []
        if not images:
            return None
        values = np.asarray(images[0].to_pillow()).astype(np.float64)
        said = images[0].info.get("metadata") or {}
    except PhotoError:
        raise
    except Exception as error:
        raise PhotoError(
            f"{path}: the depth in this HEIC file cannot be read ({one_line(error)}); export it again"
        ) from error
    values = values[..., 0] if values.ndim == 3 else values
    largest = 255.0 if values.max() <= 255 else 65535.0
    kind = said.get("representation_type")
    ends = ("z_far", "z_near") if kind == _UNIFORM_Z else ("d_min", "d_max")
    low, high = (said.get(name) for name in ends)
    if kind not in (_UNIFORM_INVERSE_Z, _UNIFORM_DISPARITY, _UNIFORM_Z) or low is None or high is None:
        raise PhotoError(
            f"{path}: the depth in this HEIC file does not say what its values mean; save it as a PNG and"
            " declare its unit with two anchors"
        )
    scaled = low + values / largest * (high - low)
    disparity = 1.0 / scaled if kind == _UNIFORM_Z else scaled
    step = 0.0 if kind == _UNIFORM_Z else abs(high - low) / largest
    return StoredDepth(disparity, step, False, f"{path} (its depth image)", "1/m")


def _of_gdepth(found: JpegMetadata, path: Path) -> StoredDepth:
    if "Data" not in found.gdepth:
        raise PhotoError(
            f"{path}: its XMP announces a depth map, but GDepth:Data is missing; export it again"
        )
    picture = decoded_base64(found.gdepth["Data"], f"{path}: GDepth:Data")
    return _between(picture, found.gdepth, path, "GDepth")


def _of_dynamic_depth(found: JpegMetadata, data: bytes, path: Path) -> StoredDepth | None:
    """The item that DepthURI, or else a depth semantic, names among those after the primary picture."""
    wanted = found.dynamic.get("DepthURI")
    place = found.end
    for number, item in enumerate(found.items):
        try:
            length, padding = int(item.get("Length", 0)), int(item.get("Padding", 0))
        except ValueError:
            raise PhotoError(
                f"{path}: the length of item {number} in its container is no number; export it again"
            ) from None
        if number == 0 and item.get("Semantic", "Primary").lower() == "primary":
            place += max(padding, 0)
            continue
        uri, meaning = item.get("DataURI"), item.get("Semantic", "").lower()
        if (wanted is not None and uri == wanted) or (uri is None and meaning in ("depth", "depthmap")):
            if length <= 0 or place + length > len(data):
                raise PhotoError(
                    f"{path}: its depth map should be {length} bytes from {place} on, but the file ends at"
                    f" {len(data)}; copy it again"
                )
            return _between(data[place : place + length], found.dynamic, path, "Dynamic Depth")
        place += max(length, 0) + max(padding, 0)
    raise PhotoError(
        f"{path}: its XMP announces a depth map that its container does not list; export it again"
    )


def _between(picture: bytes, said: dict[str, str], path: Path, what: str) -> StoredDepth:
    """Stored greys between the near and far depth that XMP gives."""
    try:
        image = image_of(picture)
        values = np.asarray(image if image.mode.startswith("I") else image.convert("L")).astype(np.float64)
    except Exception as error:
        raise PhotoError(
            f"{path}: its {what} depth map is no picture ({one_line(error)}); export it again"
        ) from error
    largest = 255.0 if not image.mode.startswith("I") else 65535.0
    try:
        near, far = float(said["Near"]), float(said["Far"])
    except (KeyError, ValueError):
        raise PhotoError(
            f"{path}: its {what} says no near and far depth; save the map as a PNG and declare its unit"
        ) from None
    if not 0 < near < far or math.isnan(far):
        raise PhotoError(f"{path}: its {what} has near = {near} and far = {far}; expected 0 < near < far")
    units = said.get("Units", "m" if what == "GDepth" else "").lower()
    form = said.get("Format", "RangeInverse").lower()
    share = values / largest
    if form == "rangeinverse":
        disparity = (1.0 - share) / near + share / far
    elif form == "rangelinear":
        disparity = 1.0 / (near + share * (far - near))
    else:
        raise PhotoError(
            f"{path}: its {what} has Format = {said.get('Format')}; expected RangeInverse or RangeLinear"
        )
    measure = said.get("MeasureType", "OpticalAxis").lower()
    if measure not in ("opticalaxis", "opticray"):
        raise PhotoError(
            f"{path}: its {what} has MeasureType = {said['MeasureType']}; expected OpticalAxis or OpticRay,"
            " so save the map as a PNG and declare its unit"
        )
    source, is_along_ray = f"{path} (its {what})", measure == "opticray"
    step = (1 / near - 1 / far) / largest if form == "rangeinverse" else 0.0
    if units in ("diopters", "dioptres"):
        raise PhotoError(
            f"{path}: its {what} is in {units}, which readers disagree on; save the map as a PNG and declare"
            " depth_unit = '1/m'"
        )
    if units not in _UNITS:
        # Near and far of no unit: shapes are right, but distances have to be declared.
        return StoredDepth(disparity, step, False, source, is_along_ray=is_along_ray)
    metres = _UNITS[units]
    return StoredDepth(disparity / metres, step / metres, False, source, "1/m", is_along_ray)
