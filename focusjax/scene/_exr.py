"""Channels of OpenEXR files as renderers name them: plain, in layers, or in parts."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import OpenEXR

from focusjax._quiet_exr import open_exr
from focusjax.scene._sizes import check_pixels

_COLOUR = ("", "rgba", "rgb", "beauty", "combined", "color", "colour")
"""Names of the layers with the picture itself, in the order in which they are taken."""


def exr_channels(path: str | Path) -> dict[str, np.ndarray]:
    """All channels [h, w] of a file by name, of all parts; where two parts have a name, the first one's.

    Raises:
        ValueError: too many pixels, deep pixels, or a file that is cut off or none of OpenEXR.
    """
    try:
        sizes, kinds = _heads(path)
        for size in sizes:
            check_pixels(size)
        if any(kind in (OpenEXR.deepscanline, OpenEXR.deeptile) for kind in kinds):
            raise ValueError("its pixels are deep; flatten them")
        found: dict[str, np.ndarray] = {}
        with open_exr(path) as opened:
            # Parts that cannot be read are left out.
            whole = len(opened.parts) == len(kinds)
            for part in opened.parts:
                for name, channel in part.channels.items():
                    found.setdefault(name, np.asarray(channel.pixels))
    except RuntimeError:
        found, whole = {}, False
    if not found or not whole:
        raise ValueError("it is cut off or damaged; copy it again")
    return found


def _heads(path: str | Path) -> tuple[list[tuple[int, int]], list[object]]:
    """Width and height of all parts, and their kinds."""
    with open_exr(path, header_only=True) as opened:
        windows = [part.header["dataWindow"] for part in opened.parts]
        sizes = [(int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1) for low, high in windows]
        return sizes, [part.type() for part in opened.parts]


def colour_channels(channels: Mapping[str, np.ndarray]) -> tuple[str, str, str] | None:
    """The names of red, green and blue: R, G and B, or those of the layer that has the picture.

    A layer's name may have others before it, as in `ViewLayer.Combined.R`.
    """
    layers = [name[:-1] for name in channels if name[-1:] == "R" and name[-2:-1] in ("", ".")]
    whole = [layer for layer in layers if all(layer + c in channels for c in "GB")]
    if not whole:
        return None
    best = min(whole, key=lambda layer: (_rank(last_word(layer.rstrip(".")), _COLOUR), len(layer)))
    return best + "R", best + "G", best + "B"


def last_word(name: str) -> str:
    """The last part of a channel's or layer's name, in small letters."""
    return name.rpartition(".")[2].lower()


def _rank(word: str, known: Sequence[str]) -> int:
    return known.index(word) if word in known else len(known)


def depth_channel(names: Iterable[str]) -> str | None:
    """The channel with depth: Z, or that of a layer such as `ViewLayer.Depth.Z`; None where there is none."""
    names = list(names)
    if "Z" in names:
        return "Z"
    for name in names:
        layer, _, channel = name.rpartition(".")
        if channel in ("Z", "V") and last_word(layer) in ("depth", "z"):
            return name
    plain = [name for name in names if name.lower() in ("depth", "y")]
    return (plain or (names if len(names) == 1 else [None]))[0]
