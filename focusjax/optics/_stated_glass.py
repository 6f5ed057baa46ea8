"""A glass by what is stated of it in a table of a lens file or a config, checked."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from focusjax._arguments import real_number
from focusjax.optics._catalogue import index_glass
from focusjax.optics._glass import FRAUNHOFER, RGB_WAVELENGTHS, AbstractGlass, CauchyGlass, Sellmeier

_FORMS = ("n_d", "sellmeier", "n", "lines")
_MOST_TERMS, _MOST_LINES = 6, 5
_SPAN = (min(RGB_WAVELENGTHS), max(RGB_WAVELENGTHS))
"""Wavelengths in nm that pictures are traced at."""
_LEAST, _BELOW, _ROUNDING = 1.0, 5.0, 1e-6


def stated_glass(table: Mapping[str, Any]) -> AbstractGlass:
    """The glass of a table that states it in exactly one of four forms.

    Args:
        table: `n_d` and `v_d`, index and Abbe number; `sellmeier`, a table of `b` and `c_um2`, the
            coefficients B and C (in micrometres squared) of `Sellmeier`; `n`, the indices of the picture's
            red, green and blue (650, 510 and 475 nm); or `lines`, two to five indices by the names of their
            `FRAUNHOFER` lines. Through the last two goes Cauchy's series (`CauchyGlass`).

    Raises:
        ValueError: no form or two, keys or numbers that are missing or not known, or an index that is not
            from 1 to below 5 all the way from 475 to 650 nm. The message completes "the glass ...".

    Example:
        >>> from focusjax.optics import abbe_number
        >>> glass = stated_glass({"lines": {"d": 1.5168, "F": 1.52238, "C": 1.51432}})
        >>> round(float(abbe_number(glass)), 1)
        64.1
    """
    strange = [key for key in table if key not in (*_FORMS, "v_d")]
    if strange:
        raise ValueError(f"has {strange[0]!r}; expected {', '.join(_FORMS)}, or v_d beside n_d")
    given = [key for key in _FORMS if key in table]
    if not given:
        said = "has v_d without n_d" if "v_d" in table else "says nothing of its index"
        raise ValueError(f"{said}; give n_d and v_d, sellmeier, n, or lines")
    if "v_d" in table and "n_d" not in table:
        given.append("v_d")
    if len(given) > 1:
        raise ValueError(f"has {given[0]} and {given[1]}, which both say its index; give one of them")
    glass = _of_form(given[0], table)
    _check_span(glass)
    return glass


def _of_form(form: str, table: Mapping[str, Any]) -> AbstractGlass:
    value = table[form]
    if form == "sellmeier":
        return _sellmeier(value)
    if form == "n_d":
        if "v_d" not in table:
            raise ValueError(
                f'has n_d = {value} without v_d; give its Abbe number, too, or "{value}" as the name of a'
                " glass without dispersion"
            )
        abbe = _number(table["v_d"], "v_d")
        if not 0.0 < abbe < float("inf"):
            raise ValueError(f"has v_d = {abbe:g}; expected a positive Abbe number such as 64.17")
        return index_glass(_index(value, "n_d"), abbe)
    if form == "n":
        if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
            raise ValueError(f"has n = {value}; expected three indices, for red, green and blue")
        colours = ("red", "green", "blue")
        named = {f"n of {colour}": index for colour, index in zip(colours, value, strict=True)}
        return _through(named, RGB_WAVELENGTHS)
    if not isinstance(value, Mapping) or not 2 <= len(value) <= _MOST_LINES:
        raise ValueError(
            f"has lines = {value}; expected two to {_MOST_LINES} indices by the names of their lines, such as"
            " {C = 1.51432, d = 1.5168, F = 1.52238}"
        )
    strange = [name for name in value if name not in FRAUNHOFER]
    if strange:
        raise ValueError(f"has the line {strange[0]!r}; expected some of {', '.join(FRAUNHOFER)}")
    named = {f"the line {name}": index for name, index in value.items()}
    return _through(named, tuple(FRAUNHOFER[name] for name in value))


def _sellmeier(value: Any) -> Sellmeier:
    if not isinstance(value, Mapping) or set(value) != {"b", "c_um2"}:
        raise ValueError(f"has sellmeier = {value}; expected a table of b and c_um2, as many of each")
    counts = [len(value[key]) if isinstance(value[key], Sequence) else 0 for key in ("b", "c_um2")]
    if counts[0] != counts[1] or not 1 <= counts[0] <= _MOST_TERMS:
        raise ValueError(
            f"has {counts[0]} numbers b and {counts[1]} numbers c_um2 in sellmeier; expected as many of each,"
            f" usually three, at most {_MOST_TERMS}"
        )
    strengths, poles = ([_number(each, key) for each in value[key]] for key in ("b", "c_um2"))
    for pole in poles:
        at = 1e3 * math.sqrt(max(pole, 0.0))
        if _SPAN[0] <= at <= _SPAN[1]:
            raise ValueError(
                f"has c_um2 = {pole:g} in sellmeier, so that its index is infinite at {at:.4g} nm; expected"
                f" no such wavelength from {_SPAN[0]:g} to {_SPAN[1]:g} nm"
            )
    return Sellmeier(*(jnp.asarray(each, dtype=float) for each in (0.0, strengths, poles)))


def _through(indices: Mapping[str, Any], wavelengths: tuple[float, ...]) -> CauchyGlass:
    values = [_index(index, name) for name, index in indices.items()]
    return CauchyGlass(jnp.asarray(values, dtype=float), wavelengths)


def _number(value: Any, what: str) -> float:
    try:
        return real_number(value, what, "a number")
    except ValueError:
        raise ValueError(f"has {what} = {value!r}; expected a number") from None


def _index(value: Any, what: str) -> float:
    index = _number(value, what)
    if not _LEAST <= index < _BELOW:
        raise ValueError(f"has the index {index:g} as {what}; expected at least 1, and below 5")
    return index


def _check_span(glass: AbstractGlass) -> None:
    """Refuse what makes no index somewhere in the wavelengths of pictures."""
    across = np.linspace(*_SPAN, 65)
    found = np.asarray(jax.vmap(glass.index)(jnp.asarray(across, dtype=float)))
    wrong = ~((found >= _LEAST - _ROUNDING) & (found < _BELOW))
    if wrong.any():
        raise ValueError(
            f"has the index {found[wrong.argmax()]:.6g} at {across[wrong.argmax()]:.4g} nm; expected at least"
            f" 1, and below 5, from {_SPAN[0]:g} to {_SPAN[1]:g} nm"
        )
