"""Messages about photographs in the words of a command: its options in place of a config's keys."""

import re
from collections.abc import Collection

REFOCUS = (
    "depth_unit",
    "depth_scale",
    "depth_invalid",
    "depth_focal_px",
    "depth_offset_px",
    "baseline_m",
    "focal_length_35mm",
    "focal_length_px",
    "highlight_stops",
    "anchors",
)
"""Keys of `[scene.photo]` for which `focusjax refocus` has an option."""
STUDIO = ("depth_unit", "depth_scale", "focal_length_35mm", "anchors")
"""Those for which `focusjax studio` has one."""
_FORMS = {
    "[x, y, metres]": "X,Y,METRES",
    "[value, metres]": "VALUE,METRES",
    "--depth (depth = in a config)": "--depth",
}
# Not inside the name of a file; "anchors" is also a plain word.
_KEY = re.compile(
    rf"(?<![\w./\\-])(?:scene\.photo\.)?\b({'|'.join(REFOCUS[:-1])}|(?<=as )anchors|(?<=photo\.)anchors)"
    r"(?![\w/\\-]|\.\w)(?: = '([^']*)')?"
)


def in_options(message: str, options: Collection[str] = REFOCUS) -> str:
    """A message about a photograph with `--depth-unit` for `depth_unit`, and so on.

    Args:
        message: as it is for configs and in Python.
        options: keys that are options; of the other ones it says that they are a config's.

    Example:
        >>> in_options("desk.png: give depth_unit as one of m, mm")
        'desk.png: give --depth-unit as one of m, mm'
        >>> in_options("give focal_length_35mm or focal_length_px", STUDIO)
        'give --focal-length-35mm or focal_length_px (in a config)'
    """

    def named(found: re.Match[str]) -> str:
        key, value = found[1], found[2]
        if key not in options:
            return found[0] + " (in a config)"
        option = "--anchor" if key == "anchors" else "--" + key.replace("_", "-")
        return option if value is None else f"{option} {value}"

    for form, plain in _FORMS.items():
        message = message.replace(form, plain)
    return _KEY.sub(named, message)
