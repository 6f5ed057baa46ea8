"""Films by name, from the tables in `data`."""

import functools
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, SupportsFloat

from focusjax._words import did_you_mean
from focusjax.film._curve import ResponseCurve, load_curve
from focusjax.film._film import Film, Sensor, film, sensor


def film_preset(name: str, *, rms_granularity: SupportsFloat | None = None) -> Film | Sensor:
    """A film or a sensor that comes with focusjax.

    "plain" is a sensor in proportion to the light, and "filmic" Hable's display curve. "negative",
    "reversal" and "black_and_white" are generic emulsions, of no product. `film` and `sensor` make others, of
    curves from `load_curve`.

    Args:
        name: one of `film_names`.
        rms_granularity: of an emulsion, for grain.

    Raises:
        ValueError: an unknown name, or a granularity of a sensor.

    Example:
        >>> slide = film_preset("reversal", rms_granularity=9)
    """
    films = _films()
    if name not in films:
        hint = did_you_mean(name, films, f"there are {', '.join(films)}")
        raise ValueError(f"there is no film {name!r}; {hint}")
    facts = films[name]
    if "curve" not in facts:
        if rms_granularity is not None:
            raise ValueError(f"{name} is a sensor, which has no grain; give it noise, by `sensor`")
        return sensor()
    return film(
        _curve(facts["curve"]),
        paper=_curve(facts["paper"]) if "paper" in facts else None,
        rms_granularity=rms_granularity,
        sensitivity=facts.get("sensitivity"),
    )


def film_names() -> tuple[str, ...]:
    """The names that `film_preset` knows."""
    return tuple(_films())


@functools.cache
def _films() -> dict[str, dict[str, Any]]:
    return tomllib.loads(resources.files("focusjax.film").joinpath("data/films.toml").read_text("utf-8"))


def _curve(name: str) -> ResponseCurve:
    with resources.as_file(resources.files("focusjax.film").joinpath("data", name)) as path:
        return load_curve(Path(path))
