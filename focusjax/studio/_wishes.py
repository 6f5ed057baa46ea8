"""Edits of the wishes: what the page offers for a point, as changes of a `[[focus]]` table."""

from collections.abc import Sequence
from typing import Any

from focusjax.config import Config, FocusTable
from focusjax.studio._document import Change, EditError, add_row, change_row, delete_row, together

KINDS = {
    "sharp": "sharp",
    "blur": "blur",
    "at_most": "at most",
    "at_least": "at least",
    "same_blur_as": "same as",
}
"""What a point may be wished to be, with the words for it."""
KINDS_OF_SURFACE = ("sharp", "blur")
"""Those that a focal surface is solved for."""

_PLACES = ("pixel", "point", "direction", "triangle", "barycentric", "object", "mask", "depth_m", "samples")
MEASURED = ("blur", "at_most", "at_least")
"""Those that have a diameter."""
_UNITS = ("px", "mm", "height")
WISHES = (
    "sharp",
    "same_blur_as",
    "shown_at",
    "signed",
    *(f"{kind}_{unit}" for kind in (*MEASURED, "in_frame") for unit in _UNITS),
)
_DECIMALS = 2
"""Of positions and diameters in pixels."""


def name_for(config: Config, place: str) -> str:
    """A name for a new wish at `place` that no other wish has."""
    return free_name(place or "background", taken_names(config))


def taken_names(config: Config) -> set[str]:
    """Names of wishes and of the focal surface's control points."""
    surface = config.lens.focal_surface
    controls = () if surface is None else surface.points
    wishes = {called(config, number) for number in range(len(config.focus))}
    return wishes | {each.name or each.object or "" for each in controls}


def free_name(wanted: str, taken: set[str]) -> str:
    """The name wanted, with a number where it is taken."""
    name, number = wanted, 1
    while name in taken:
        number += 1
        name = f"{wanted} {number}"
    return name


def new_wish(name: str, x: float, y: float) -> Change:
    """What is under pixel position (`x`, `y`) is to be sharp."""
    return add_row("focus", row={"name": name, **pixel_row(x, y), "sharp": True})


def change_wish(number: int, row: dict[str, Any], without: Sequence[str] = ()) -> Change:
    """Change the `[[focus]]` table of that number, as `change_row`."""
    return change_row("focus", number=number, row=row, without=without)


def delete_wish(number: int) -> Change:
    """Forget a wish."""
    return delete_row("focus", number=number)


def move(number: int, x: float, y: float) -> Change:
    """The wish is about what is under pixel position (`x`, `y`)."""
    return change_wish(number, pixel_row(x, y), [key for key in _PLACES if key != "pixel"])


def whole_object(number: int, name: str) -> Change:
    """The wish is about all of an object that shows, not about one point."""
    return change_wish(number, {"object": name}, [key for key in _PLACES if key != "object"])


def wish_for(number: int, kind: str, *, pixels: float = 0.0, other: str = "") -> Change:
    """Change what is wished, of `KINDS`.

    Args:
        number: of the wish.
        kind: a key of `KINDS`.
        pixels: the blur's diameter, for those that have one.
        other: the name of the wish whose blur it is to have, for "same_blur_as".
    """
    value: Any = True if kind == "sharp" else other if kind == "same_blur_as" else round(pixels, _DECIMALS)
    key = kind if kind in ("sharp", "same_blur_as") else f"{kind}_px"
    return change_wish(number, {key: value}, [each for each in WISHES if each != key])


def set_number(number: int, key: str, value: float | None) -> Change:
    """Set a weight, or a tolerance in pixels; None for the usual."""
    others = ("tolerance_mm", "tolerance_height") if key == "tolerance_px" else ()
    return change_wish(number, {key: value}, others)


def rename(config: Config, number: int, name: str) -> Change:
    """Call a wish `name`, also where others refer to it.

    Raises:
        EditError: no name, or that of another wish or control point.
    """
    name = name.strip()
    names = [called(config, index) for index in range(len(config.focus))]
    if not name:
        raise EditError("a wish needs a name; give one")
    if name != names[number] and name in taken_names(config):
        raise EditError(f"another wish or control point is called {name!r}; give each a name of its own")
    referring = [k for k, wish in enumerate(config.focus) if wish.same_blur_as == names[number]]
    return together(
        change_wish(number, {"name": name}), *(change_wish(k, {"same_blur_as": name}) for k in referring)
    )


def kind_of(config: Config, number: int) -> str:
    """What a wish is for, of `KINDS`; empty for wishes that the page only shows."""
    key = config.focus[number].wish_key
    return next((kind for kind in KINDS if key in (kind, *(f"{kind}_{unit}" for unit in _UNITS))), "")


def pixels_of(wish: FocusTable) -> float | None:
    """The diameter that is wished for; None without one in pixels."""
    known = (getattr(wish, f"{kind}_px") for kind in MEASURED)
    return next((each for each in known if each is not None), None)


def called(config: Config, number: int) -> str:
    """What a wish without a name of its own may be called."""
    wish = config.focus[number]
    return wish.name or wish.object or f"point {number + 1}"


def pixel_row(x: float, y: float) -> dict[str, Any]:
    """The keys of a place in the picture."""
    return {"pixel": [round(float(x), _DECIMALS), round(float(y), _DECIMALS)]}


def place_row(wish: FocusTable, keys: Sequence[str]) -> dict[str, Any]:
    """Those of the keys that say where a wish is."""
    found = {key: getattr(wish, key) for key in keys if getattr(wish, key) is not None}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in found.items()}
