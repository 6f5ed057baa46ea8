"""The shutter table of a config, in a photographer's units."""

import itertools
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, Strict, model_validator

from focusjax.config._shot import Placement, Pose
from focusjax.config._values import NotNegative, Positive, Share, Table, Time, seconds_of


class Moment(Table):
    """A keyframe within the shutter's time."""

    at: Share = Field(description="when: 0 as the shutter opens, 1 as it closes")


class ShutterCameraKey(Pose, Moment):
    """`[[shutter.camera]]`: where the camera of a still is at a time while its shutter is open."""


class ShutterObjectKey(Placement, Moment):
    """A keyframe of `[[shutter.objects]]`; what it leaves out is as in `[[scene.objects]]`."""


class ShutterObjectTable(Table):
    """`[[shutter.objects]]`: how an object of a still moves while the shutter is open."""

    name: str = Field(description="the name of an object of the scene")
    keys: Annotated[tuple[ShutterObjectKey, ...], Strict(False), Field(min_length=1)] = Field(
        description="keyframes such as { at = 0, translate = [0, 0, 0] }"
    )


class ShutterTable(Table):
    """`[shutter]`: what moves while the shutter is open is blurred.

    Its time is that of `[exposure]`, if there is one. What moves is said by a `[shot]`; of a still, by
    `camera` and `objects` here.
    """

    time: Time | None = Field(default=None, description='the shutter time in seconds, for example "1/50"')
    angle_deg: Annotated[float, Field(gt=0, le=360)] | None = Field(
        default=None, description="the shutter angle, 360 for as long as a frame, for example 180"
    )
    ramp: Share = Field(
        default=0.0, description="the share of its time in which it opens, and closes, 0 to 1"
    )
    curve: Annotated[tuple[NotNegative, ...], Strict(False), Field(min_length=2)] | None = Field(
        default=None, description="how far it is open at evenly spaced times, for example [0, 1, 1, 0]"
    )
    travel_time: Annotated[NotNegative, BeforeValidator(seconds_of)] = Field(
        default=0.0, description='the seconds a rolling shutter takes over the picture, for example "1/60"'
    )
    direction: Literal["down", "up"] = Field(
        default="down", description='"down" when lower rows come later, or "up"'
    )
    align: Literal["centre", "start", "end"] = Field(
        default="centre", description='"centre", "start" or "end", where in its time the frame\'s instant is'
    )
    turn_deg: Annotated[float, Field(gt=0, le=45)] = Field(
        default=11.5,
        description="by how much what moves may turn from its layers in degrees, for example 11.5",
    )
    step_px: Positive = Field(
        default=1.0,
        description="by how far what deforms may go from one time to the next in px, for example 1",
    )
    most_spans: Annotated[int, Field(ge=1, le=1024)] = Field(
        default=64, description="the most parts that its time is cut into, for example 64"
    )

    camera: Annotated[tuple[ShutterCameraKey, ...], Strict(False)] = Field(
        default=(), description="[[shutter.camera]] tables of a still, each with a time `at`"
    )
    objects: Annotated[tuple[ShutterObjectTable, ...], Strict(False)] = Field(
        default=(), description="[[shutter.objects]] tables of a still, each with a name"
    )

    @model_validator(mode="after")
    def _in_order(self) -> "ShutterTable":
        rows = [("the camera", self.camera), *((repr(each.name), each.keys) for each in self.objects)]
        for what, keys in rows:
            for earlier, later in itertools.pairwise(keys):
                if not earlier.at < later.at:
                    raise ValueError(
                        f"has a keyframe of {what} at {later.at:g} after one at {earlier.at:g}; put them in"
                        " ascending order, each time once"
                    )
        names = [each.name for each in self.objects]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"has two objects named {twice[0]!r}; join their tables")
        return self

    @model_validator(mode="after")
    def _one_of_each(self) -> "ShutterTable":
        if self.time is not None and self.angle_deg is not None:
            raise ValueError("has time and angle_deg, two times of one shutter; give one or the other")
        if self.curve is not None and self.ramp:
            raise ValueError("has ramp and curve; give one or the other")
        if self.curve is not None and not any(self.curve):
            raise ValueError("has a curve that lets no light through; raise one of its numbers above 0")
        return self
