"""Edits of a focal surface: from a plane to a surface and back, its control points, and its shape."""

import math
from collections.abc import Sequence
from typing import Any

from focusjax.config import Config, FocalSurfaceTable
from focusjax.focus import WishResult
from focusjax.studio._document import (
    Change,
    EditError,
    add_row,
    change_row,
    delete_row,
    inline_table,
    set_value,
    together,
)
from focusjax.studio._lens_settings import set_fixed
from focusjax.studio._wishes import called, change_wish, free_name, pixel_row, place_row, taken_names

_POINTS = ("lens", "focal_surface", "points")
_PLACES = ("pixel", "point", "direction", "triangle", "barycentric", "object", "mask")
_FLAT_KEYS = ("focus_distance_m", "sharp_from_m", "sharp_to_m", "tilt_deg", "swing_deg")
_EXPONENT, _SMOOTHNESS = 3, 1e-4
"""Of new surfaces: they keep close to their control points, and are hardly smoothed."""
_WIDTH = 0.2
"""Of a kernel that ends, as a share of the picture's width, where it is chosen first."""
_SIZES = {"gaussian": "width_px", "wendland": "radius_px"}

BASES = {"constant": "level", "affine": "sloping", "quadratic": "curved"}
"""How a surface goes on beyond its control points, with the words for it."""
KERNELS = {"inverse_distance": "everywhere", "gaussian": "fading", "wendland": "within a radius"}
"""How far the influence of a control point goes, with the words for it."""


def use_surface(config: Config, rows: Sequence[WishResult], values: dict[str, float]) -> Change:
    """Let the focus differ from place to place: with a control point for every wish that counts.

    What was free of the lens is kept as it is solved.

    Args:
        config: has no focal surface.
        rows: the wishes as they are met now; none where nothing is solved.
        values: of the lens now, by the names of `SETTINGS`.

    Raises:
        EditError: a wish that a focal surface cannot be solved for.
    """
    for number, wish in enumerate(config.focus):
        if not wish.wants_a_value:
            raise EditError(
                f"{called(config, number)!r} wishes for neither sharp nor a blur, and a focal surface is"
                " solved for these two alone; change or delete that wish first"
            )
    kept = {*(config.solve.free if config.focus else ()), *(["f_number"] if config.lens.sharp_from_m else [])}
    changes = [set_value("lens", key, value=None) for key in _FLAT_KEYS]
    changes += [
        set_fixed(name, values[name]) for name in ("f_number", "focal_length") if name in kept & set(values)
    ]
    changes += [
        set_value("solve", key, value=None) for key in config.solve.model_fields_set - {"favour_near"}
    ]
    kernel = inline_table({"kind": "inverse_distance", "exponent": _EXPONENT})
    changes += [
        set_value("lens", "focal_surface", "kernel", value=kernel),
        set_value("lens", "focal_surface", "smoothness", value=_SMOOTHNESS),
    ]
    places = [place_row(wish, _PLACES) if wish.weight > 0 else {} for wish in config.focus]
    taken: set[str] = set()
    for number, place in enumerate(places):
        if place:
            name = free_name(called(config, number), taken)
            taken.add(name)
            changes.append(change_wish(number, {"name": name}))
            changes.append(_add(name, place, _signed_blur(rows[number]) if number < len(rows) else 0.0))
    if not any(places):
        width, height = config.camera.resolution
        changes.append(_add("middle", pixel_row(width / 2, height / 2), 0.0))
    return together(*changes)


def use_plane(values: dict[str, float]) -> Change:
    """Focus on a plane again, at the distance that the surface has in the picture's middle."""
    distance = values.get("focus", math.inf)
    return together(
        set_value("lens", "focal_surface", value=None),
        set_fixed("focus", distance if distance > 0 else math.inf),
    )


def add_control(config: Config, name: str, x: float, y: float) -> Change:
    """A control point at what is under pixel position (`x`, `y`), which is to be sharp there."""
    _table(config)
    return _add(free_name(name, taken_names(config)), pixel_row(x, y), 0.0)


def move_control(number: int, x: float, y: float) -> Change:
    """The control point is at what is under pixel position (`x`, `y`)."""
    return change_row(*_POINTS, number=number, row=pixel_row(x, y), without=_PLACES[1:])


def set_control(number: int, key: str, value: Any) -> Change:
    """Set the "blur_px", "aperture_scale" or "weight" of a control point."""
    return change_row(*_POINTS, number=number, row={key: value})


def delete_control(config: Config, number: int) -> Change:
    """Forget a control point.

    Raises:
        EditError: it is the last one.
    """
    if len(_table(config).points) == 1:
        raise EditError(
            "a focal surface needs one control point at least; focus on a plane instead, or add another first"
        )
    return delete_row(*_POINTS, number=number)


def set_surface(key: str, value: Any) -> Change:
    """Set the "basis" or the "smoothness" of the surface."""
    return set_value("lens", "focal_surface", key, value=value)


def set_kernel(
    config: Config, kind: str, *, exponent: float | None = None, size: float | None = None
) -> Change:
    """How far control points are felt.

    Args:
        config: has a focal surface.
        kind: of `KERNELS`.
        exponent: of the distance; None for what it was.
        size: in pixels, of kernels that end; None for what it was, or a fifth of the picture.
    """
    old = _table(config).kernel
    kernel = inline_table({"kind": kind, "exponent": old.exponent if exponent is None else exponent})
    if kind in _SIZES:
        known = kernel_size(config)
        usual = round(_WIDTH * config.camera.resolution[0]) if known is None else known
        kernel[_SIZES[kind]] = usual if size is None else size
    return set_surface("kernel", kernel)


def kernel_size(config: Config) -> float | None:
    """In pixels, of kernels that end."""
    kernel = _table(config).kernel
    return None if kernel.kind == "inverse_distance" else getattr(kernel, _SIZES[kernel.kind])


def control_of(config: Config, number: int) -> int | None:
    """The control point that belongs to a wish, which has its name."""
    if config.lens.focal_surface is None:
        return None
    name = called(config, number)
    names = [each.name or each.object for each in config.lens.focal_surface.points]
    return names.index(name) if name in names else None


def control_with(config: Config, name: str, x: float, y: float) -> Change:
    """A control point for a new wish called `name`; nothing where the focus is a plane."""
    if config.lens.focal_surface is None:
        return together()
    return _add(name, pixel_row(x, y), 0.0)


def control_follows(config: Config, number: int, row: dict[str, Any]) -> Change:
    """The control point of a wish goes where `row` puts the wish."""
    control = control_of(config, number)
    if control is None:
        return together()
    without = [key for key in _PLACES if key not in row]
    return change_row(*_POINTS, number=control, row={"name": called(config, number), **row}, without=without)


def control_renamed(config: Config, number: int, name: str) -> Change:
    """The control point of a wish has its new name, too."""
    control = control_of(config, number)
    return together() if control is None else set_control(control, "name", name)


def control_deleted(config: Config, number: int) -> Change:
    """The control point of a wish goes with it, unless it is the last one."""
    control = control_of(config, number)
    if control is None or len(_table(config).points) == 1:
        return together()
    return delete_control(config, control)


def control_blurred(config: Config, number: int, blur: float) -> Change:
    """The surface starts from the blur that is wished, before the wishes are solved for."""
    control = control_of(config, number)
    return together() if control is None else set_control(control, "blur_px", blur)


def _add(name: str, place: dict[str, Any], blur: float) -> Change:
    row = {"name": name, **place} | ({"blur_px": blur} if blur else {})
    return add_row(*_POINTS, row=row)


def _signed_blur(row: WishResult) -> float:
    wished = row.wished if row.signed else math.copysign(row.wished, row.got)
    return round(wished, 2)


def _table(config: Config) -> FocalSurfaceTable:
    table = config.lens.focal_surface
    if table is None:
        raise EditError("the focus is a plane, which has no control points; choose a focal surface first")
    return table
