"""The `refocus` command's options as a config: a photograph, a lens and wishes about its pixels."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from focusjax.config import Config, ConfigError, Reach, config_of, set_keys, texts, toml_value
from focusjax.photo import PhotoError, check_file

_START_F_NUMBER = 2.8


def refocus_config(
    photo: Path,
    depth: Path | None,
    settings: dict[str, Any],
    *,
    sharp: Sequence[str] = (),
    blur: Sequence[str] = (),
    anchors: Sequence[str] = (),
    focus_distance_m: float | None = None,
    f_number: float | None = None,
    overrides: Sequence[str] = (),
) -> Config:
    """The config of one photograph.

    Args:
        photo: the photograph.
        depth: its depth map; None where it is inside the photograph.
        settings: other keys of `[scene.photo]`; None for what was not given.
        sharp: places "X,Y" that are to be sharp.
        blur: places "X,Y=N" that are to be blurred by N pixels.
        anchors: two of "X,Y,METRES" or two of "VALUE,METRES".
        focus_distance_m: in place of wishes.
        f_number: None to have it solved for, which takes a blur.
        overrides: `key=value` strings as for `load_config`.

    Raises:
        ConfigError: no such file, text that is no place, or nothing to focus on.
    """
    try:
        for path, what in ((photo, "photograph"), (depth, "depth map")):
            if path is not None:
                check_file(path, what)
    except PhotoError as error:
        raise ConfigError(str(error)) from None
    table = {key: value for key, value in settings.items() if value is not None}
    table["file"] = str(photo.absolute())
    if depth is not None:
        table["depth"] = str(depth.absolute())
    if anchors:
        table["anchors"] = anchors_of(anchors)
    focus = [
        {"name": f"sharp {text}", "pixel": _numbers(text, "--sharp", (2,), "X,Y in pixels"), "sharp": True}
        for text in sharp
    ]
    for text in blur:
        place, equals, pixels = text.partition("=")
        if not equals:
            raise ConfigError(f"--blur {text}: expected X,Y=PIXELS, such as 100,50=12")
        size = _numbers(pixels, "--blur", (1,), "X,Y=PIXELS")[0]
        where = _numbers(place, "--blur", (2,), "X,Y=PIXELS")
        focus.append({"name": f"blur {place}", "pixel": where, "blur_px": size})
    if bool(focus) == (focus_distance_m is not None):
        raise ConfigError(
            f"{photo}: there is {'both a wish and a' if focus else 'no wish and no'} focus distance; give"
            " --sharp X,Y and --blur X,Y=PIXELS, or --focus-distance METRES"
        )
    if f_number is None and not blur:
        raise ConfigError(
            f"{photo}: nothing says how strong the blur is to be; give --f-number, or a --blur X,Y=PIXELS to"
            " find it by"
        )
    lens: dict[str, Any] = {"f_number": _START_F_NUMBER if f_number is None else f_number}
    if focus_distance_m is not None:
        lens["focus_distance_m"] = focus_distance_m
    data = {
        "title": photo.stem,
        "scene": {"photo": table},
        "lens": lens,
        "focus": focus,
        "solve": {"free": ["focus"] if f_number is not None else ["focus", "f_number"]},
    }
    set_keys(data, overrides)
    named = [*table.values(), *(toml_value(override.partition("=")[2]) for override in overrides)]
    return config_of(data, Reach(photo.absolute(), None, frozenset(texts(named))))


def anchors_of(texts: Sequence[str]) -> list[list[float]]:
    """The `anchors` of `[scene.photo]` from "X,Y,METRES" or "VALUE,METRES".

    Raises:
        ConfigError: text that is neither, or one of each.
    """
    found = [_numbers(text, "--anchor", (2, 3), "X,Y,METRES or VALUE,METRES") for text in texts]
    if len({len(anchor) for anchor in found}) > 1:
        raise ConfigError(
            f"--anchor {' and --anchor '.join(texts)}: one is a place X,Y,METRES and another a value"
            " VALUE,METRES; give two of the same form"
        )
    return found


def _numbers(text: str, option: str, counts: tuple[int, ...], expected: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts:
        raise ConfigError(f"{option} {text}: expected {expected}, such as {_EXAMPLES[option]}")
    return values


_EXAMPLES = {"--sharp": "320,240", "--blur": "100,50=12", "--anchor": "320,240,1.5"}
