"""The tables of a config that say what the lens's opening looks like."""

from typing import Annotated, Literal

from pydantic import Field, Strict

from focusjax.config._values import NotNegative, Number, Table


class OpeningTable(Table):
    """What any opening has."""

    squeeze: Annotated[float, Field(ge=1, le=4)] = Field(
        default=1.0, description="how many times narrower than high, from 1 (not) to 4, for example 1.5"
    )


class OutlineTable(OpeningTable):
    """What an opening with an outline has."""

    obstruction: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.0, description="the share of the diameter that is covered in the middle, for example 0.4"
    )
    transmission: Annotated[tuple[NotNegative, ...], Strict(False), Field(min_length=2)] | None = Field(
        default=None,
        description="light let through from the middle to the rim, two or more numbers as [1, 0.6, 0.1]",
    )


class DiskTable(OutlineTable):
    """A round opening."""

    shape: Literal["disk"]


class PolygonTable(OutlineTable):
    """An opening of straight or rounded blades."""

    shape: Literal["polygon"]
    blades: Annotated[int, Field(ge=3, le=64)] = Field(description="the number of blades, 3 or more")
    rotation_deg: Number = Field(
        default=0.0, description="the first corner's angle in degrees, clockwise from +x"
    )
    roundness: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.0, description="a roundness from 0 (straight blades) to 1 (a circle)"
    )


class ImageTable(OpeningTable):
    """An opening that is an image."""

    shape: Literal["image"]
    file: str = Field(description="an image file, white where light passes")
