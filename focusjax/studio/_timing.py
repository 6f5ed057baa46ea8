"""Edits of a shot: from which frame to which a wish acts, and its keyframes."""

from collections.abc import Callable
from typing import Any

import tomlkit

from focusjax.config import Config, values_of
from focusjax.shot import keyframes
from focusjax.studio._document import Change, EditError, blank_line_after, inline_table, put, together
from focusjax.studio._wishes import MEASURED, called, change_wish, kind_of

KEYED = ("blur", "weight")
"""What of a wish may have keyframes on the page."""


def span_of(config: Config, number: int) -> tuple[float | None, float | None]:
    """The first and the last frame in which a wish acts; None for those of the shot."""
    track = _track(config, number)
    return (None, None) if track is None else (track.from_frame, track.to_frame)


def keys_of(config: Config, number: int, what: str) -> dict[float, float]:
    """The keyframes of a wish's "blur" or "weight", by frame."""
    track = _track(config, number)
    return {} if track is None else values_of(track.keys, what)


def value_at(config: Config, number: int, frame: float, what: str) -> float:
    """A wish's "blur", in its own unit, or "weight" at a frame, between keyframes too."""
    keys = keys_of(config, number, what)
    if keys and config.shot is not None:
        return float(f"{float(keyframes(keys, between=config.shot.between)(frame)):.4g}")
    wish = config.focus[number]
    return float(wish.weight if what == "weight" else getattr(wish, wish.wish_key))


def set_span(config: Config, number: int, end: str, frame: int | None) -> Change:
    """Let a wish act from ("from") or to ("to") a frame; None for the shot's own.

    Raises:
        EditError: a frame that the shot does not have.
    """
    _check(config, frame)
    return _of_track(config, number, lambda table: put(table, f"{end}_frame", frame))


def set_key(config: Config, number: int, frame: int, what: str, value: float) -> Change:
    """Give a wish's "blur" or "weight" a keyframe, or change it.

    Raises:
        EditError: a frame that the shot does not have, or a wish that has no blur.
    """
    _check(config, frame)
    if what == "blur" and kind_of(config, number) not in MEASURED:
        raise EditError(
            f"{called(config, number)!r} wishes for no blur in pixels; choose blur, at most or at least"
        )

    def change(table: Any) -> None:
        keys = table.get("keys")
        if keys is None:
            keys = table["keys"] = tomlkit.array().multiline(True)
        for key in keys:
            if key["frame"] == frame:
                key[what] = value
                return
        made = inline_table({"frame": frame, what: value})
        keys.insert(sum(key["frame"] < frame for key in keys), made)

    return _of_track(config, number, change)


def without_keys(config: Config, number: int, what: str) -> Change:
    """Take a wish's "blur" or "weight" out of all of its keyframes."""
    if not keys_of(config, number, what):
        return together()

    def change(table: Any) -> None:
        for key in table["keys"]:
            put(key, what, None)
        _delete(table, "keys", lambda key: set(key) <= {"frame"})

    return _of_track(config, number, change)


def delete_key(config: Config, number: int, frame: int) -> Change:
    """Take the keyframe of a wish at a frame away; nothing happens where there is none."""
    return _of_track(config, number, lambda table: _delete(table, "keys", lambda key: key["frame"] == frame))


def rename_track(config: Config, number: int, name: str) -> Change:
    """Let the track of a wish follow its new name."""

    def change(tables: Any) -> None:
        if _track(config, number) is not None:
            _table(tables, called(config, number))["name"] = name

    return change


def delete_track(config: Config, number: int) -> Change:
    """Take a wish's track away with it."""

    def change(tables: Any) -> None:
        if _track(config, number) is not None:
            _delete(tables["shot"], "wishes", lambda table: table["name"] == called(config, number))

    return change


def _track(config: Config, number: int) -> Any:
    """The `[[shot.wishes]]` of a wish; None without one."""
    name = called(config, number)
    tracks = () if config.shot is None else config.shot.wishes
    return next((track for track in tracks if track.name == name), None)


def _of_track(config: Config, number: int, change_table: Any) -> Change:
    """A change of a wish's track, which is made where there is none, and goes when it says nothing more."""
    name = called(config, number)

    def change(tables: Any) -> None:
        table = _table(tables, name)
        change_table(table)
        if set(table) <= {"name"}:
            _delete(tables["shot"], "wishes", lambda each: each["name"] == name)

    named = [] if config.focus[number].name else [change_wish(number, {"name": name})]
    return together(*named, change)


def _table(tables: Any, name: str) -> Any:
    shot = tables["shot"]
    if "wishes" not in shot:
        shot["wishes"] = tomlkit.aot()
    for table in shot["wishes"]:
        if table["name"] == name:
            return table
    made = tomlkit.table()
    made["name"] = name
    if len(shot["wishes"]):
        blank_line_after(shot["wishes"])
    shot["wishes"].append(made)
    return shot["wishes"][-1]


def _delete(table: Any, key: str, goes: Callable[[Any], bool]) -> None:
    """Delete those rows of an array for which `goes` is true; the array goes with its last one."""
    rows = table.get(key, [])
    for index, row in reversed(list(enumerate(rows))):
        if goes(row):
            del rows[index]
    if key in table and not len(rows):
        del table[key]


def _check(config: Config, frame: int | None) -> None:
    if config.shot is None:
        raise EditError("there is no [shot], whose frames could be named; add one to the text")
    if frame is not None and not 1 <= frame <= config.shot.frames:
        raise EditError(f"frame {frame} is not in the shot; it has frames 1 to {config.shot.frames}")
