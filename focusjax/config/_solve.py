"""The solve table of a config: which settings may change, how far, and where they are expected."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._values import Millimetres, NotNegative, Number, Positive, Table

Degrees = Annotated[float, Field(gt=-90, lt=90)]
Name = Literal["focus", "f_number", "tilt", "swing", "focal_length", "shift", "rise"]


class FocusPrior(Table):
    """`[solve.prior.focus]`."""

    distance_m: Annotated[float, Field(gt=0)] = Field(description="the focus distance expected, in metres")
    sigma_per_m: Positive = Field(description="how far off it may be, in dioptres (1/m)")


class FNumberPrior(Table):
    """`[solve.prior.f_number]`."""

    value: Positive = Field(description="the f-number expected, for example 2.8")
    sigma_stops: Positive = Field(description="how far off it may be, in stops")


class AnglePrior(Table):
    """`[solve.prior.tilt]` and `[solve.prior.swing]`."""

    angle_deg: Degrees = Field(description="the angle expected, in degrees")
    sigma_deg: Positive = Field(description="how far off it may be, in degrees")


class FocalLengthPrior(Table):
    """`[solve.prior.focal_length]`."""

    length_mm: Millimetres = Field(description="the focal length expected, in mm")
    sigma_mm: Positive = Field(description="how far off it may be, in mm")


class SlidePrior(Table):
    """`[solve.prior.shift]` and `[solve.prior.rise]`."""

    length_mm: Number = Field(description="how far the lens is expected to slide, in mm")
    sigma_mm: Positive = Field(description="how far off it may be, in mm")


class PriorTable(Table):
    """`[solve.prior]`: what the settings are expected to be; one sigma off weighs as a pixel."""

    focus: FocusPrior | None = Field(default=None, description="distance_m and sigma_per_m")
    f_number: FNumberPrior | None = Field(default=None, description="value and sigma_stops")
    tilt: AnglePrior | None = Field(default=None, description="angle_deg and sigma_deg")
    swing: AnglePrior | None = Field(default=None, description="angle_deg and sigma_deg")
    focal_length: FocalLengthPrior | None = Field(default=None, description="length_mm and sigma_mm")
    shift: SlidePrior | None = Field(default=None, description="length_mm and sigma_mm")
    rise: SlidePrior | None = Field(default=None, description="length_mm and sigma_mm")


class SolveTable(Table):
    """`[solve]`: which settings may change, and how far."""

    free: Annotated[tuple[Name, ...], Strict(False), Field(min_length=1)] = Field(
        default=("focus",),
        description='some of ["focus", "f_number", "tilt", "swing", "focal_length", "shift", "rise"]',
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
    tilt_min_deg: Degrees = Field(default=-45.0, description="the least tilt in degrees, for example -8")
    tilt_max_deg: Degrees = Field(default=45.0, description="the largest tilt in degrees, for example 8")
    swing_min_deg: Degrees = Field(default=-45.0, description="the least swing in degrees, for example -8")
    swing_max_deg: Degrees = Field(default=45.0, description="the largest swing in degrees, for example 8")
    focal_length_min_mm: Millimetres | None = Field(
        default=None, description="the shortest focal length in mm, for example 24"
    )
    focal_length_max_mm: Millimetres | None = Field(
        default=None, description="the longest focal length in mm, for example 70"
    )
    shift_min_mm: Number | None = Field(
        default=None, description="the least shift in mm, for example -12; half the sensor's width by default"
    )
    shift_max_mm: Number | None = Field(default=None, description="the largest shift in mm, for example 12")
    rise_min_mm: Number | None = Field(
        default=None, description="the least rise in mm, for example -12; half the sensor's width by default"
    )
    rise_max_mm: Number | None = Field(default=None, description="the largest rise in mm, for example 12")
    keep_field_of_view: bool = Field(
        default=False, description="true to let the sensor grow with the focal length, instead of zooming"
    )
    favour_near: NotNegative = Field(
        default=0.0, description="how much more near wishes count: 1 makes the nearest count twice"
    )
    prior: PriorTable = Field(default=PriorTable(), description="a [solve.prior] table")

    solver: Literal["levenberg-marquardt", "dogleg", "jaxopt"] = Field(
        default="levenberg-marquardt",
        description='"levenberg-marquardt", or one to check it with: "dogleg", or "jaxopt" for its L-BFGS-B',
    )

    def idle_limits(self) -> list[tuple[str, Name]]:
        """Limits that are given of settings that are not free, with the name of the setting."""
        limits: dict[Name, tuple[str, ...]] = {
            "focus": ("min_focus_distance_m", "max_focus_distance_m"),
            "f_number": ("f_number_min", "f_number_max"),
            "tilt": ("tilt_min_deg", "tilt_max_deg"),
            "swing": ("swing_min_deg", "swing_max_deg"),
            "focal_length": ("focal_length_min_mm", "focal_length_max_mm", "keep_field_of_view"),
            "shift": ("shift_min_mm", "shift_max_mm"),
            "rise": ("rise_min_mm", "rise_max_mm"),
        }
        return [
            (key, name)
            for name, keys in limits.items()
            for key in keys
            if name not in self.free and key in self.model_fields_set
        ]

    @model_validator(mode="after")
    def _bounds_in_order(self) -> "SolveTable":
        if len(set(self.free)) != len(self.free):
            raise ValueError(f"has free = {list(self.free)}; name each setting once")
        units = {
            "f_number": "", "tilt": "_deg", "swing": "_deg",
            "focal_length": "_mm", "shift": "_mm", "rise": "_mm",
        }  # fmt: skip
        for name, unit in units.items():
            low_key, high_key = f"{name}_min{unit}", f"{name}_max{unit}"
            low, high = getattr(self, low_key), getattr(self, high_key)
            if low is not None and high is not None and low >= high:
                raise ValueError(
                    f"has {low_key} = {low:g}, which is not below {high_key} = {high:g}; swap the two, or"
                    f" leave {name} out of free"
                )
        if self.min_focus_distance_m is not None and self.min_focus_distance_m >= self.max_focus_distance_m:
            raise ValueError(
                f"has min_focus_distance_m = {self.min_focus_distance_m:g}, which is not below"
                f" max_focus_distance_m = {self.max_focus_distance_m:g}; swap the two"
            )
        if "focal_length" in self.free and None in (self.focal_length_min_mm, self.focal_length_max_mm):
            raise ValueError(
                "has focal_length free without a range; give focal_length_min_mm and focal_length_max_mm"
            )
        for name in PriorTable.model_fields:
            if getattr(self.prior, name) is not None and name not in self.free:
                raise ValueError(f"has prior.{name}, but {name} is not free; remove it or free {name}")
        return self
