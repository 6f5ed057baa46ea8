"""What a data set is drawn from: the tables of a spec, their checks, and how one is read."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, Strict, ValidationError, model_validator

from focusjax.config import ConfigError, Reach, Table, read_toml, sentence_for
from focusjax.dataset._distributions import (
    Distribution,
    always,
    drawn,
    drawn_whole,
    log_uniform,
    uniform,
)

MESH_ENDINGS = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
_STEEPEST = 80.0
"""Degrees between the horizon and the farthest corner of the frame: a wall has an end."""
_BRIGHTEST = 60000.0
"""Radiance that 16-bit floats hold."""

Kind = Literal["box", "patch", "sphere", "mesh"]
Texture = Literal["plain", "checks", "stripes", "spots", "noise"]
Size = Annotated[int, Field(ge=8, le=8192)]


class ScenesTable(Table):
    """`[scene]`: what stands where."""

    objects: drawn_whole(0, 64) = Field(  # type: ignore[valid-type]
        default=uniform(4, 9), description="the number of objects, such as {uniform = [4, 9]}"
    )
    kinds: Annotated[tuple[Kind, ...], Strict(False), Field(min_length=1)] | None = Field(
        default=None, description="what objects are: 'box', 'patch', 'sphere', or 'mesh' for those of meshes"
    )
    meshes: str | None = Field(
        default=None,
        description="a folder of mesh files, relative to the spec (glb, gltf, obj, ply, stl, off)",
    )
    distance_m: drawn(0.05, 1e4, " m") = Field(  # type: ignore[valid-type]
        default=log_uniform(0.8, 6.0), description="metres from the camera to where an object begins"
    )
    size_m: drawn(1e-3, 1e4, " m") = Field(  # type: ignore[valid-type]
        default=log_uniform(0.1, 0.6), description="the largest extent of an object in metres"
    )
    standing: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.5,
        description="the share of objects that stand on the ground where the frame shows it, 0 to 1",
    )
    textures: Annotated[tuple[Texture, ...], Strict(False), Field(min_length=1)] = Field(
        default=("plain", "checks", "stripes", "spots", "noise"),
        description="some of 'plain', 'checks', 'stripes', 'spots', 'noise'",
    )
    ground: bool = Field(default=True, description="false to leave out the ground")
    wall_m: drawn(0.1, 1e5, " m") = Field(  # type: ignore[valid-type]
        default=uniform(7.0, 10.0), description="metres from the camera to the wall behind everything"
    )
    lights: drawn_whole(0, 256) = Field(  # type: ignore[valid-type]
        default=always(0), description="the number of small bright spheres, which become discs of light"
    )
    light_radiance: drawn(1.5, _BRIGHTEST) = Field(  # type: ignore[valid-type]
        default=log_uniform(5.0, 50.0), description="how bright lights are; white paper is 1"
    )
    light_size_m: drawn(1e-4, 10.0, " m") = Field(  # type: ignore[valid-type]
        default=log_uniform(0.01, 0.03), description="the diameter of lights in metres"
    )

    @model_validator(mode="after")
    def _behind_all(self) -> "ScenesTable":
        if self.wall_m.ends[0] <= self.distance_m.ends[1]:
            raise ValueError(
                f"has a wall_m that may be {self.wall_m.ends[0]:g} m and a distance_m that may be"
                f" {self.distance_m.ends[1]:g} m; put the wall behind all objects"
            )
        return self

    @model_validator(mode="after")
    def _meshes_used(self) -> "ScenesTable":
        used = self.kinds is None or "mesh" in self.kinds
        if self.meshes is not None and not used:
            raise ValueError(
                "has meshes, but kinds without 'mesh'; add it to kinds, or leave one of them out"
            )
        if self.meshes is None and self.kinds is not None and "mesh" in self.kinds:
            raise ValueError("has kinds with 'mesh', but no meshes; give meshes, a folder of mesh files")
        return self

    @property
    def chosen_kinds(self) -> tuple[str, ...]:
        """What objects are: by default all that there is."""
        solids = ("box", "patch", "sphere")
        return self.kinds or (solids if self.meshes is None else (*solids, "mesh"))


class CamerasTable(Table):
    """`[camera]`: the frame, and where it looks from."""

    resolution: Annotated[tuple[Size, Size], Strict(False)] = Field(
        default=(256, 256), description="[width, height] in pixels"
    )
    focal_length_mm: drawn(1.0, 2000.0, " mm") | None = Field(  # type: ignore[valid-type]
        default=None, description="the focal length in mm; 50 if there is no field_of_view_deg"
    )
    field_of_view_deg: drawn(1.0, 120.0, " degrees") | None = Field(  # type: ignore[valid-type]
        default=None, description="the horizontal angle of view in degrees, instead of focal_length_mm"
    )
    sensor_width_mm: Annotated[float, Field(ge=1, le=1000)] = Field(
        default=36.0, description="the sensor's width in mm"
    )
    height_m: drawn(0.05, 1000.0, " m") = Field(  # type: ignore[valid-type]
        default=uniform(0.6, 1.6), description="metres of the camera above the ground"
    )
    pitch_deg: drawn(-60.0, 60.0, " degrees") = Field(  # type: ignore[valid-type]
        default=Distribution(normal=(-4.0, 4.0), within=(-15.0, 5.0)),
        description="degrees that the camera looks up; below 0 it looks down",
    )
    roll_deg: drawn(-180.0, 180.0, " degrees") = Field(  # type: ignore[valid-type]
        default=always(0.0), description="degrees that the camera is turned about its axis"
    )

    @model_validator(mode="after")
    def _one_length(self) -> "CamerasTable":
        if self.focal_length_mm is not None and self.field_of_view_deg is not None:
            raise ValueError("has focal_length_mm and field_of_view_deg; leave one of them out")
        steepest = math.degrees(math.atan(self.corner)) + max(abs(end) for end in self.pitch_deg.ends)
        if steepest > _STEEPEST:
            raise ValueError(
                f"sees up to {steepest:.0f} degrees from the horizon; expected at most {_STEEPEST:g}, so"
                " lower pitch_deg or the angle of view"
            )
        return self

    def focal_length(self, of: float | None = None) -> float:
        """Metres; `of` is what was drawn of the key that is given."""
        if self.field_of_view_deg is not None:
            angle = self.field_of_view_deg.ends[1] if of is None else of
            return 5e-4 * self.sensor_width_mm / math.tan(math.radians(angle) / 2.0)
        return 1e-3 * (self.length.ends[0] if of is None else of)

    @property
    def length(self) -> Distribution:
        """The key that says how long the lens is: millimetres, or degrees with `field_of_view_deg`."""
        return self.field_of_view_deg or self.focal_length_mm or always(50.0)

    @property
    def longest(self) -> float:
        """Metres of the longest focal length."""
        return self.focal_length(self.length.ends[self.field_of_view_deg is None])

    @property
    def corner(self) -> float:
        """Tangent of the largest angle between the view axis and a corner of the frame."""
        width, height = self.resolution
        half = 5e-4 * self.sensor_width_mm / self.focal_length()
        return half * math.hypot(1.0, height / width)


class LensesTable(Table):
    """`[lens]`: how wide it is open, and where it is focused."""

    f_number: drawn(0.5, 128.0) = Field(  # type: ignore[valid-type]
        default=log_uniform(1.0, 5.6), description="the f-number, such as {log_uniform = [1.4, 8]}"
    )
    focus_distance_m: drawn(0.02, 1e5, " m") | None = Field(  # type: ignore[valid-type]
        default=None, description="the focus distance in metres, instead of focus"
    )
    focus: Literal["an object"] | None = Field(
        default=None,
        description="'an object' to focus on one that is seen, the default without focus_distance_m",
    )

    @model_validator(mode="after")
    def _one_focus(self) -> "LensesTable":
        if self.focus_distance_m is not None and self.focus is not None:
            raise ValueError("has focus_distance_m and focus; leave one of them out")
        return self


class PicturesTable(Table):
    """`[render]`: how carefully pictures are made."""

    rays: Annotated[int, Field(ge=1, le=4096)] = Field(
        default=16, description="lens rays per pixel on the average, for example 16"
    )
    supersampling: Annotated[int, Field(ge=1, le=4)] = Field(
        default=1, description="layer samples along each side of a pixel, 1 to 4"
    )
    max_layers: Annotated[int, Field(ge=1, le=32)] = Field(
        default=8, description="the most layers to peel, for example 8"
    )


class Spec(Table):
    """What a data set is drawn from."""

    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = Field(
        default=0, description="a whole number that chooses the data set"
    )
    layers: bool = Field(default=False, description="true to keep the layers of each picture")
    scene: ScenesTable = Field(default=ScenesTable(), description="a [scene] table")
    camera: CamerasTable = Field(default=CamerasTable(), description="a [camera] table")
    lens: LensesTable = Field(default=LensesTable(), description="a [lens] table")
    render: PicturesTable = Field(default=PicturesTable(), description="a [render] table")
    _folder: Path = PrivateAttr(Path())

    @model_validator(mode="after")
    def _focusable(self) -> "Spec":
        distance = self.lens.focus_distance_m or self.scene.distance_m
        key = "scene.distance_m" if self.lens.focus_distance_m is None else "lens.focus_distance_m"
        nearest, longest = distance.ends[0], self.camera.longest
        if nearest <= 1.01 * longest:
            raise ValueError(
                f"has a {key} that may be {nearest:.3g} m, within a focal length of {longest:.3g} m; raise"
                " it, or shorten the lens"
            )
        return self

    @property
    def nearest(self) -> float:
        """Metres along the view axis to the nearest surface that the frame may show."""
        found = self.scene.distance_m.ends[0]
        if not self.scene.ground:
            return found
        down = math.radians(max(0.0, *(-end for end in self.camera.pitch_deg.ends)))
        return min(found, self.camera.height_m.ends[0] / (self.camera.corner + math.sin(down)))

    @property
    def mesh_folder(self) -> Path | None:
        """The folder of meshes."""
        return None if self.scene.meshes is None else self._folder / self.scene.meshes

    @property
    def mesh_files(self) -> tuple[Path, ...]:
        """All mesh files of the folder, sorted; they lie in it or in folders below."""
        folder = self.mesh_folder
        if folder is None:
            return ()
        found = [path for path in folder.rglob("*") if path.suffix.lower() in MESH_ENDINGS and path.is_file()]
        return tuple(sorted(found, key=lambda path: path.relative_to(folder).as_posix()))

    @property
    def identity(self) -> dict[str, Any]:
        """All that pictures depend on, for JSON: the keys, and names and sizes of the mesh files."""
        said = self.model_dump(mode="json", exclude_none=True)
        folder = self.mesh_folder
        if folder is not None:
            sizes = {path.relative_to(folder).as_posix(): path.stat().st_size for path in self.mesh_files}
            said["mesh_bytes"] = sizes
        return said


def spec_of(
    data: dict[str, Any], source: Path | str | None = None, *, root: Path | str | None = None
) -> Spec:
    """The spec that `data` says.

    Args:
        data: as TOML has it.
        source: the file that it is from, at whose folder relative paths start. Without one they start at the
            working directory, and meshes may lie anywhere.
        root: the folder below which the meshes of a file must lie; the file's own by default.

    Raises:
        ConfigError: an unknown key, an impossible distribution, or a folder without meshes. The message is
            one sentence that names the file, the key, the value and what to do.

    Example:
        >>> spec_of({"lens": {"f_number": {"log_uniform": [1.4, 8]}}}).lens.f_number.ends
        (1.4, 8.0)
    """
    said = Path("the spec" if source is None else source)
    try:
        spec = Spec.model_validate(data)
    except ValidationError as error:
        raise ConfigError(sentence_for(error, Spec, said)) from None
    spec._folder = said.parent.absolute()
    name, folder = spec.scene.meshes, spec.mesh_folder
    if name is None or folder is None:
        return spec
    if source is not None:
        try:
            Reach(said, None if root is None else Path(root)).file(name, "scene.meshes")
        except ValueError as error:
            raise ConfigError(f"{said}: {error}") from None
    if not folder.is_dir():
        raise ConfigError(f"{said}: scene.meshes is {name!r}, but there is no such folder; check the path")
    if not spec.mesh_files:
        raise ConfigError(
            f"{said}: scene.meshes is {name!r}, a folder without mesh files; expected some that end in"
            f" {', '.join(MESH_ENDINGS)}"
        )
    return spec


def load_spec(path: Path | str, *, root: Path | str | None = None) -> Spec:
    """The spec in a TOML file; `root` is that of `spec_of`.

    Raises:
        ConfigError: a file that cannot be read, or as `spec_of`.
    """
    if root is not None and not Path(root).is_dir():
        raise ConfigError(f"root {root} is not a folder; name the one below which the meshes lie")
    return spec_of(read_toml(Path(path)), path, root=root)
