"""Glasses by name, from the table that comes with the package, and as index and Abbe number.

`data/glass_dispersion.csv` (CC0, from the refractiveindex.info database) has a row for each glass: formula 2
is Sellmeier's, formula 3 a series of powers.
"""

import csv
import difflib
import functools
import re
from importlib import resources

import jax.numpy as jnp

from focusjax.optics._glass import AbstractGlass, ConstantIndex, ModelGlass, PowerSeries, Sellmeier, air

_AIR = {"", "air", "vacuum", "occluder"}


def find_glass(name: str) -> AbstractGlass:
    """The glass of a catalogue name or code.

    Args:
        name: a name as in the table, in any case ("N-BK7", "F2"); "air"; index and Abbe number
            ("1.5168/64.17"); or an index alone ("1.67"), which has no dispersion.

    Raises:
        ValueError: an unknown name, with the nearest there are; an index below 1; an Abbe number not above 0.

    Example:
        >>> import jax.numpy as jnp
        >>> round(float(find_glass("n-bk7").index(jnp.asarray(587.5618))), 5)
        1.5168
    """
    text = name.strip()
    if text.lower() in _AIR:
        return air()
    if re.fullmatch(r"[-+.\d][-+.\deE]*(/[-+.\d][-+.\deE]*)?", text):
        index, _, abbe = text.partition("/")
        return index_glass(_number(index, name), _number(abbe, name) if abbe else None)
    glass = _table().get(text.lower())
    if glass is None:
        names = glass_names()
        lower = {known.lower(): known for known in names}
        near = [lower[found] for found in difflib.get_close_matches(text.lower(), lower, n=3, cutoff=0.4)]
        hint = f"; did you mean {', '.join(near)}?" if near else f"; known are {', '.join(names)}"
        raise ValueError(f"there is no glass {name!r}{hint}")
    return glass


def index_glass(n_d: float, v_d: float | None = None) -> AbstractGlass:
    """The medium of an index at 587.56 nm and, if it disperses, an Abbe number.

    Raises:
        ValueError: an index below 1 or an Abbe number not above 0.
    """
    if not 1.0 <= n_d < 5.0:
        raise ValueError(f"a refractive index is {n_d:g}; expected at least 1, and below 5")
    index = jnp.asarray(n_d, dtype=float)
    if v_d is None:
        return ConstantIndex(index)
    if not 0.0 < v_d < float("inf"):
        raise ValueError(f"an Abbe number is {v_d:g}; expected a positive one")
    return ModelGlass(index, jnp.asarray(v_d, dtype=float))


def glass_names() -> list[str]:
    """The names in the table, as it has them."""
    return [row["glass"] for row in _rows()]


def _number(text: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"glass {name!r} is no number; expected an index such as 1.67") from None


@functools.cache
def _rows() -> list[dict[str, str]]:
    table = resources.files("focusjax.optics").joinpath("data/glass_dispersion.csv")
    return list(csv.DictReader(table.read_text("utf-8").splitlines()))


def _table() -> dict[str, AbstractGlass]:
    return {row["glass"].lower(): _from_row(row) for row in _rows()}


def _from_row(row: dict[str, str]) -> AbstractGlass:
    numbers = [float(row[f"c{number}"]) for number in range(17) if row[f"c{number}"]]
    constant, odd, even = numbers[0], numbers[1::2], numbers[2::2]
    first = jnp.asarray(constant, dtype=float)
    if row["formula"] == "2":
        return Sellmeier(first, jnp.asarray(odd, dtype=float), jnp.asarray(even, dtype=float))
    return PowerSeries(first, jnp.asarray(odd, dtype=float), tuple(even))
