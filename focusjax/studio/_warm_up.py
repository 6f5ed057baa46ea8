"""What is likely to be asked for next, so that its programs are compiled before."""

from collections.abc import Callable
from typing import Any

from focusjax.config import Config, FocusTable
from focusjax.studio._wishes import WISHES, called

_PLACES = ("pixel", "point", "direction", "triangle", "barycentric", "mask", "depth_m", "object")
_WITHOUT = {key: FocusTable.model_fields[key].default for key in (*WISHES, "weight")}
_NOWHERE = {key: FocusTable.model_fields[key].default for key in _PLACES}


def _limited(config: Config) -> Config | None:
    return _with_wish(config, {"at_most_px": 1e3})


def _same(config: Config) -> Config | None:
    return _with_wish(config, {"same_blur_as": called(config, 0)}) if config.focus else None


def _whole_object(config: Config) -> Config | None:
    named = [each.name for each in config.scene.objects if each.name]
    return _with_wish(config, _NOWHERE | {"object": named[0], "sharp": True}) if named else None


def _tilted(config: Config) -> Config | None:
    if not config.focus or "tilt" in config.solve.free or config.lens.real is not None:
        return None
    if config.lens.focal_surface is not None:
        return None
    free = (*config.solve.free, "tilt")
    return config.model_copy(update={"solve": config.solve.model_copy(update={"free": free})})


def _with_wish(config: Config, wish: dict[str, Any]) -> Config | None:
    """The config with one more wish, where the first is; None where it has none, or a focal surface."""
    if not config.focus or config.lens.focal_surface is not None:
        return None
    first = config.focus[0]
    named = first.model_copy(update={"name": called(config, 0)})
    more = first.model_copy(update=_WITHOUT | {"name": "compiled ahead"} | wish)
    return config.model_copy(update={"focus": (named, *config.focus[1:], more)})


OTHERS: tuple[Callable[[Config], Config | None], ...] = (_limited, _same, _whole_object, _tilted)
"""Configs that are solved by programs of their own, made of one; None where that cannot be asked for."""
