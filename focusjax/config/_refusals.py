"""From an argument that the library refuses to the key of the config that gave it."""

from collections.abc import Iterator
from contextlib import contextmanager

from focusjax.config._errors import ConfigError
from focusjax.config._load import Config
from focusjax.focus import ArgumentError

_KEYS = {
    "min_focus_distance": "solve.min_focus_distance_m",
    "max_focus_distance": "solve.max_focus_distance_m",
    "f_number_range": "lens.f_number",
    "f_number_range.0": "solve.f_number_min",
    "f_number_range.1": "solve.f_number_max",
    "tilt_range": "lens.tilt_deg",
    "swing_range": "lens.swing_deg",
    "focal_length_range": "camera.focal_length_mm",
    "focal_length_range.0": "solve.focal_length_min_mm",
    "focal_length_range.1": "solve.focal_length_max_mm",
    "shift_range": "camera.shift_mm",
    "rise_range": "camera.rise_mm",
    "lens": "lens",
    "close_focus": "lens.close_focus",
    "smoothness": "lens.focal_surface.smoothness",
} | {
    f"{name}_range.{end}": f"solve.{name}_{limit}_{unit}"
    for name, unit in (("tilt", "deg"), ("swing", "deg"), ("shift", "mm"), ("rise", "mm"))
    for end, limit in enumerate(("min", "max"))
}  # fmt: skip


@contextmanager
def refusals_located(config: Config, wishes: str = "focus") -> Iterator[None]:
    """What is refused inside becomes a `ConfigError` that names file and key.

    Args:
        config: where the arguments come from.
        wishes: the key of the tables that focus points come from.
    """
    try:
        yield
    except ArgumentError as error:
        raise ConfigError(f"{config.source}: {_key(error.argument, config, wishes)}: {error}") from error


def refuse_close_focus(config: Config, what: str) -> None:
    """Refuse a model of close focus where f-numbers and framing are taken to be those without one.

    Args:
        config: what is asked for.
        what: does not know of it, such as "the studio".

    Raises:
        ConfigError: the config has one.
    """
    model = config.lens.close_focus
    if model != "ignored":
        raise ConfigError(
            f"{config.source}: lens.close_focus is {model!r}, which {what} does not have; leave it out, or"
            " use `focusjax run`"
        )


def _key(argument: str, config: Config, wishes: str) -> str:
    """The key behind an argument's name; the solve's own names are those of `[solve]`."""
    steps = argument.split(".")
    if steps[0] != "points":
        return _KEYS.get(argument) or f"solve.{argument.replace('priors', 'prior')}"
    if len(steps) < 3 or wishes != "focus":
        return ".".join([wishes, *steps[1:2]])
    table = config.focus[int(steps[1])]
    return f"focus.{steps[1]}.{table.place_key if steps[2] == 'where' else table.wish_key}"
