"""Reading a config: TOML, then overrides, then validation."""

import dataclasses
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, Strict, ValidationError, model_validator

from focusjax._words import nearest_name
from focusjax.config._errors import ConfigError, key_path, sentence_for
from focusjax.config._exposure import ExposureTable, FilmTable
from focusjax.config._left_to_files import with_camera_of_file, with_camera_of_photo, with_shot_of_file
from focusjax.config._reach import Reach, texts
from focusjax.config._render import RenderTable
from focusjax.config._scene import SceneTable
from focusjax.config._shot import ShotTable
from focusjax.config._shutter import ShutterTable
from focusjax.config._solve import SolveTable
from focusjax.config._values import Table
from focusjax.config._view import CameraTable, LensTable
from focusjax.config._wishes import FocusTable
from focusjax.scene import MOST_PIXELS

_LARGEST = 16 << 20
"""Bytes of the largest config that is read."""


class Config(Table):
    """Everything one run needs, as a person wrote it: a scene, a camera, a lens, and the wishes."""

    title: str = Field(default="", description="a title for the report")
    scene: SceneTable = Field(description="a [scene] table")
    camera: CameraTable = Field(description="a [camera] table")
    lens: LensTable = Field(description="a [lens] table")
    focus: Annotated[tuple[FocusTable, ...], Strict(False)] = Field(
        default=(), description="[[focus]] tables"
    )
    solve: SolveTable = Field(default=SolveTable(), description="a [solve] table")
    render: RenderTable = Field(default=RenderTable(), description="a [render] table")
    exposure: ExposureTable | None = Field(default=None, description="an [exposure] table")
    film: FilmTable | None = Field(default=None, description="a [film] table")
    shot: ShotTable | None = Field(default=None, description="a [shot] table with the number of frames")
    shutter: ShutterTable | None = Field(default=None, description="a [shutter] table")
    _reach: Reach = PrivateAttr(Reach())

    @model_validator(mode="before")
    @classmethod
    def _exposed_while_the_shutter_is_open(cls, values: Any) -> Any:
        """The time of an `[exposure]` that has none is the shutter's."""
        if not isinstance(values, dict):
            return values
        shutter, exposure, shot = (values.get(key) for key in ("shutter", "exposure", "shot"))
        if not (isinstance(shutter, dict) and isinstance(exposure, dict)) or "time" in exposure:
            return values
        time, angle = shutter.get("time"), shutter.get("angle_deg")
        if time is None and isinstance(angle, int | float):
            usual = ShotTable.model_fields["fps"].default
            fps = shot.get("fps", usual) if isinstance(shot, dict) else None
            time = angle / 360.0 / fps if isinstance(fps, int | float) and fps > 0 else None
        return values if time is None else {**values, "exposure": {**exposure, "time": time}}

    @model_validator(mode="after")
    def _focal_surface_alone(self) -> "Config":
        """A focal surface has control values to solve for, and nothing else."""
        if self.lens.focal_surface is None:
            return self
        settings = self.solve.model_fields_set - {"favour_near"}
        if settings:
            raise ValueError(
                f"has lens.focal_surface and solve.{min(settings)}, but of a focal surface only the focus of"
                " its points is solved for; leave one of them out"
            )
        for number, wish in enumerate(self.focus):
            if not wish.wants_a_value:
                raise ValueError(
                    f"has lens.focal_surface, but focus.{number} wishes for neither sharp nor a blur; a"
                    " focal surface is solved for these two alone"
                )
        return self

    @model_validator(mode="after")
    def _real_lens_that_turns(self) -> "Config":
        """Glass is turned where it is the same all around its axis."""
        turned = [f"solve.free has {name!r}" for name in self.solve.free if name in ("tilt", "swing")]
        turned += [f"lens.{key} is given" for key in ("tilt_deg", "swing_deg") if getattr(self.lens, key)]
        if self.lens.height_field is not None and turned:
            raise ValueError(
                f"has lens.height_field, but {turned[0]}; a lens with a height field is not turned, so leave"
                " one of them out"
            )
        return self

    @model_validator(mode="after")
    def _close_focus_of_a_level_lens(self) -> "Config":
        """A model of close focus is for a thin lens on its standard, whose f-number wishes alone say."""
        model = self.lens.close_focus
        if model == "ignored":
            return self
        breathes = model == "breathing"
        turned = [name for name in self.solve.free if name not in ("focus", "f_number")]
        reasons = {
            "exposure.priority, which weighs f-numbers without it": self.exposure is not None
            and self.exposure.priority is not None,
            "shot.keep_size_of, whose size the focus would change": breathes
            and self.shot is not None
            and self.shot.keep_size_of is not None,
            "shot.keep_field_of_view, which the focus would change": breathes
            and self.shot is not None
            and self.shot.keep_field_of_view,
            "scene.photo, which is framed already, as 'framing' leaves it": breathes
            and self.scene.photo is not None,
            f"{turned[0] if turned else ''!r} in solve.free, where only focus and f_number may be": bool(
                turned
            ),
            "solve.prior.focus, which is in dioptres": self.solve.prior.focus is not None,
        }
        for reason, stands in reasons.items():
            if stands:
                raise ValueError(f"has lens.close_focus = {model!r} and {reason}; leave one of them out")
        return self

    @model_validator(mode="after")
    def _layers_of_a_size(self) -> "Config":
        width, height = self.camera.resolution
        fine = self.render.supersampling
        samples = width * height * fine**2
        if samples > MOST_PIXELS:
            raise ValueError(
                f"has camera.resolution = [{width}, {height}] and render.supersampling = {fine}, which is"
                f" {samples / 1e6:.0f} million samples a layer; expected at most {MOST_PIXELS / 1e6:.0f}"
                " million, so lower one of them"
            )
        return self

    @model_validator(mode="after")
    def _one_exposure(self) -> "Config":
        """Stops are counted once, and noise takes a speed."""
        if self.exposure is not None and "exposure" in self.render.model_fields_set:
            raise ValueError("has render.exposure and an [exposure] table; use exposure.compensation instead")
        if self.exposure is None and self.film is not None and self.film.noise is not None:
            raise ValueError("has film.noise without an [exposure], whose speed it depends on; give both")
        return self

    @model_validator(mode="after")
    def _aperture_to_choose(self) -> "Config":
        """Focus and light have to share an f-number that may change."""
        if self.exposure is None or self.exposure.priority is None or self.lens.sharp_from_m is not None:
            return self
        if self.lens.focal_surface is not None or "f_number" not in self.solve.free:
            raise ValueError(
                "has exposure.priority, but no f-number that may change; give lens.sharp_from_m and"
                ' sharp_to_m, or add "f_number" to solve.free'
            )
        return self

    @model_validator(mode="after")
    def _one_shutter(self) -> "Config":
        """What moves is said by a shot, and how long light falls on it once."""
        table = self.shutter
        if table is None:
            return self
        keyed = [f"shutter.{name}" for name in ("camera", "objects") if getattr(table, name)]
        if self.shot is None and not keyed:
            raise ValueError(
                "has a [shutter] and nothing that moves; give [[shutter.camera]] or [[shutter.objects]]"
                " tables with keyframes, or a [shot], or leave the [shutter] out"
            )
        if self.shot is not None and keyed:
            raise ValueError(
                f"has a [shot], whose keyframes say what moves, and {keyed[0]}; leave one of them out"
            )
        if self.shot is None and table.angle_deg is not None:
            raise ValueError(
                "has shutter.angle_deg, a share of a frame, and no [shot] with frames; give shutter.time"
                " instead"
            )
        if self.shot is None and self.render.method == "auto":
            raise ValueError(
                "has a [shutter] and render.method = 'auto', which is for what stands still; say 'trace' or"
                " 'post'"
            )
        seconds, exposed = self.shutter_seconds, None if self.exposure is None else self.exposure.time
        if seconds is None:
            raise ValueError(
                "has a [shutter] of no time; give it a time or an angle_deg, or [exposure] a time"
            )
        if exposed is not None and not math.isclose(exposed, seconds, rel_tol=1e-6):
            raise ValueError(
                f"has exposure.time = {exposed:g} s and a [shutter] open for {seconds:g} s; leave one of the"
                " two out"
            )
        return self

    @model_validator(mode="after")
    def _frames_alike(self) -> "Config":
        """What is chosen for one frame would show in the next, and again where a shot is gone on with."""
        if self.shot is not None and self.render.method == "auto":
            raise ValueError(
                "has a [shot] and render.method = 'auto', but frames of a shot are all made alike; say"
                " 'trace' or 'post'"
            )
        return self

    def weighs(self, *, solving: bool) -> bool:
        """Whether focus and light are to share an f-number, with a solve or without."""
        if self.exposure is None or self.exposure.priority is None:
            return False
        return self.lens.sharp_from_m is not None or (solving and "f_number" in self.solve.free)

    @property
    def shutter_seconds(self) -> float | None:
        """The time of the shutter in seconds; None without a `[shutter]`, or without a time."""
        table = self.shutter
        if table is None:
            return None
        if table.time is not None:
            return table.time
        if table.angle_deg is not None and self.shot is not None:
            return table.angle_deg / 360.0 / self.shot.fps
        return None if self.exposure is None else self.exposure.time

    @property
    def widest_f_number(self) -> float:
        """The f-number of the widest lens that a photograph is prepared for.

        By `widest_f_number` of `[scene.photo]`, or else by the f-numbers that the lens has or may get.
        """
        table, lens = self.scene.photo, self.lens
        if table is not None and table.widest_f_number is not None:
            return table.widest_f_number
        found = [] if lens.f_number is None else [lens.f_number]
        if lens.aperture_radius_mm and self.camera.focal_length_mm is not None:
            found.append(self.camera.focal_length_mm / (2.0 * lens.aperture_radius_mm))
        if "f_number" in self.solve.free or lens.sharp_from_m is not None:
            found.append(self.solve.f_number_min)
        return min(found, default=self.solve.f_number_min)

    @property
    def source(self) -> Path:
        """The file this config was read from; relative paths in it start at that file's folder."""
        return self._reach.source

    @property
    def reach(self) -> Reach:
        """Where the files that it names may lie."""
        return self._reach

    def anywhere(self) -> "Config":
        """The same config with absolute paths of its own, to be used by a process in another folder."""
        same = self.model_copy()
        root = None if self._reach.root is None else self._reach.root.absolute()
        same._reach = dataclasses.replace(self._reach, source=self.source.absolute(), root=root)
        return same


def load_config(path: Path | str, overrides: Sequence[str] = (), *, root: Path | str | None = None) -> Config:
    """Read and check the config at `path`.

    Args:
        path: a TOML file.
        overrides: `key=value` strings, later ones winning. The key is a dotted path in which tables of
            an array go by number from 0 (`focus.0.blur_px=12`); the value is TOML, or plain text when it
            is not. Files that they name may lie anywhere.
        root: the folder below which all other files must lie; the config's own by default.

    Raises:
        ConfigError: an unreadable file, a broken override, an unknown key or a value out of place. The
            message is one sentence that names the file, the key, the value and what to do.
    """
    path = Path(path)
    if root is not None and not Path(root).is_dir():
        raise ConfigError(f"root {root} is not a folder; name the one below which the config's files lie")
    data = read_toml(path)
    set_keys(data, overrides)
    named = [toml_value(override.partition("=")[2]) for override in overrides]
    return config_of(data, Reach(path, None if root is None else Path(root), frozenset(texts(named))))


def parse_config(text: str, source: Path | str, *, root: Path | str | None = None) -> Config:
    """As `load_config`, of text that is not written to `source` yet, where its relative paths start.

    Raises:
        ConfigError: as `load_config`.
    """
    source = Path(source)
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise _no_toml(source, error) from None
    return config_of(data, Reach(source, None if root is None else Path(root)))


def config_of(data: dict[str, Any], reach: Reach) -> Config:
    """The config that `data` says; `reach.source` is its file, or what stands for one in messages.

    A `[scene.photo]` gives the camera that took it, a file with a camera gives that camera and its lens, and
    a `[scene] file` that moves gives the frames of a `[shot]`; what the tables themselves say goes before.

    Raises:
        ConfigError: as `load_config`.
    """
    source = reach.source
    try:
        filled = with_shot_of_file(with_camera_of_file(with_camera_of_photo(data, reach), reach), data, reach)
        config = Config.model_validate(filled)
    except ValidationError as error:
        raise ConfigError(sentence_for(error, Config, source)) from None
    config._reach = reach
    return config


def _no_toml(path: Path, error: Exception) -> ConfigError:
    if isinstance(error, UnicodeDecodeError):
        return ConfigError(f"{path}: this is not text in UTF-8 ({error.reason}); save it as UTF-8")
    if isinstance(error, RecursionError):
        return ConfigError(f"{path}: has tables or arrays nested too deep to read; write it flatter")
    return ConfigError(f"{path}: this is not valid TOML ({error}); mend that line")


def read_toml(path: Path) -> dict[str, Any]:
    """What the TOML file at `path` says, unchecked.

    Raises:
        ConfigError: an unreadable file, or one that is no TOML.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise ConfigError(f"{path}: is larger than {_LARGEST >> 20} MiB; expected a config file")
        # Editors on Windows begin files with a byte-order mark, which TOML does not know.
        return tomllib.loads(data.decode("utf-8-sig"))
    except FileNotFoundError:
        near = nearest_name(path.name, (each.name for each in path.parent.glob("*.toml")))
        remedy = "check the path" if near is None else f"did you mean {path.with_name(near)}?"
        raise ConfigError(f"{path}: there is no such config file; {remedy}") from None
    except IsADirectoryError:
        example = min(path.glob("*.toml"), default=path / "a.toml")
        raise ConfigError(f"{path}: is a folder; name a config file in it, such as {example}") from None
    except OSError as error:
        raise ConfigError(f"{path}: the config cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _no_toml(path, error) from None


def set_keys(data: dict[str, Any], overrides: Sequence[str]) -> None:
    """Set `key=value` strings inside `data`, in place; see `load_config`.

    Raises:
        ConfigError: one that cannot be set.
    """
    for override in overrides:
        _apply(data, override)


def _apply(data: dict[str, Any], override: str) -> None:
    """Set one value inside `data`, in place, creating the tables on the way."""
    key, equals, text = override.partition("=")
    steps = key.strip().split(".")
    if not equals or not all(steps):
        raise ConfigError(f"--set {override}: expected key=value, for example render.rays=16")
    place: Any = data
    for depth, step in enumerate(steps[:-1]):
        if isinstance(place, list):
            place = place[_index(place, step, override, steps[:depth])]
        else:
            place = place.setdefault(step, {})
        if not isinstance(place, dict | list):
            raise ConfigError(
                f"--set {override}: {key_path(steps[: depth + 1])} is a value, not a table; shorten the key"
            )
    if isinstance(place, list):
        place[_index(place, steps[-1], override, steps[:-1])] = toml_value(text)
    else:
        place[steps[-1]] = toml_value(text)


def _index(place: list[Any], step: str, override: str, parents: Sequence[str]) -> int:
    if not step.isdecimal() or int(step) >= len(place):
        raise ConfigError(
            f"--set {override}: {key_path(parents)} has {len(place)} entries; expected a number from 0 to"
            f" {len(place) - 1} after it, not {step}"
        )
    return int(step)


def toml_value(text: str) -> Any:
    """`text` as a TOML value, or as itself where it is none, so that words need no quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()
    except RecursionError:
        raise ConfigError(f"{text:.40}...: is nested too deep to read; write it flatter") from None
