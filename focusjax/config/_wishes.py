"""The focus, solve and render tables of a config."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._values import NotNegative, Number, Positive, Table, Vector


class FocusTable(Table):
    """`[[focus]]`: one place in the scene and how sharp or blurred it should be."""

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
    samples: Annotated[int, Field(ge=1, le=4096)] | None = Field(
        default=None, description="how many points of the object to use, for example 64"
    )
    sharp: Literal[True] | None = Field(default=None, description="sharp = true, or blur_px")
    blur_px: Number | None = Field(
        default=None,
        description="the blur's diameter in pixels; with signed = true, negative is in front of the focus",
    )
    signed: bool = Field(
        default=False, description="signed = true to choose the side of the focus by blur_px's sign"
    )
    weight: NotNegative = Field(default=1.0, description="how much this wish counts, 0 or more")
    tolerance_px: NotNegative = Field(
        default=1.0, description="the largest miss in pixels that still counts as met"
    )

    @model_validator(mode="after")
    def _one_place_one_wish(self) -> "FocusTable":
        by_object = self.object if self.triangle is None else None
        places = (self.pixel, self.point, self.direction, self.triangle, by_object)
        if sum(place is not None for place in places) != 1:
            raise ValueError("needs exactly one of pixel, point, direction, triangle and object to say where")
        if (self.triangle is None) != (self.barycentric is None):
            raise ValueError("needs triangle and barycentric together")
        if self.samples is not None and by_object is None:
            raise ValueError("has samples without an object to spread them on; remove samples")
        if (self.sharp is None) == (self.blur_px is None):
            raise ValueError("needs exactly one of sharp = true and blur_px to say what is wished")
        if self.blur_px is None and self.signed:
            raise ValueError("has signed without blur_px; remove signed, or give blur_px")
        if self.blur_px is not None and self.blur_px < 0 and not self.signed:
            raise ValueError(
                f"has blur_px = {self.blur_px} without a sign's meaning; add signed = true, or give 0 or more"
            )
        return self


class SolveTable(Table):
    """`[solve]`: which settings may change, and how far."""

    free: Annotated[tuple[Literal["focus", "f_number"], ...], Strict(False)] = Field(
        default=("focus",), description='["focus"] or ["focus", "f_number"]'
    )
    min_focus_distance_m: Positive | None = Field(
        default=None, description="the closest focus distance in metres, for example 0.45"
    )
    max_focus_distance_m: Annotated[float, Field(gt=0)] = Field(
        default=float("inf"), description="the farthest focus distance in metres, or inf"
    )
    f_number_min: Positive = Field(default=1.0, description="the lens's widest f-number, for example 1.4")
    f_number_max: Positive = Field(
        default=32.0, description="the lens's smallest opening as f-number, for example 22"
    )

    @model_validator(mode="after")
    def _bounds_in_order(self) -> "SolveTable":
        if "focus" not in self.free or len(set(self.free)) != len(self.free):
            raise ValueError('has an unusable free list; give free = ["focus"] or ["focus", "f_number"]')
        if self.f_number_min >= self.f_number_max:
            raise ValueError(
                f"has f_number_min = {self.f_number_min:g}, which is not below f_number_max ="
                f" {self.f_number_max:g}; swap the two, or leave f_number out of free"
            )
        if self.min_focus_distance_m is not None and self.min_focus_distance_m >= self.max_focus_distance_m:
            raise ValueError(
                f"has min_focus_distance_m = {self.min_focus_distance_m:g}, which is not below"
                f" max_focus_distance_m = {self.max_focus_distance_m:g}; swap the two"
            )
        return self


class RenderTable(Table):
    """`[render]`: how carefully the picture is made, and how it is shown."""

    rays: Annotated[int, Field(ge=1, le=65536)] = Field(
        default=64, description="lens rays per pixel, for example 64"
    )
    supersampling: Annotated[int, Field(ge=1, le=8)] = Field(
        default=2, description="layer samples along each side of a pixel, 1 to 8"
    )
    max_layers: Annotated[int, Field(ge=1, le=64)] = Field(
        default=16, description="the most layers to peel, up to 64"
    )
    view_dependent: bool = Field(
        default=False, description="true to let every lens ray see highlights and mirrors for itself"
    )
    exposure: Number = Field(default=0.0, description="the exposure in stops; 1 doubles the brightness")
    png_bits: Literal[8, 16] = Field(default=8, description="8 or 16 bits per channel for image.png")
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(
        default=0, description="a whole number that fixes the jitter"
    )
