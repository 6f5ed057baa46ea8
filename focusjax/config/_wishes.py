"""The focus table of a config, and the places that it shares with a focal surface."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field, Strict, model_validator

from focusjax._words import listed
from focusjax.config._values import NotNegative, Number, Positive, Table, Vector


class PlaceTable(Table):
    """A table that names a place in one of several ways."""

    ways: ClassVar[tuple[str, ...]] = ("pixel", "point", "direction", "triangle", "object", "mask")

    name: str | None = Field(default=None, description="a name for the report")
    pixel: Annotated[tuple[Number, Number], Strict(False)] | None = Field(
        default=None, description="a place [x, y] in the picture, in pixels from the top left"
    )
    point: Vector | None = Field(default=None, description="a point [x, y, z] in the world, in metres")
    direction: Vector | None = Field(
        default=None, description="a direction [x, y, z] from the camera, for something infinitely far away"
    )
    triangle: Annotated[int, Field(ge=0)] | None = Field(
        default=None,
        description="a triangle's number, counted in the whole scene, or in `object` when that is given",
    )
    barycentric: Vector | None = Field(
        default=None, description="three weights of the triangle's corners, for example [0.2, 0.3, 0.5]"
    )
    object: str | None = Field(default=None, description="the name of an object in the scene")
    mask: str | None = Field(
        default=None, description="an image file of the picture's size, white on what is meant"
    )

    @property
    def places(self) -> list[str]:
        """The keys that say where; `object` with a triangle only says how that is counted."""
        given = [key for key in self.ways if getattr(self, key) is not None]
        return given if self.triangle is None else [key for key in given if key != "object"]

    @model_validator(mode="after")
    def _one_place(self) -> "PlaceTable":
        if len(self.places) < 2 and (self.triangle is None) != (self.barycentric is None):
            raise ValueError("needs triangle and barycentric together")
        if len(self.places) != 1:
            raise ValueError(f"needs exactly one of {listed(self.ways)} to say where")
        return self


class FocusTable(PlaceTable):
    """`[[focus]]`: one place in the scene and how sharp or blurred it should be."""

    ways: ClassVar[tuple[str, ...]] = (*PlaceTable.ways, "depth_m")

    depth_m: Annotated[tuple[Positive, Annotated[float, Field(gt=0)]], Strict(False)] | None = Field(
        default=None, description="a depth range [near, far] in metres along the view axis; far may be inf"
    )
    samples: Annotated[int, Field(ge=2, le=4096)] | None = Field(
        default=None, description="how many points of the object, mask or depth range to use, for example 64"
    )
    sharp: Literal[True] | None = Field(default=None, description="sharp = true, or a blur")
    blur_px: Number | None = Field(
        default=None,
        description="the blur's diameter in pixels; with signed = true, negative is in front of the focus",
    )
    blur_mm: Number | None = Field(default=None, description="the same in mm on the sensor")
    blur_height: Number | None = Field(default=None, description="the same as a share of the image's height")
    at_most_px: NotNegative | None = Field(default=None, description="the largest blur allowed, in pixels")
    at_most_mm: NotNegative | None = Field(default=None, description="the same in mm on the sensor")
    at_most_height: NotNegative | None = Field(
        default=None, description="the same as a share of the image's height"
    )
    at_least_px: NotNegative | None = Field(default=None, description="the least blur allowed, in pixels")
    at_least_mm: NotNegative | None = Field(default=None, description="the same in mm on the sensor")
    at_least_height: NotNegative | None = Field(
        default=None, description="the same as a share of the image's height"
    )
    same_blur_as: str | None = Field(
        default=None, description="the name of the focus point whose blur this one is to have"
    )
    shown_at: Annotated[tuple[Number, Number], Strict(False)] | None = Field(
        default=None,
        description="the place [x, y] in the picture, in pixels from the top left, where it is to be shown",
    )
    in_frame_px: NotNegative | None = Field(
        default=None, description="how far inside the frame all of it is to be at least, in pixels"
    )
    in_frame_mm: NotNegative | None = Field(default=None, description="the same in mm on the sensor")
    in_frame_height: NotNegative | None = Field(
        default=None, description="the same as a share of the image's height"
    )
    signed: bool = Field(
        default=False,
        description="signed = true to choose the side of the focus: by the sign of blur_px, or that of"
        " same_blur_as",
    )
    weight: NotNegative = Field(default=1.0, description="how much this wish counts, 0 or more")
    tolerance_px: NotNegative | None = Field(
        default=None, description="the largest miss in pixels that still counts as met; 1 when not given"
    )
    tolerance_mm: NotNegative | None = Field(default=None, description="the same in mm on the sensor")
    tolerance_height: NotNegative | None = Field(
        default=None, description="the same as a share of the image's height"
    )
    even_outside: bool = Field(default=False, description="true to let the wish count even outside the frame")
    even_hidden: bool = Field(
        default=False, description="true to let the wish count in full even when something hides it"
    )

    @model_validator(mode="after")
    def _spread(self) -> "FocusTable":
        if self.samples is not None and self.place_key not in ("object", "mask", "depth_m"):
            raise ValueError("has samples without an object to spread them on; remove samples")
        if self.depth_m is not None and not self.depth_m[0] < self.depth_m[1]:
            raise ValueError(f"has depth_m = {list(self.depth_m)}; give [near, far] with near below far")
        return self

    @model_validator(mode="after")
    def _one_wish(self) -> "FocusTable":
        given = self._wishes()
        if len(given) != 1:
            raise ValueError(
                "needs exactly one of sharp = true, blur_px, at_most_px, at_least_px, same_blur_as, shown_at"
                " and in_frame_px to say what is wished (lengths in _px, _mm or _height)"
                + (f"; it has {' and '.join(given)}" if given else "")
            )
        blur = given[0] if given[0].startswith("blur") else None
        if self.signed and blur is None and self.same_blur_as is None:
            raise ValueError("has signed without blur_px; remove signed, or give blur_px")
        if blur is not None and getattr(self, blur) < 0 and not self.signed:
            raise ValueError(
                f"has {blur} = {getattr(self, blur)} without a sign's meaning; add signed = true, or give 0"
                " or more"
            )
        if self.depth_m is not None and given[0].startswith(("shown_at", "in_frame")):
            raise ValueError(
                f"has depth_m, which is nowhere in the picture, and {given[0]}; give another place"
            )
        tolerances = (self.tolerance_px, self.tolerance_mm, self.tolerance_height)
        if sum(tolerance is not None for tolerance in tolerances) > 1:
            raise ValueError(
                "has several tolerances; give one of tolerance_px, tolerance_mm and tolerance_height"
            )
        return self

    def _wishes(self) -> list[str]:
        """The keys that say what is wished."""
        lengths = [
            f"{kind}_{unit}"
            for kind in ("blur", "at_most", "at_least", "in_frame")
            for unit in ("px", "mm", "height")
        ]
        keys = ["sharp", "same_blur_as", "shown_at", *lengths]
        return [key for key in keys if getattr(self, key) is not None]

    @property
    def place_key(self) -> str:
        """The key that says where."""
        return self.places[0]

    @property
    def wish_key(self) -> str:
        """The key that says what is wished."""
        return self._wishes()[0]

    @property
    def wants_a_value(self) -> bool:
        """Whether the wish is for sharpness or a blur, and not for a limit, another's blur or a place."""
        return any(getattr(self, key) is not None for key in ("sharp", "blur_px", "blur_mm", "blur_height"))
