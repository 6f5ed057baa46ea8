"""Files that claim more than there is memory for, refused by what their headers say."""

import json
import os
import struct
from pathlib import Path
from typing import Any

MOST_PIXELS = 1 << 27
"""Of one picture: 16384 x 8192 of a panorama, whose colours take 1.5 GiB; and samples of one layer."""
_MOST_ELEMENTS = 1 << 28
"""Vertices, indices and so on of one mesh file."""
_MOST_BYTES = 4 << 30
"""Of one file."""
_GLB_HEADER = 20


def check_pixels(size: tuple[int, int]) -> None:
    """Refuse a picture of too many pixels.

    Args:
        size: width and height.

    Raises:
        ValueError: more than `MOST_PIXELS`.
    """
    if size[0] * size[1] > MOST_PIXELS:
        raise ValueError(
            f"it has {size[0]} x {size[1]} pixels; expected at most {MOST_PIXELS / 1e6:.0f} million, so"
            " make it smaller"
        )


def check_bytes(path: Path) -> None:
    """Refuse a file that is too large.

    Raises:
        ValueError: more than 4 GiB.
    """
    size = os.path.getsize(path)
    if size > _MOST_BYTES:
        raise ValueError(f"it has {size / 2**30:.1f} GiB; expected at most {_MOST_BYTES >> 30} GiB")


def check_mesh(path: Path) -> None:
    """Refuse a mesh file that is too large, or a glTF file whose accessors are.

    An accessor without data means zeros, of which a few bytes of text may ask for any number.

    Raises:
        ValueError: what is too large, and the limit.
    """
    check_bytes(path)
    content = gltf_json(path)
    accessors = content.get("accessors") if isinstance(content, dict) else None
    counts = [each.get("count") for each in accessors or () if isinstance(each, dict)]
    total = sum(count for count in counts if isinstance(count, int) and count > 0)
    if total > _MOST_ELEMENTS:
        raise ValueError(
            f"its accessors have {total} elements; expected at most {_MOST_ELEMENTS}, so export a"
            " smaller mesh"
        )


def gltf_json(path: Path) -> Any:
    """The JSON of a glTF file; None of others, and of what the reader will refuse in its own words."""
    ending = path.suffix.lower()
    try:
        if ending == ".gltf":
            return json.loads(path.read_bytes())
        if ending == ".glb":
            with path.open("rb") as stream:
                header = stream.read(_GLB_HEADER)
                length = struct.unpack_from("<I", header, 12)[0]
                return json.loads(stream.read(min(length, os.path.getsize(path))))
    except (ValueError, RecursionError, struct.error):
        return None
    return None
