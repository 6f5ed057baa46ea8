"""From the focus and solve tables of a config to wishes and options of the solve, units converted."""

import math
import warnings
from pathlib import Path
from typing import Any, Literal

import imageio.v3 as iio
import jax
import numpy as np
from jaxtyping import Bool

from focusjax.config._build import faces_of
from focusjax.config._errors import ConfigError, located
from focusjax.config._load import Config
from focusjax.config._wishes import FocusTable, PlaceTable
from focusjax.focus import (
    AtInfinity,
    AtLeast,
    AtMost,
    AtPixel,
    AtPoint,
    Attachment,
    Blur,
    Diameter,
    FocusPoint,
    InDepthRange,
    InFrame,
    OfHeight,
    OnMask,
    OnObject,
    OnSensor,
    OnTriangle,
    Prior,
    SameBlur,
    Sharp,
    ShownAt,
    Wish,
)
from focusjax.scene import Scene


def build_focus_points(config: Config, scene: Scene) -> tuple[FocusPoint, ...]:
    """The wishes of `[[focus]]`.

    Raises:
        ConfigError: no wishes, an object that does not exist, or a triangle beyond its last one.
    """
    if not config.focus:
        raise ConfigError(
            f"{config.source}: there are no focus points; add a [[focus]] table such as"
            f" pixel = [{config.camera.resolution[0] // 2}, {config.camera.resolution[1] // 2}],"
            " sharp = true, or take its settings as they are: `focusjax render` makes the picture without"
            " a solve"
        )
    with located(config.source):
        return tuple(_focus_point(table, number, scene, config) for number, table in enumerate(config.focus))


def build_solve_options(config: Config) -> dict[str, Any]:
    """The keyword arguments of the solve that `[solve]` stands for.

    Warns of limits to what is not free.
    """
    table = config.solve
    for key, name in table.idle_limits():
        warnings.warn(
            f"{config.source}: solve.{key} limits nothing, since {name} is not free; add {name!r} to"
            f" solve.free, or remove {key}",
            stacklevel=1,
        )
    options: dict[str, Any] = {"free": table.free}
    if table.solver != "levenberg-marquardt":
        options["solver"] = _solver(table.solver)
    if "focus" in table.free:
        options["max_focus_distance"] = table.max_focus_distance_m
        if table.min_focus_distance_m is not None:
            options["min_focus_distance"] = table.min_focus_distance_m
    if "f_number" in table.free:
        options["f_number_range"] = (table.f_number_min, table.f_number_max)
    if "tilt" in table.free:
        options["tilt_range"] = (math.radians(table.tilt_min_deg), math.radians(table.tilt_max_deg))
    if "swing" in table.free:
        options["swing_range"] = (math.radians(table.swing_min_deg), math.radians(table.swing_max_deg))
    if "focal_length" in table.free:
        assert table.focal_length_min_mm is not None
        assert table.focal_length_max_mm is not None
        options["focal_length_range"] = (table.focal_length_min_mm / 1000, table.focal_length_max_mm / 1000)
        options["keep_field_of_view"] = table.keep_field_of_view
    half = config.camera.sensor_width_mm / 2
    for name in {"shift", "rise"} & set(table.free):
        least, most = getattr(table, f"{name}_min_mm"), getattr(table, f"{name}_max_mm")
        options[f"{name}_range"] = (
            (-half if least is None else least) / 1000,
            (half if most is None else most) / 1000,
        )
    if config.lens.close_focus != "ignored":
        options["close_focus"] = config.lens.close_focus
    priors = _priors(config)
    return options | ({"priors": priors} if priors else {})


def _solver(name: Literal["dogleg", "jaxopt"]) -> Any:
    """A solver of Optimistix that ends where rounding does."""
    import optimistix as optx

    from focusjax.solvers import JaxoptLBFGSB

    tolerance = 1e3 * float(np.finfo(jax.dtypes.canonicalize_dtype(float)).eps)
    return optx.Dogleg(tolerance, tolerance) if name == "dogleg" else JaxoptLBFGSB(atol=tolerance)


def _priors(config: Config) -> dict[str, Prior]:
    table = config.solve.prior
    found = {}
    if table.focus is not None:
        found["focus"] = Prior(table.focus.distance_m, table.focus.sigma_per_m)
    if table.f_number is not None:
        found["f_number"] = Prior(table.f_number.value, table.f_number.sigma_stops)
    for name, angle in (("tilt", table.tilt), ("swing", table.swing)):
        if angle is not None:
            found[name] = Prior(math.radians(angle.angle_deg), math.radians(angle.sigma_deg))
    lengths = (("focal_length", table.focal_length), ("shift", table.shift), ("rise", table.rise))
    for name, length in lengths:
        if length is not None:
            found[name] = Prior(length.length_mm / 1000, length.sigma_mm / 1000)
    return found


def _focus_point(table: FocusTable, number: int, scene: Scene, config: Config) -> FocusPoint:
    return FocusPoint(
        where=place_of(table, f"focus.{number}", scene, config, table.samples),
        wish=_wish(table),
        weight=table.weight,
        tolerance=1.0 if (given := _diameter(table, "tolerance")) is None else given,
        name=table.name or _default_name(table),
        even_outside=table.even_outside,
        even_hidden=table.even_hidden,
    )


def _wish(table: FocusTable) -> Wish:
    if (blur := _diameter(table, "blur")) is not None:
        return Blur(blur, signed=table.signed)
    if (most := _diameter(table, "at_most")) is not None:
        return AtMost(most)
    if (least := _diameter(table, "at_least")) is not None:
        return AtLeast(least)
    if table.same_blur_as is not None:
        return SameBlur(table.same_blur_as, same_side=table.signed)
    if table.shown_at is not None:
        return ShownAt(*table.shown_at)
    if (margin := _diameter(table, "in_frame")) is not None:
        return InFrame(margin)
    return Sharp()


def _diameter(table: FocusTable, kind: str) -> Diameter | None:
    """The diameter that one of the three keys of a kind gives."""
    if (value := getattr(table, f"{kind}_px")) is not None:
        return value
    if (value := getattr(table, f"{kind}_mm")) is not None:
        return OnSensor(value)
    if (value := getattr(table, f"{kind}_height")) is not None:
        return OfHeight(value)
    return None


def place_of(table: PlaceTable, key: str, scene: Scene, config: Config, samples: int | None) -> Attachment:
    """The place that a table names.

    Args:
        table: which says where in one way.
        key: of the table, for messages.
        scene: what objects and triangles are of.
        config: whose files masks are.
        samples: points of an object, mask or depth range; the usual number when None.

    Raises:
        ValueError: an object that does not exist, a triangle beyond its last one, or no mask.
    """
    if table.pixel is not None:
        return AtPixel(*table.pixel)
    if table.point is not None:
        return AtPoint(table.point)
    if table.direction is not None:
        return AtInfinity(table.direction)
    if table.triangle is not None:
        assert table.barycentric is not None
        faces = (
            range(len(scene.faces))
            if table.object is None
            else faces_of(scene, table.object, f"{key}.object")
        )
        if table.triangle >= len(faces):
            where = "the scene" if table.object is None else f"object {table.object!r}"
            raise ValueError(
                f"{key}.triangle is {table.triangle} but {where} has {len(faces)} triangles;"
                f" expected 0 to {len(faces) - 1}"
            )
        return OnTriangle(faces[table.triangle], table.barycentric)
    more = {} if samples is None else {"samples": samples}
    if table.mask is not None:
        return OnMask(_read_mask(config.reach.file(table.mask, f"{key}.mask"), f"{key}.mask"), **more)
    if isinstance(table, FocusTable) and table.depth_m is not None:
        return InDepthRange(*table.depth_m, **more)
    assert table.object is not None
    faces_of(scene, table.object, f"{key}.object")
    return OnObject(table.object, **more)


def _read_mask(path: Path, key: str) -> Bool[np.ndarray, "h w"]:
    """Which pixels of an image are more white than black; its alpha channel is left out."""
    try:
        # Without a plugin's name imageio tries all it has, of which some only warn that they are old.
        image = iio.imread(path, plugin="pillow")
    except FileNotFoundError:
        raise ValueError(f"{key} is {path}, which does not exist; check the path") from None
    except (OSError, ValueError) as error:
        raise ValueError(f"{key} is {path}, which is no image that can be read ({error})") from None
    grey = image if image.ndim == 2 else image[..., : 1 if image.shape[-1] == 2 else 3].mean(axis=-1)
    whitest = np.iinfo(image.dtype).max if np.issubdtype(image.dtype, np.integer) else 1.0
    return grey > whitest / 2


def _default_name(table: FocusTable) -> str:
    """What a person would call the place."""
    if table.pixel is not None:
        return f"pixel ({table.pixel[0]:g}, {table.pixel[1]:g})"
    if table.point is not None:
        return f"point ({', '.join(f'{value:g}' for value in table.point)})"
    if table.direction is not None:
        return f"direction ({', '.join(f'{value:g}' for value in table.direction)})"
    if table.triangle is not None:
        return f"triangle {table.triangle}" + (f" of {table.object}" if table.object else "")
    if table.mask is not None:
        return f"mask {Path(table.mask).name}"
    if table.depth_m is not None:
        return f"{table.depth_m[0]:g} m to {table.depth_m[1]:g} m"
    return table.object or ""
