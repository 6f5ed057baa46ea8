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
_ALIASES = {
    "f_silica": "silica",
    "fused_silica": "silica",
    "fusedsilica": "silica",
    "sio2": "silica",
    "calcium_fluoride": "caf2",
    "acrylic": "pmma",
    "polycarbonate": "polycarb",
    "polystyrene": "polystyr",
    "zeonex_e48r": "e48r",
}
"""Other names, in lower case, of what the table has."""


class UnknownGlassError(ValueError):
    """There is no glass of that name; the message has the nearest names."""


def find_glass(name: str) -> AbstractGlass:
    """The glass of a catalogue name or code.

    Args:
        name: a name as in the table, in any case ("N-BK7", "F2"); an old name of Schott, whose glass of today
            is called N- and so ("BK7"); another usual name ("SIO2", "F_SILICA"); "air"; index and Abbe number
            ("1.5168/64.17"); or an index alone ("1.67"), which has no dispersion.

    Raises:
        UnknownGlassError: an unknown name, with the nearest there are.
        ValueError: an index below 1; an Abbe number not above 0.

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
    rows, lower = _rows(), text.lower()
    row = rows.get(lower) or rows.get(_ALIASES.get(lower, f"n-{lower}"))
    if row is None:
        near = difflib.get_close_matches(lower, rows, n=3, cutoff=0.4)
        found = ", ".join(rows[key]["glass"] for key in near)
        hint = f"; did you mean {found}?" if near else f"; {len(rows)} are known, see glass_names()"
        raise UnknownGlassError(f"there is no glass {name!r}{hint}")
    return _from_row(row)


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
    return [row["glass"] for row in _rows().values()]


def _number(text: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"glass {name!r} is no number; expected an index such as 1.67") from None


@functools.cache
def _rows() -> dict[str, dict[str, str]]:
    """The rows of the table by the glass's name in lower case."""
    table = resources.files("focusjax.optics").joinpath("data/glass_dispersion.csv")
    return {row["glass"].lower(): row for row in csv.DictReader(table.read_text("utf-8").splitlines())}


def _from_row(row: dict[str, str]) -> AbstractGlass:
    numbers = [float(row[f"c{number}"]) for number in range(17) if row[f"c{number}"]]
    constant, odd, even = numbers[0], numbers[1::2], numbers[2::2]
    first = jnp.asarray(constant, dtype=float)
    if row["formula"] == "2":
        return Sellmeier(first, jnp.asarray(odd, dtype=float), jnp.asarray(even, dtype=float))
    return PowerSeries(first, jnp.asarray(odd, dtype=float), tuple(even))
