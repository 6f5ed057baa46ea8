"""The lens of every frame before solving, from `[lens]` and the keyframes of `[[shot.lens]]`."""

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from focusjax.config import (
    ABERRATIONS,
    SETTINGS,
    Config,
    ConfigError,
    ShotTable,
    Table,
    build_lens,
    values_of,
)
from focusjax.geometry import Camera
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.motion import Keyframes, keyframes


class LensTrack:
    """The config of each frame: that of the shot with the lens's keyframes put in.

    Focus is interpolated in dioptres, which change evenly with blur; f-numbers in stops; all else as given.
    """

    def __init__(self, config: Config, table: ShotTable):
        """Interpolate the keyframes.

        Raises:
            ValueError: keyframes that contradict `[lens]`, or do not fit each other.
        """
        self._config = config
        self.keyed = {key: values for key in SETTINGS if (values := values_of(table.lens, key))}
        _refuse_contradictions(config, self.keyed)
        _refuse_beside_close_focus(config, table)
        self._numbers = {key: _setting(key, values, table.between) for key, values in self.keyed.items()}
        self._tables = {
            key: _Interpolated(key, values, table.between)
            for key in ABERRATIONS
            if (values := values_of(table.lens, key))
        }

    def value(self, key: str) -> Keyframes | None:
        """The keyframes of a setting, as they are interpolated; None without."""
        return self._numbers.get(key)

    def config_at(self, frame: float) -> Config:
        """The config with the lens of a frame."""
        changes: dict[str, Any] = {}
        for key in ("f_number", "focus_distance_m", "tilt_deg", "swing_deg"):
            if key in self._numbers:
                changes[key] = _in_own_unit(key, float(self._numbers[key](frame)))
        changes |= {key: track(frame) for key, track in self._tables.items()}
        if not changes:
            return self._config
        return self._config.model_copy(update={"lens": self._config.lens.model_copy(update=changes)})

    def lenses(self, cameras: Sequence[Camera], *, solved: bool) -> tuple[ThinLens | TiltShiftLens, ...]:
        """The lens of every frame before solving; zooming keeps its f-number and angles.

        Raises:
            ValueError: no lens has the settings of a frame, which is named: one with a keyframe, if any.
        """
        known: dict[tuple[Any, ...], ThinLens | TiltShiftLens] = {}
        found: dict[int, ThinLens | TiltShiftLens] = {}
        keys = {frame for values in self.keyed.values() for frame in values}
        for frame in sorted(range(1, len(cameras) + 1), key=lambda frame: (frame not in keys, frame)):
            camera, config = cameras[frame - 1], self.config_at(frame)
            # A lens that stays is one lens: what is known of one frame serves the others.
            key = (float(camera.focal_length), config.lens.model_dump_json())
            try:
                if key not in known:
                    known[key] = build_lens(config, camera, solved=solved)
            except ConfigError as error:
                reason = str(error).removeprefix(f"{config.source}: ")
                raise ValueError(f"frame {frame}: {reason}") from error
            found[frame] = known[key]
        return tuple(found[frame] for frame in sorted(found))


def _refuse_contradictions(config: Config, keyed: dict[str, dict[float, Any]]) -> None:
    """Refuse keyframes of what `[lens]` has in another form."""
    lens = config.lens
    if "f_number" in keyed and lens.aperture_radius_mm is not None:
        raise ValueError(
            "the lens has aperture_radius_mm and keyframes of its f-number; give f_number instead"
        )
    if lens.sharp_from_m is not None:
        for key in ("f_number", "focus_distance_m", "tilt_deg", "swing_deg"):
            if key in keyed:
                raise ValueError(
                    f"the lens has sharp_from_m, which gives focus and f-number, and keyframes of {key};"
                    " leave one of them out"
                )
    unmovable = {"lens.focal_surface": lens.focal_surface, "lens.height_field": lens.height_field}
    for what, there in unmovable.items():
        for key in ("tilt_deg", "swing_deg", *(("focus_distance_m",) if "surface" in what else ())):
            if there is not None and key in keyed:
                raise ValueError(
                    f"there are keyframes of {key} and a {what}, which has no such setting; leave one out"
                )


def _refuse_beside_close_focus(config: Config, table: ShotTable) -> None:
    """Refuse keyframes of what `[lens]` may not have with a model of close focus."""
    model = config.lens.close_focus
    if model == "ignored":
        return
    for key in table.lens:
        turned = [name for name in ("tilt_deg", "swing_deg") if getattr(key, name) is not None]
        reasons = {
            f"of {turned[0] if turned else ''}, with which the image distance is another from place to"
            " place": bool(turned),
            "of Seidel coefficients of a wavefront, which are for a lens without it": key.seidel is not None
            and bool(key.seidel.wavefront()),
            "of colour.glass, which is for one focal length": key.colour is not None
            and key.colour.glass is not None,
        }
        for reason, stands in reasons.items():
            if stands:
                raise ValueError(
                    f"lens.close_focus is {model!r} and there is a keyframe at frame {key.frame:g} {reason};"
                    " leave one of them out"
                )


def _setting(key: str, values: dict[float, float], between: str) -> Keyframes:
    if key == "focus_distance_m":
        return keyframes({frame: 1.0 / value for frame, value in values.items()}, between=between)
    if key == "f_number":
        return keyframes({frame: math.log2(value) for frame, value in values.items()}, between=between)
    return keyframes(values, between=between)


def _in_own_unit(key: str, value: float) -> float:
    """An interpolated setting in its own unit."""
    if key == "focus_distance_m":
        return 1.0 / value if value > 0 else math.inf
    return 2.0**value if key == "f_number" else value


class _Interpolated:
    """A table of numbers between keyframes, number by number; numbers of rows and switches stay alike."""

    def __init__(self, key: str, values: dict[float, Any], between: str):
        first = next(iter(values.values()))
        self._model = type(first) if isinstance(first, Table) else None
        tables = [value for value in values.values() if isinstance(value, Table)]
        given = {name for table in tables for name in table.model_fields_set}
        flat = {frame: _numbers(value, given) for frame, value in values.items()}
        shape = flat[next(iter(flat))]
        for frame, numbers in flat.items():
            if numbers.keys() != shape.keys() or any(
                (numbers[name] != shape[name] and None in (numbers[name], shape[name]))
                or (isinstance(numbers[name], int | bool) and numbers[name] != shape[name])
                for name in shape
            ):
                raise ValueError(
                    f"the lens's keyframe of {key} at frame {frame:g} has other rows than the first one, or"
                    " another whole number; give all keyframes of it alike but for their numbers"
                )
        self._fixed = {name: value for name, value in shape.items() if isinstance(value, int | bool | None)}
        self._names = [name for name in shape if name not in self._fixed]
        rows = {frame: [numbers[name] for name in self._names] for frame, numbers in flat.items()}
        self._keys = keyframes(rows, between=between)
        try:
            self(next(iter(flat)))
        except ValidationError as error:
            reason = error.errors()[0]["msg"].removeprefix("Value error, ")
            raise ValueError(f"the lens's keyframes of {key} together make a table that {reason}") from error

    def __call__(self, frame: float) -> Any:
        """The table at a frame."""
        values = dict(zip(self._names, np.asarray(self._keys(frame)).tolist(), strict=True)) | self._fixed
        if self._model is None:
            return tuple(values[name] for name in sorted(values))
        rows: dict[Any, Any] = {}
        for (name, place), value in sorted(values.items()):
            if place < 0:
                rows[name] = value
            else:
                rows[name] = (*rows.get(name, ()), value)
        return self._model.model_validate(rows)


def _numbers(value: Any, given: Collection[str]) -> dict[tuple[str, int], Any]:
    """The numbers of a row, or of what is `given` in tables, by name and place in a row; -1 outside rows."""
    named = {"": value} if isinstance(value, tuple) else {name: getattr(value, name) for name in given}
    found: dict[tuple[str, int], Any] = {}
    for name, item in named.items():
        if isinstance(item, tuple):
            found |= {(name, place): float(number) for place, number in enumerate(item)}
        else:
            found[name, -1] = item
    return found
