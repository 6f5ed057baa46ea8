"""What a shot says of its lens: values in some frames, and in which frames settings are free."""

from typing import Annotated

from pydantic import Field, model_validator

from focusjax.config._look import CatsEyesTable, ColourTable, Profile, SeidelTable
from focusjax.config._shot_keys import Key
from focusjax.config._solve import Name
from focusjax.config._values import Millimetres, Number, Positive, Table
from focusjax.config._view import Movement

SETTINGS: dict[str, Name] = {
    "focus_distance_m": "focus",
    "f_number": "f_number",
    "tilt_deg": "tilt",
    "swing_deg": "swing",
    "focal_length_mm": "focal_length",
    "shift_mm": "shift",
    "rise_mm": "rise",
}
"""What a solve calls the keys of `[[shot.lens]]` that it may find values for."""

ABERRATIONS = ("seidel", "power_profile", "colour", "cats_eyes")
"""The others: what the lens does to the picture beyond focusing."""


class LensKey(Key):
    """`[[shot.lens]]`: the lens in a frame; what a keyframe leaves out follows from those around it."""

    f_number: Positive | None = Field(default=None, description="the f-number, for example 2.8")
    focus_distance_m: Annotated[float, Field(gt=0)] | None = Field(
        default=None, description="the focus distance in metres, for example 2.5, or inf"
    )
    tilt_deg: Movement | None = Field(default=None, description="the lens's tilt in degrees, up to 45")
    swing_deg: Movement | None = Field(default=None, description="the lens's swing in degrees, up to 45")
    focal_length_mm: Millimetres | None = Field(default=None, description="the focal length in mm")
    shift_mm: Number | None = Field(default=None, description="how far in mm the lens slides to the right")
    rise_mm: Number | None = Field(default=None, description="how far in mm the lens slides up")
    seidel: SeidelTable | None = Field(default=None, description="third-order aberrations, as [lens.seidel]")
    power_profile: Profile | None = Field(
        default=None, description="dioptres by which zones focus nearer, as lens.power_profile"
    )
    colour: ColourTable | None = Field(default=None, description="differences of colours, as [lens.colour]")
    cats_eyes: CatsEyesTable | None = Field(default=None, description="cat's eyes, as [lens.cats_eyes]")

    @model_validator(mode="after")
    def _says_something(self) -> "LensKey":
        if not self.model_fields_set - {"frame"}:
            raise ValueError(
                f"has nothing at frame {self.frame:g}; give a setting such as focus_distance_m = 2"
            )
        return self


class FreeTable(Table):
    """`[[shot.free]]`: the frames in which a setting of `solve.free` is solved for."""

    name: Name = Field(description="the name of a setting in solve.free")
    from_frame: Number | None = Field(default=None, description="the first frame in which it is free")
    to_frame: Number | None = Field(default=None, description="the last frame in which it is free")

    def has(self, frame: float) -> bool:
        """Whether the setting is free in a frame."""
        after = self.from_frame is None or frame >= self.from_frame
        return after and (self.to_frame is None or frame <= self.to_frame)

    @property
    def frames(self) -> str:
        """The frames in words."""
        ends = ("from", self.from_frame), ("to", self.to_frame)
        return (
            " ".join(f"{word} frame {frame:g}" for word, frame in ends if frame is not None) or "everywhere"
        )

    @model_validator(mode="after")
    def _in_order(self) -> "FreeTable":
        if self.from_frame is not None and self.to_frame is not None and self.from_frame > self.to_frame:
            raise ValueError(
                f"has from_frame = {self.from_frame:g} after to_frame = {self.to_frame:g}; swap the two"
            )
        return self
