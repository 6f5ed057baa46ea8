"""What is likely to be asked for next, so that its programs are compiled before."""

from collections.abc import Iterator
from typing import Any

from focusjax.config import Config

_NO_PLACE = dict.fromkeys(("pixel", "point", "direction", "triangle", "barycentric", "mask", "depth_m"))
_NO_WISH = dict.fromkeys(("sharp", "same_blur_as", "shown_at", "blur_px", "blur_mm", "blur_height"))


def other_configs(config: Config) -> Iterator[Config]:
    """The config with one more wish, of the kinds that are solved by programs of their own, and tilted."""
    first = config.focus[0]
    name = first.name or first.object
    wishes: list[dict[str, Any]] = [{"at_most_px": 1e3}]
    if name is not None:
        wishes.append({"same_blur_as": name})
    for wish in wishes:
        more = first.model_copy(update=_NO_WISH | {"name": "warm-up", **wish})
        yield config.model_copy(update={"focus": (*config.focus, more)})
    named = [each.name for each in config.scene.objects if each.name]
    if named:
        whole = first.model_copy(
            update=_NO_WISH | _NO_PLACE | {"name": "warm-up", "object": named[0], "sharp": True}
        )
        yield config.model_copy(update={"focus": (*config.focus, whole)})
    if "tilt" not in config.solve.free and config.lens.prescription is None:
        solve = config.solve.model_copy(update={"free": (*config.solve.free, "tilt")})
        yield config.model_copy(update={"solve": solve})
