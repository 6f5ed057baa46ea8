"""The height field of a config: its table, its files, and the lens that it makes."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image
from pydantic import Field

from focusjax.config._errors import about_key
from focusjax.config._glass import GlassTable
from focusjax.config._values import NotNegative, Number, Positive, Table
from focusjax.optics import Prescription, find_glass, height_field, height_field_lens
from focusjax.scene import exr_channels

_KINDS = "expected a grey PNG or TIFF of 16 bits, or floating-point OpenEXR of one channel or NPY"
_WHITE = 65535.0
"""Of 16 bits."""
_MOST = 4096
"""Rows of the largest picture of heights."""


class HeightFieldTable(Table):
    """`[lens.height_field]`: a piece of glass whose surfaces are pictures of heights.

    Alone it is the lens, scaled to the camera's focal length; with a prescription it stands ahead of that.
    """

    file: str = Field(
        description="the front's heights: a square, grey PNG of 16 bits, EXR or NPY file; white stands out"
    )
    back_file: str | None = Field(
        default=None, description="the back's heights, as seen from behind the lens; flat if left out"
    )
    width_mm: Positive = Field(
        description="mm from the middle of a picture's first column to that of its last, for example 30"
    )
    scale_mm: Number = Field(
        description="mm by which white, or 1, stands out of the glass beyond black, or 0, for example 2"
    )
    thickness_mm: Positive = Field(description="the thickness on the axis in mm, for example 5")
    diameter_mm: Positive | None = Field(
        default=None, description="the clear diameter in mm; as far as the heights go if left out"
    )
    ahead_mm: NotNegative | None = Field(
        default=None, description="how far in mm it stands ahead of the prescription's first surface"
    )
    glass: GlassTable = Field(description="its glass, for example {n_d = 1.5168, v_d = 64.17}")


def read_heights(path: Path) -> tuple[Float[np.ndarray, "h w"], float]:
    """Heights of a picture as they are, those of 16 bits from 0 to 1, and the step that they are rounded to.

    The step of floating-point numbers is 0.

    Raises:
        ValueError: no such file, one that cannot be read, of whole numbers of other than 16 bits, of several
            channels, or too large.
    """
    if not path.is_file():
        raise ValueError(f"{path}: there is no such picture of heights; check the path")
    try:
        kind = path.suffix.lower()
        if kind == ".npy":
            values = np.load(path, allow_pickle=False)
        elif kind == ".exr":
            values = _only_channel(exr_channels(path))
        else:
            with Image.open(path) as opened:
                values = np.asarray(opened)
    except Exception as error:
        raise ValueError(f"{path}: these heights cannot be read ({error}); {_KINDS}") from error
    if values.ndim != 2 or values.dtype.kind not in "fiu" or max(values.shape) > _MOST:
        raise ValueError(
            f"{path}: has heights of shape {values.shape} and type {values.dtype}; {_KINDS}, of at most"
            f" {_MOST} rows"
        )
    if values.dtype.itemsize == 1:
        raise ValueError(f"{path}: has 8 bits, whose 256 steps would be facets in glass; {_KINDS}")
    if values.dtype.kind in "iu" and values.dtype != np.uint16:
        raise ValueError(f"{path}: has whole numbers of type {values.dtype}; {_KINDS}")
    if values.dtype == np.uint16:
        return values.astype(float) / _WHITE, 1.0 / _WHITE
    return values.astype(float), 0.0


def _only_channel(channels: dict[str, np.ndarray]) -> np.ndarray:
    first, *others = channels.values()
    if any(not np.array_equal(first, other) for other in others):
        raise ValueError(f"its channels {', '.join(channels)} differ")
    return first


def height_lens(table: HeightFieldTable, front: Path, back: Path | None) -> Prescription:
    """The piece of glass of a table, from the files that it names.

    Raises:
        ValueError: a picture that cannot be used, or a lens that cannot be; the message names the file.
    """
    sides = []
    for path, towards in ((front, "scene"), (back, "film")):
        if path is None:
            continue
        picture, step = read_heights(path)
        with about_key(str(path)):
            side = height_field(
                picture, width=table.width_mm, scale=table.scale_mm, towards=towards, step=step
            )
            sides.append(side)
    return height_field_lens(
        *sides,
        thickness=table.thickness_mm,
        glass=table.glass.made(find_glass),
        semi_diameter=None if table.diameter_mm is None else table.diameter_mm / 2.0,
        name=front.stem,
    )
