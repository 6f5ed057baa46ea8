"""Edits of the lens: each setting free within limits, or fixed."""

import dataclasses
import math

from focusjax.config import Config
from focusjax.studio._document import Change, EditError, set_value, together

_ZOOM, _USUAL_MM = 1.4, 50.0
"""By how much a focal length may change at first where it is set free."""
_DIGITS = 9
"""Significant digits of values that are written to the config."""


@dataclasses.dataclass(frozen=True)
class Setting:
    """A setting of the lens, its keys in the config, and how it is shown.

    Attributes:
        name: as in `solve.free`.
        label: for people.
        unit: of its values; empty for f-numbers.
        key: in `table`.
        low: the key of its least value in `[solve]`.
        high: the key of its largest value in `[solve]`.
        rivals: other keys of `table` that set the same.
        help: one sentence.
        table: "lens" or "camera".
    """

    name: str
    label: str
    unit: str
    key: str
    low: str
    high: str
    rivals: tuple[str, ...]
    help: str
    table: str = "lens"


_RANGE = ("sharp_from_m", "sharp_to_m")
SETTINGS = {
    each.name: each
    for each in (
        Setting(
            "focus", "Focus distance", "m", "focus_distance_m", "min_focus_distance_m",
            "max_focus_distance_m", _RANGE, "Distance along the view axis that is sharpest.",
        ),
        Setting(
            "f_number", "f-number", "", "f_number", "f_number_min", "f_number_max",
            ("aperture_radius_mm", *_RANGE), "A smaller f-number opens the lens and blurs more.",
        ),
        Setting(
            "tilt", "Tilt", "°", "tilt_deg", "tilt_min_deg", "tilt_max_deg", (),
            "Turns the lens forwards (+): the plane in focus leans, nearer at the picture's bottom.",
        ),
        Setting(
            "swing", "Swing", "°", "swing_deg", "swing_min_deg", "swing_max_deg", (),
            "Turns the lens to the right (+): the plane in focus turns with it.",
        ),
        Setting(
            "focal_length", "Focal length", "mm", "focal_length_mm", "focal_length_min_mm",
            "focal_length_max_mm", ("field_of_view_deg",), "A longer lens shows less, and blurs more.",
            "camera",
        ),
    )
}  # fmt: skip
"""By name, in the order of the page."""


def is_free(config: Config, name: str) -> bool:
    """Whether the wishes decide a setting."""
    return bool(config.focus) and config.lens.focal_surface is None and name in config.solve.free


def limits(config: Config, name: str) -> tuple[float | None, float | None]:
    """Least and largest value that are written in the config; None for those that are not."""
    setting, given = SETTINGS[name], config.solve.model_fields_set
    low, high = (getattr(config.solve, key) if key in given else None for key in (setting.low, setting.high))
    return low, high


def free(config: Config, name: str) -> Change:
    """Let the wishes decide a setting."""
    names = [*config.solve.free, *({name} - set(config.solve.free))]
    change = set_value("solve", "free", value=names)
    if name != "focal_length":
        return change
    # It is free within a range only.
    length = config.camera.focal_length_mm or _USUAL_MM
    ends = {"focal_length_min_mm": length / _ZOOM, "focal_length_max_mm": length * _ZOOM}
    given = config.solve.model_fields_set
    limits_ = [set_value("solve", key, value=_rounded(end)) for key, end in ends.items() if key not in given]
    return together(change, *limits_)


def fix(config: Config, name: str, value: float) -> Change:
    """Keep a setting at `value`, whatever is wished; its limits and expectation go.

    Raises:
        EditError: nothing would be left for the wishes to decide.
    """
    if not is_free(config, name):
        return set_fixed(name, value)
    names = [each for each in config.solve.free if each != name]
    if not names:
        raise EditError("one setting at least has to stay free, for the wishes to decide; free another first")
    setting = SETTINGS[name]
    changes = [set_value("solve", key, value=None) for key in (setting.low, setting.high)]
    if getattr(config.solve.prior, name) is not None:
        changes.append(set_value("solve", "prior", name, value=None))
    return together(*changes, set_value("solve", "free", value=names), set_fixed(name, value))


def set_fixed(name: str, value: float) -> Change:
    """Set a setting of `[lens]` or `[camera]`."""
    setting = SETTINGS[name]
    changes = [set_value(setting.table, key, value=None) for key in setting.rivals]
    return together(*changes, set_value(setting.table, setting.key, value=_rounded(value)))


def limit(config: Config, name: str, end: str, value: float | None) -> Change:
    """Set the "low" or "high" limit of a free setting; None for the usual one.

    The value that solves start from is moved within it.
    """
    setting = SETTINGS[name]
    key = setting.low if end == "low" else setting.high
    change = set_value("solve", key, value=None if value is None else _rounded(value))
    start = getattr(getattr(config, setting.table), setting.key)
    if value is None or start is None:
        return change
    if (start < value) if end == "low" else (start > value):
        return together(change, set_fixed(name, value))
    return change


def _rounded(value: float) -> float:
    return value if math.isinf(value) else float(f"{value:.{_DIGITS}g}")
