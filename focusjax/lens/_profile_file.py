"""Lens profiles in text files, and those that come with the package."""

import math
import tomllib
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from focusjax._whole_file import replace_file
from focusjax._words import did_you_mean, listed
from focusjax.lens._height_curve import HeightCurve, height_curve
from focusjax.lens._profile import TABLES, CatsEyes, LensProfile

_MILLI = 1e-3
_UNITS = {
    "distortion": ("percent", 0.01),
    "sagittal": ("dioptres", 1.0),
    "tangential": ("dioptres", 1.0),
    "spherical": ("dioptres", 1.0),
    "coma": ("mm", _MILLI),
    "lateral_colour": ("mm", _MILLI),
    "axial_colour": ("dioptres", 1.0),
    "illumination": ("share", 1.0),
}
"""What the numbers of each table are, and how much one of them is in metres, shares or dioptres."""
_OF_COLOURS = ("lateral_colour", "axial_colour")
_ODD = ("coma", "lateral_colour")
_EYES = ("ahead_radius_mm", "ahead_distance_mm", "behind_radius_mm", "behind_distance_mm", "cosine_power")
_HEAD = ("title", "focal_length_mm", "f_number", "focus_distance_m", "source")
_KEYS = (*_HEAD, *TABLES.values(), "cats_eyes")


class ProfileError(ValueError):
    """A lens profile that cannot be used; the message names the file and the line or key."""


def lens_profile(name: str) -> LensProfile:
    """A lens profile that comes with the package, by name (`profile_names`).

    Raises:
        ValueError: no such profile; the message gives the nearest name.

    Example:
        >>> round(float(lens_profile("gauss_f1.8").focal_length), 4)
        0.0514
    """
    if name not in profile_names():
        hint = did_you_mean(name, profile_names(), f"there are {listed(profile_names())}")
        raise ValueError(f"there is no lens profile {name!r}; {hint}")
    with resources.as_file(_folder().joinpath(f"{name}.toml")) as path:
        return load_profile(path)


def profile_names() -> tuple[str, ...]:
    """The names that `lens_profile` knows."""
    files = (each.name for each in _folder().iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in files if name.endswith(".toml")))


def _folder() -> Any:
    return resources.files("focusjax.lens").joinpath("data")


def load_profile(path: str | Path) -> LensProfile:
    """The lens profile in a TOML file, as `save_profile` writes it.

    `heights_mm` start at 0, distances from the axis on the film. Each table, or else the whole file, says in
    `source` where its numbers are from.

    Raises:
        ProfileError: a file that cannot be read, keys that are missing or unknown, numbers out of range, or a
            table without a source.
    """
    try:
        text = Path(path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"{path}: this lens profile cannot be read ({error}); check the path") from None
    try:
        return _profile(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(f"{path}: is no TOML: {error}") from None
    except ValueError as error:
        raise ProfileError(f"{path}: {error}") from None


def _profile(found: Mapping[str, Any]) -> LensProfile:
    _refuse_unknown(found, _KEYS, "")
    for key in _HEAD[:4]:
        if key not in found:
            raise ValueError(f"{key} is missing; a lens profile needs {listed(_HEAD[:4])}")
    held: dict[str, Any] = {}
    sources = {}
    for key, name in TABLES.items():
        if name in found:
            table = _table(found[name], name)
            held[key] = _of_colours(key, name, table) if key in _OF_COLOURS else _curve(key, name, table)
            sources[name] = _source(found, table, name)
    if "cats_eyes" in found:
        table = _table(found["cats_eyes"], "cats_eyes")
        _refuse_unknown(table, (*_EYES, "source"), "cats_eyes.")
        values = [_number(table, key, "cats_eyes.", least=0.0) for key in _EYES]
        lengths = jnp.asarray([_MILLI * value for value in values[:4]], dtype=float)
        power = jnp.asarray(values[4], dtype=float)
        held["cats_eyes"] = CatsEyes(lengths[0], lengths[1], lengths[2], lengths[3], power)
        sources["cats_eyes"] = _source(found, table, "cats_eyes")
    _refuse_contradictions(held)
    return LensProfile(
        title=str(found["title"]),
        focal_length=jnp.asarray(_MILLI * _number(found, "focal_length_mm", "", least=0.1), dtype=float),
        f_number=_range(found, "f_number"),
        focus_distance=_range(found, "focus_distance_m"),
        sources=tuple(sources.items()),
        **held,
    )


def _curve(key: str, name: str, table: Mapping[str, Any]) -> HeightCurve:
    unit, scale = _UNITS[key]
    _refuse_unknown(table, ("heights_mm", unit, "source"), f"{name}.")
    curve = _column(key, name, table, unit, scale)
    if key == "distortion" and float(curve.values.min()) <= -1:
        raise ValueError(
            f"{name}.{unit} goes down to {100 * float(curve.values.min()):g}; expected above -100"
        )
    if key == "illumination" and (float(curve.values.min()) < 0 or not float(curve.values[0]) > 0):
        raise ValueError(
            f"{name}.{unit} has values below 0, or 0 on the axis; expected shares such as 1 to 0.3"
        )
    return curve


def _of_colours(
    key: str, name: str, table: Mapping[str, Any]
) -> tuple[HeightCurve, HeightCurve, HeightCurve]:
    unit, scale = _UNITS[key]
    columns = [f"{colour}_{unit}" for colour in ("red", "green", "blue")]
    _refuse_unknown(table, ("heights_mm", *columns, "source"), f"{name}.")
    red, green, blue = (_column(key, name, table, column, scale) for column in columns)
    return red, green, blue


def _column(key: str, name: str, table: Mapping[str, Any], column: str, scale: float) -> HeightCurve:
    heights, values = (_numbers(table, each, f"{name}.") for each in ("heights_mm", column))
    return height_curve(
        _MILLI * heights, scale * values, even=key not in _ODD, name=f"the table {name}.{column}"
    )


def _refuse_contradictions(held: Mapping[str, Any]) -> None:
    """On the axis nothing is sagittal or tangential."""
    ends = [float(held[key].values[0]) if key in held else 0.0 for key in ("sagittal", "tangential")]
    if abs(ends[0] - ends[1]) > 1e-9 * max(abs(each) for each in (*ends, 1.0)):
        raise ValueError(
            f"sagittal_focus starts with {ends[0]:g} and tangential_focus with {ends[1]:g} dioptres on the"
            " axis, where they are the same; start both alike"
        )
    if "illumination" in held and "cats_eyes" in held:
        raise ValueError("has illumination and cats_eyes, which both darken the corners; keep one")


def _table(value: Any, name: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{name} is {value!r}; expected a table, [{name}]")
    return value


def _source(found: Mapping[str, Any], table: Mapping[str, Any], name: str) -> str:
    source = table.get("source", found.get("source"))
    if not isinstance(source, str) or not source.strip():
        raise ValueError(f"{name} has no source; say where its numbers are from, there or for the whole file")
    return source


def _refuse_unknown(table: Mapping[str, Any], known: tuple[str, ...], prefix: str) -> None:
    for key in table:
        if key not in known:
            hint = did_you_mean(key, known, f"known keys here are {', '.join(known)}")
            raise ValueError(f"unknown key {prefix}{key}; {hint}")


def _number(table: Mapping[str, Any], key: str, prefix: str, *, least: float) -> float:
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < math.inf:
        raise ValueError(f"{prefix}{key} is {value!r}; expected a number of at least {least:g}")
    return float(value)


def _numbers(table: Mapping[str, Any], key: str, prefix: str) -> np.ndarray:
    values = table.get(key)
    if not isinstance(values, list) or not all(
        isinstance(each, int | float) and not isinstance(each, bool) for each in values
    ):
        raise ValueError(f"{prefix}{key} is {values!r}; expected an array of numbers")
    return np.array(values, dtype=float)


def _range(table: Mapping[str, Any], key: str) -> tuple[float, float]:
    least, most = (*_numbers(table, key, ""), np.nan, np.nan)[:2]
    if not 0 < least <= most or len(table[key]) != 2:
        raise ValueError(f"{key} is {table[key]!r}; expected two positive numbers, the smaller first")
    return float(least), float(most)


def save_profile(path: str | Path, profile: LensProfile, *, comment: str = "") -> None:
    """Write a lens profile to a TOML file that `load_profile` reads.

    Args:
        path: the file.
        profile: what to write.
        comment: lines to put before it.
    """
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    near, far = profile.focus_distance
    lines += [
        f"title = {_quoted(profile.title)}",
        f"focal_length_mm = {_shown(float(profile.focal_length) / _MILLI)}",
        f"f_number = [{_shown(profile.f_number[0])}, {_shown(profile.f_number[1])}]",
        f"focus_distance_m = [{_shown(near)}, {_shown(far)}]",
    ]
    sources = dict(profile.sources)
    shared = set(sources.values())
    if len(shared) == 1:
        lines.append(f"source = {_quoted(shared.pop())}")
        sources = {}
    for key, name in TABLES.items():
        held = getattr(profile, key)
        if held is None:
            continue
        unit, scale = _UNITS[key]
        columns = [f"{each}_{unit}" for each in ("red", "green", "blue")] if key in _OF_COLOURS else [unit]
        curves = held if key in _OF_COLOURS else (held,)
        lines += ["", f"[{name}]"]
        lines += [f"source = {_quoted(sources[name])}"] if name in sources else []
        lines.append(f"heights_mm = {_row(np.asarray(curves[0].heights) / _MILLI)}")
        lines += [f"{c} = {_row(np.asarray(v.values) / scale)}" for c, v in zip(columns, curves, strict=True)]
    if profile.cats_eyes is not None:
        eyes = profile.cats_eyes
        lines += ["", "[cats_eyes]"]
        lines += [f"source = {_quoted(sources['cats_eyes'])}"] if "cats_eyes" in sources else []
        for key in _EYES:
            value = float(getattr(eyes, key.removesuffix("_mm")))
            lines.append(f"{key} = {_shown(value / _MILLI if key.endswith('_mm') else value)}")
    replace_file(Path(path), "\n".join(lines) + "\n")


def _row(values: np.ndarray) -> str:
    return "[" + ", ".join(_shown(float(value)) for value in values) + "]"


def _shown(value: float) -> str:
    """A number in TOML, to six digits."""
    text = f"{value + 0.0:.6g}"
    return text if any(mark in text for mark in ".einf") else f"{text}.0"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
