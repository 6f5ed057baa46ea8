"""The camera and lens tables of a config."""

import math
from typing import Annotated

from pydantic import Field, Strict, field_validator, model_validator

from focusjax.config._focal_surface import FocalSurfaceTable
from focusjax.config._glass import ElementTable
from focusjax.config._height_field import HeightFieldTable
from focusjax.config._look import DiskTable, ImageTable, Look, PolygonTable
from focusjax.config._values import Millimetres, NotNegative, Number, Positive, Table, Vector
from focusjax.lens import CloseFocus
from focusjax.scene import MOST_PIXELS

Row = Annotated[tuple[Number, Number, Number, Number], Strict(False)]
Movement = Annotated[float, Field(ge=-45, le=45, allow_inf_nan=False)]
Pixels = Annotated[int, Field(ge=1, le=32768)]

_HALF_FIELD_DEG = 80.0
"""From the axis to the top of a frame that is higher than wide; beyond, pictures in perspective grow fast."""


class CameraTable(Table):
    """`[camera]`: where the camera stands, what it sees, and how many pixels the picture has."""

    file: str | None = Field(
        default=None,
        description="a USD or glTF file with a camera, whose pose and lens are taken; left out, scene.file",
    )
    from_: str | None = Field(
        default=None, alias="from", description="the camera's name in the file, if it has several"
    )
    position: Vector | None = Field(default=None, description="the camera's place [x, y, z] in metres")
    look_at: Vector | None = Field(default=None, description="a point [x, y, z] in metres on the view axis")
    up: Vector = Field(default=(0.0, 1.0, 0.0), description="the up direction [x, y, z]")
    matrix: Annotated[tuple[Row, Row, Row, Row], Strict(False)] | None = Field(
        default=None, description="the camera's pose as 4 rows of 4 numbers (world from camera, metres)"
    )
    sensor_width_mm: Millimetres = Field(default=36.0, description="the sensor's width in mm, for example 36")
    focal_length_mm: Millimetres | None = Field(
        default=None, description="the focal length in mm, for example 50"
    )
    field_of_view_deg: Annotated[float, Field(gt=0, lt=180)] | None = Field(
        default=None, description="the horizontal field of view in degrees, for example 40"
    )
    shift_mm: Number = Field(
        default=0.0, description="how far in mm the lens slides to the right over the sensor"
    )
    rise_mm: Number = Field(default=0.0, description="how far in mm the lens slides up over the sensor")
    resolution: Annotated[tuple[Pixels, Pixels], Strict(False)] = Field(
        description="the picture's [width, height] in pixels, for example [640, 480]"
    )

    @field_validator("resolution", mode="after")
    @classmethod
    def _fits_in_memory(cls, value: tuple[int, int]) -> tuple[int, int]:
        if value[0] * value[1] > MOST_PIXELS:
            raise ValueError(
                f"is [{value[0]}, {value[1]}], which is {value[0] * value[1] / 1e6:.0f} million pixels;"
                f" expected at most {MOST_PIXELS / 1e6:.0f} million, so give a smaller picture"
            )
        return value

    @model_validator(mode="after")
    def _one_pose_one_focal_length(self) -> "CameraTable":
        if self.matrix is not None:
            if self.position is not None or self.look_at is not None or "up" in self.model_fields_set:
                raise ValueError("has a matrix and also position, look_at or up; give one or the other")
        elif self.position is None or self.look_at is None:
            raise ValueError("has no full pose; give both position and look_at, or a matrix")
        if (self.focal_length_mm is None) == (self.field_of_view_deg is None):
            raise ValueError("needs exactly one of focal_length_mm and field_of_view_deg")
        return self

    @model_validator(mode="after")
    def _frame_within_sight(self) -> "CameraTable":
        """The sensor's width and the resolution say how high the sensor is, which may be metres."""
        width, height = self.resolution
        tall = self.sensor_width_mm * height / width
        focal = self.focal_length_mm
        if focal is None:
            assert self.field_of_view_deg is not None
            focal = self.sensor_width_mm / 2.0 / math.tan(math.radians(self.field_of_view_deg) / 2.0)
        # What is wide as well was meant so: the field of view across is given, or nearly.
        half = math.degrees(math.atan(tall / 2.0 / focal))
        if height > width and half > _HALF_FIELD_DEG:
            raise ValueError(
                f"has resolution = [{width}, {height}], which makes a sensor {self.sensor_width_mm:g} mm wide"
                f" {tall:g} mm high, for a field of view of {2.0 * half:.4g} degrees from top to bottom;"
                f" expected {2.0 * _HALF_FIELD_DEG:g} at most, so give a smaller sensor_width_mm or a longer"
                " focal length"
            )
        return self


class LensTable(Look):
    """`[lens]`: the lens as it is before solving; `render` uses it unchanged."""

    f_number: Positive | None = Field(default=None, description="the f-number, for example 2.8")
    aperture_radius_mm: NotNegative | None = Field(
        default=None, description="the aperture's radius in mm, for example 9; 0 is a pinhole"
    )
    focus_distance_m: Annotated[float, Field(gt=0)] | None = Field(
        default=None, description="the focus distance in metres, for example 2.5, or inf"
    )
    close_focus: CloseFocus = Field(
        default="ignored",
        description='what stays as the focus moves: "framing" or "breathing" (the focal length), or "ignored"'
        " for both",
    )
    sharp_from_m: Positive | None = Field(
        default=None, description="the nearest distance in metres to be sharp, instead of f_number and focus"
    )
    sharp_to_m: Annotated[float, Field(gt=0)] | None = Field(
        default=None, description="the farthest distance in metres to be sharp, or inf"
    )
    tilt_deg: Movement = Field(
        default=0.0, description="the lens's tilt in degrees, positive forwards (its axis down), up to 45"
    )
    swing_deg: Movement = Field(
        default=0.0, description="the lens's swing in degrees, positive to the right, up to 45"
    )
    aperture: Annotated[DiskTable | PolygonTable | ImageTable, Field(discriminator="shape")] = Field(
        default=DiskTable(shape="disk"),
        description='the opening, for example {shape = "polygon", blades = 6}, or {shape = "disk"}',
    )
    focal_surface: FocalSurfaceTable | None = Field(
        default=None, description="a [lens.focal_surface] table with its points"
    )
    prescription: str | None = Field(
        default=None,
        description="a real lens: a .dat, .zmx, .json or .toml file, or the name of one that comes along",
    )
    glass: Annotated[tuple[str, ...], Strict(False)] = Field(
        default=(), description="AGF catalogues for the prescription's glasses, relative to the config"
    )
    elements: Annotated[tuple[ElementTable, ...], Strict(False)] = Field(
        default=(), description="[[lens.elements]] tables"
    )
    height_field: HeightFieldTable | None = Field(
        default=None, description="a [lens.height_field] table, for a lens from pictures of its surfaces"
    )
    spectral: bool = Field(
        default=False, description="true to trace red, green and blue through the glass of a real lens"
    )
    spectral_bands: Annotated[int, Field(ge=3, le=15)] = Field(
        default=3, description="wavelengths from red to blue for spectral: an odd number"
    )
    fit_px: NotNegative | None = Field(
        default=None,
        description="pixels by which polynomials for a prescription's rays may be off, 0 for none; left out,"
        " as little as render.quality asks for, or 0.05 without one",
    )

    @property
    def real(self) -> str | None:
        """The key that makes it a real lens, through whose glass rays are traced; None of a thin one."""
        if self.prescription is not None:
            return "prescription"
        return None if self.height_field is None else "height_field"

    @model_validator(mode="after")
    def _bands_of_colour(self) -> "LensTable":
        if "spectral_bands" in self.model_fields_set and not self.spectral:
            raise ValueError("has spectral_bands, and spectral is not true; make it so, or leave them out")
        if self.spectral_bands % 2 == 0:
            raise ValueError(f"has {self.spectral_bands} spectral_bands; give an odd number")
        return self

    @model_validator(mode="after")
    def _one_glass_each(self) -> "LensTable":
        numbers = [each.element for each in self.elements]
        twice = [number for number in numbers if numbers.count(number) > 1]
        if twice:
            raise ValueError(f"has two glasses for element {twice[0]}; leave one of them out")
        coloured = [f"element {each.element}" for each in self.elements if each.glass.n is not None]
        if self.height_field is not None and self.height_field.glass.n is not None:
            coloured.append("the height_field")
        if coloured and not self.spectral:
            raise ValueError(
                f"has n of red, green and blue for {coloured[0]}, and spectral is not true; make it"
                " so, or give n_d and v_d"
            )
        return self

    @model_validator(mode="after")
    def _close_focus_of_a_thin_lens(self) -> "LensTable":
        """What has another image distance than a thin lens, or is stated for another focal length."""
        if self.close_focus == "ignored":
            return self
        why = {
            "prescription": "a prescription, whose glass says how image distance and framing change",
            "height_field": "a height_field, whose glass says how image distance and framing change",
            "focal_surface": "a focal_surface, whose image distance is another from place to place",
            "tilt_deg": "tilt_deg, with which the image distance is another from place to place",
            "swing_deg": "swing_deg, with which the image distance is another from place to place",
            "aperture_radius_mm": "aperture_radius_mm, which says nothing of the f-number; give f_number",
            "sharp_from_m": "sharp_from_m, which is found without it; give f_number and focus_distance_m",
            "profile": "a profile, which is for one focal length and distance",
        }
        stands = [key for key in why if getattr(self, key) != type(self).model_fields[key].default]
        if stands:
            raise ValueError(f"has close_focus = {self.close_focus!r} and {why[stands[0]]}; leave one out")
        if self.seidel is not None and self.seidel.wavefront():
            raise ValueError(
                f"has close_focus = {self.close_focus!r} and Seidel coefficients of a wavefront, which are"
                " for a lens without it; give them in pixels"
            )
        if self.colour is not None and self.colour.glass is not None:
            raise ValueError(
                f"has close_focus = {self.close_focus!r} and colour.glass, which is for one focal length;"
                " give colour.focus_offset"
            )
        return self

    @model_validator(mode="after")
    def _real_lens_alone(self) -> "LensTable":
        if self.prescription is None:
            own = ("glass", "elements", *(() if self.real else ("spectral", "spectral_bands", "fit_px")))
            idle = [key for key in own if key in self.model_fields_set]
            if idle:
                raise ValueError(f"has {idle[0]}, which is about a prescription, and none; name one")
        if self.height_field is not None:
            ahead = self.height_field.ahead_mm
            if (ahead is None) != (self.prescription is None):
                raise ValueError(
                    "has a height_field and a prescription, but not how far ahead of it; give ahead_mm"
                    if ahead is None
                    else "has ahead_mm in its height_field and no prescription to be ahead of; leave it out"
                )
        if self.real is None:
            return self
        others = ("aperture_radius_mm", "focal_surface")
        own = [key for key in others if getattr(self, key) != type(self).model_fields[key].default]
        if own:
            raise ValueError(f"has {own[0]}, which is of an ideal lens, and a {self.real}; leave one out")
        if self.look:
            raise ValueError(
                f"has {self.look[0]} and a {self.real}, which has a look of its own; leave one out"
            )
        return self

    @model_validator(mode="after")
    def _one_opening(self) -> "LensTable":
        if self.sharp_from_m is not None or self.sharp_to_m is not None:
            return self._one_depth()
        if (self.f_number is None) == (self.aperture_radius_mm is None):
            raise ValueError("needs exactly one of f_number and aperture_radius_mm")
        if self.focal_surface is not None and self.focus_distance_m is not None:
            raise ValueError("has focus_distance_m and a focal_surface; give one or the other")
        turned = [key for key in ("tilt_deg", "swing_deg") if getattr(self, key)]
        if self.focal_surface is not None and turned:
            raise ValueError(
                f"has {turned[0]} and a focal_surface, which needs a lens that is not turned; give one or the"
                " other"
            )
        if self.focal_surface is not None and self.aperture_radius_mm == 0:
            raise ValueError("has a focal_surface and aperture_radius_mm = 0; open the aperture")
        if self.aperture_radius_mm == 0 and self.look:
            raise ValueError(f"has {self.look[0]} and aperture_radius_mm = 0; open the aperture")
        if self.focus_distance_m is not None and math.isnan(self.focus_distance_m):
            raise ValueError("has focus_distance_m = nan; give metres, or inf")
        return self

    def _one_depth(self) -> "LensTable":
        """A depth of field gives focus and f-number."""
        if self.sharp_from_m is None or self.sharp_to_m is None:
            raise ValueError("has one of sharp_from_m and sharp_to_m; give both")
        if not self.sharp_from_m < self.sharp_to_m:
            raise ValueError(
                f"has sharp_from_m = {self.sharp_from_m:g}, which is not below sharp_to_m ="
                f" {self.sharp_to_m:g}"
            )
        idle = (
            "f_number",
            "aperture_radius_mm",
            "focus_distance_m",
            "tilt_deg",
            "swing_deg",
            "focal_surface",
        )
        given = [key for key in idle if getattr(self, key)]
        if given:
            raise ValueError(
                f"has sharp_from_m, which gives focus and f-number, and {given[0]}; leave one out"
            )
        return self
