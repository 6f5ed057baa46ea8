"""The photo table of a config: a photograph with depth in place of meshes."""

from typing import Annotated, Literal

from pydantic import Field, Strict

from focusjax.config._values import NotNegative, Number, Positive, Table

Place = Annotated[tuple[Number, Number, Annotated[float, Field(gt=0)]], Strict(False)]
Value = Annotated[tuple[Number, Annotated[float, Field(gt=0)]], Strict(False)]


class PhotoTable(Table):
    """`[scene.photo]`: a photograph and its depth, which are all that is seen.

    Keys are the arguments of `focusjax.load_photo`, which says more.
    """

    file: str = Field(description="a photograph's path, relative to the config (jpg, png, tif, heic, exr)")
    depth: str | None = Field(
        default=None,
        description="a depth map's path (png, tif, npy, pfm, exr); left out, the photograph's own",
    )
    depth_unit: Literal["m", "mm", "1/m", "px", "relative"] | None = Field(
        default=None, description="'m', 'mm', '1/m', 'px' or 'relative', unless the file says it"
    )
    depth_scale: Positive = Field(
        default=1.0,
        description="what a stored value of 1 is in that unit, for example 0.0002 for 5000 a metre",
    )
    depth_invalid: Number | None = Field(default=None, description="the stored value that marks holes")
    depth_focal_px: Positive | None = Field(
        default=None, description="the stereo pair's focal length in the depth map's pixels, for px"
    )
    depth_offset_px: Number = Field(default=0.0, description="what is added to disparities in px")
    baseline_m: Positive | None = Field(
        default=None, description="the distance of the stereo pair's cameras in metres, for px"
    )
    anchors: Annotated[tuple[Place | Value, ...], Strict(False)] = Field(
        default=(), description="two of [x, y, metres] or [value, metres], for relative depth"
    )
    focal_length_35mm: Positive | None = Field(
        default=None, description="the focal length in mm as on 36 x 24 mm film, in place of EXIF's"
    )
    focal_length_px: Positive | None = Field(
        default=None, description="the focal length in pixels of the photograph, in place of EXIF's"
    )
    curve: Literal["srgb", "linear"] | Positive = Field(
        default="srgb", description="'srgb', 'linear', or the exponent of a power curve such as 2.2"
    )
    highlight_stops: NotNegative = Field(
        default=0.0, description="how much brighter white is than it could be stored, in stops, for example 2"
    )
    align_px: NotNegative | None = Field(
        default=None, description="pixels of the depth map by which its edges may be off, for example 2"
    )
    widest_f_number: Positive | None = Field(
        default=None,
        description="the widest f-number to prepare for; left out, that of the lens and the solve",
    )
