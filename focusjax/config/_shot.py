"""The shot table of a config: what changes over the frames of a film, by keyframes."""

import itertools
from typing import Annotated, Any, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._look import CatsEyesTable, ColourTable, Profile, SeidelTable
from focusjax.config._solve import Name
from focusjax.config._values import Millimetres, NotNegative, Number, Positive, Table, Vector
from focusjax.config._view import Movement, Row

FrameCount = Annotated[int, Field(ge=1, le=100_000)]

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


class Key(Table):
    """A keyframe."""

    frame: Number = Field(description="the keyframe's frame; the shot's first one is 1")


def in_order(keys: tuple[Key, ...], what: str) -> None:
    """Refuse keyframes that are not in ascending order."""
    for earlier, later in itertools.pairwise(keys):
        if not earlier.frame < later.frame:
            raise ValueError(
                f"has a keyframe of {what} at frame {later.frame:g} after one at frame {earlier.frame:g}; put"
                " them in ascending order, each frame once"
            )


def values_of(keys: tuple[Any, ...], name: str) -> dict[float, Any]:
    """One key's values by frame, of the keyframes that have it."""
    return {key.frame: value for key in keys if (value := getattr(key, name)) is not None}


def ends_in_order(from_frame: float | None, to_frame: float | None) -> None:
    """Refuse a stretch of frames that ends before it begins."""
    if from_frame is not None and to_frame is not None and from_frame > to_frame:
        raise ValueError(f"has from_frame = {from_frame:g} after to_frame = {to_frame:g}; swap the two")


class Pose(Table):
    """Where a camera is, in a keyframe."""

    position: Vector | None = Field(default=None, description="the camera's place [x, y, z] in metres")
    look_at: Vector | None = Field(default=None, description="a point [x, y, z] in metres on the view axis")
    matrix: Annotated[tuple[Row, Row, Row, Row], Strict(False)] | None = Field(
        default=None, description="the camera's pose as 4 rows of 4 numbers (world from camera, metres)"
    )
    focal_length_mm: Millimetres | None = Field(default=None, description="the focal length in mm")


class Placement(Table):
    """Where an object is, in a keyframe; what it leaves out is as in `[[scene.objects]]`."""

    translate: Vector | None = Field(default=None, description="a shift [x, y, z] in metres")
    rotate_deg: Vector | Annotated[tuple[Number, Number, Number, Number], Strict(False)] | None = Field(
        default=None,
        description="degrees about the world's x, then y, then z axis, or an axis and degrees about it",
    )
    scale: Number | Vector | None = Field(default=None, description="one factor, or three for x, y and z")


class CameraKey(Pose, Key):
    """`[[shot.camera]]`: where the camera is in a frame."""


class ObjectKey(Placement, Key):
    """A keyframe of `[[shot.objects]]`; what it leaves out is as in `[[scene.objects]]`."""


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
        ends_in_order(self.from_frame, self.to_frame)
        return self


class MovingObjectTable(Table):
    """`[[shot.objects]]`: how an object of the scene moves, deforms, or both."""

    name: str = Field(description="the name of an object of the scene")
    keys: Annotated[tuple[ObjectKey, ...], Strict(False)] = Field(
        default=(), description="keyframes such as { frame = 1, translate = [0, 0, 0] }"
    )
    vertices: str | None = Field(
        default=None,
        description="an .npz file of one array [steps, vertices, 3], or numbered meshes as in walk_####.ply",
    )
    first_frame: Number | None = Field(default=None, description="the frame of the first set of vertices")
    frames_per_step: Positive | None = Field(
        default=None, description="the frames from one set of vertices to the next"
    )

    @model_validator(mode="after")
    def _something_changes(self) -> "MovingObjectTable":
        in_order(self.keys, repr(self.name))
        if not self.keys and self.vertices is None:
            raise ValueError("has neither keys nor vertices; give one of them, or remove the object")
        if self.vertices is None and (self.first_frame, self.frames_per_step) != (None, None):
            raise ValueError("has first_frame or frames_per_step without vertices; remove them")
        return self


class WishKey(Key):
    """A keyframe of `[[shot.wishes]]`."""

    weight: NotNegative | None = Field(default=None, description="how much the wish counts, 0 or more")
    blur: Number | None = Field(
        default=None, description="the wished blur (or limit to it), in the unit of the [[focus]] table"
    )
    point: Vector | None = Field(default=None, description="the wish's point [x, y, z] in metres")
    pixel: Annotated[tuple[Number, Number], Strict(False)] | None = Field(
        default=None, description="the wish's place [x, y] in the picture, in pixels"
    )


class TimedWishTable(Table):
    """`[[shot.wishes]]`: when a wish of `[[focus]]` acts, and how it changes."""

    name: str = Field(description="the name of a [[focus]] table")
    from_frame: Number | None = Field(default=None, description="the first frame in which the wish acts")
    to_frame: Number | None = Field(default=None, description="the last frame in which the wish acts")
    keys: Annotated[tuple[WishKey, ...], Strict(False)] = Field(
        default=(), description="keyframes such as { frame = 1, weight = 1 }"
    )

    @model_validator(mode="after")
    def _in_order(self) -> "TimedWishTable":
        in_order(self.keys, repr(self.name))
        ends_in_order(self.from_frame, self.to_frame)
        return self


class SurfaceKey(Key):
    """A keyframe of `[[shot.surface]]`; what it leaves out is as in `[[lens.focal_surface.points]]`."""

    point: Vector | None = Field(default=None, description="the point [x, y, z] in metres")
    pixel: Annotated[tuple[Number, Number], Strict(False)] | None = Field(
        default=None, description="the place [x, y] in the picture, in pixels"
    )
    blur_px: Number | None = Field(default=None, description="the signed blur wished there, in pixels")
    aperture_scale: Positive | None = Field(
        default=None, description="the aperture there in apertures of the lens"
    )
    weight: NotNegative | None = Field(default=None, description="how widely the point rules, 0 or more")


class TimedControlTable(Table):
    """`[[shot.surface]]`: when a control point of the focal surface is there, and how it changes."""

    name: str = Field(description="the name of a [[lens.focal_surface.points]] table")
    from_frame: Number | None = Field(default=None, description="the first frame in which the point is there")
    to_frame: Number | None = Field(default=None, description="the last frame in which the point is there")
    keys: Annotated[tuple[SurfaceKey, ...], Strict(False)] = Field(
        default=(), description="keyframes such as { frame = 1, blur_px = 0 }"
    )

    @model_validator(mode="after")
    def _in_order(self) -> "TimedControlTable":
        ends_in_order(self.from_frame, self.to_frame)
        in_order(self.keys, repr(self.name))
        return self


class ShotTable(Table):
    """`[shot]`: a film of the config's scene, for `focusjax shot`.

    What it does not mention is in all frames as in the rest of the config.
    """

    frames: FrameCount = Field(
        description="the number of frames, for example 48 (by default that of a USD stage)"
    )
    fps: Positive = Field(default=24.0, description="frames per second of the film")
    smoothness: NotNegative = Field(
        default=100.0,
        description="the weight of a blur whose change quickens by 1 px per frame^2, for example 100",
    )
    steadiness: NotNegative = Field(
        default=1.0, description="the weight of a blur that changes by 1 px per frame"
    )
    fade_frames: NotNegative = Field(
        default=6.0, description="the frames over which wishes come and go, 0 for none"
    )
    between: Literal["smooth", "linear"] = Field(
        default="smooth", description='"smooth" or "linear", the way from one keyframe to the next'
    )
    formats: Annotated[tuple[Literal["png", "exr", "mp4"], ...], Strict(False), Field(min_length=1)] = Field(
        default=("png",), description='some of ["png", "exr", "mp4"]'
    )
    long_exposure: bool = Field(
        default=False,
        description="true to make one picture of the frames that are rendered as well, as bright as one, with"
        " trails of what moves; they get rays of their own, and OpenEXR files",
    )
    camera: Annotated[tuple[CameraKey, ...], Strict(False)] = Field(
        default=(), description="[[shot.camera]] tables, each with a frame"
    )
    lens: Annotated[tuple[LensKey, ...], Strict(False)] = Field(
        default=(), description="[[shot.lens]] tables, each with a frame"
    )
    free: Annotated[tuple[FreeTable, ...], Strict(False)] = Field(
        default=(), description="[[shot.free]] tables, each with a name of solve.free and frames"
    )
    keep_field_of_view: bool = Field(
        default=False,
        description="true to let the sensor grow with keyframes of the focal length, so that the frame stays",
    )
    keep_size_of: str | Vector | None = Field(
        default=None,
        description="an object's name or a point [x, y, z] whose size in the picture the focal length keeps"
        " while the camera moves (a dolly zoom)",
    )
    objects: Annotated[tuple[MovingObjectTable, ...], Strict(False)] = Field(
        default=(), description="[[shot.objects]] tables, each with a name"
    )
    wishes: Annotated[tuple[TimedWishTable, ...], Strict(False)] = Field(
        default=(), description="[[shot.wishes]] tables, each with a name"
    )

    surface: Annotated[tuple[TimedControlTable, ...], Strict(False)] = Field(
        default=(), description="[[shot.surface]] tables, each with a name of a focal surface's point"
    )

    @model_validator(mode="after")
    def _fits_together(self) -> "ShotTable":
        in_order(self.camera, "the camera")
        in_order(self.lens, "the lens")
        for what in ("objects", "wishes", "free", "surface"):
            tables = getattr(self, what)
            names = [table.name for table in tables]
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise ValueError(f"has two {what} named {twice[0]!r}; join their tables")
        aimed = any(key.position is not None or key.look_at is not None for key in self.camera)
        if aimed and any(key.matrix is not None for key in self.camera):
            raise ValueError(
                "has keyframes of the camera with position or look_at and others with a matrix; give all of"
                " one kind"
            )
        return self

    @model_validator(mode="after")
    def _one_zoom(self) -> "ShotTable":
        """The focal length comes from one place."""
        keyed = [
            f"shot.{where}"
            for where, keys in (("camera", self.camera), ("lens", self.lens))
            if any(key.focal_length_mm is not None for key in keys)
        ]
        if len(keyed) > 1:
            raise ValueError(
                "has keyframes of focal_length_mm in shot.camera and in shot.lens; give them in one place"
            )
        if keyed and self.keep_size_of is not None:
            raise ValueError(
                "has keep_size_of, which sets the focal length, and keyframes of focal_length_mm in"
                f" {keyed[0]}; leave one of them out"
            )
        if self.keep_field_of_view and not keyed:
            raise ValueError("has keep_field_of_view and no keyframes of focal_length_mm; leave it out")
        return self
