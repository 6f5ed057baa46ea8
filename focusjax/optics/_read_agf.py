"""Glass catalogues of Zemax (`.agf`): the dispersion of each glass by one of its formulas."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.optics._catalogue import find_glass
from focusjax.optics._glass import FRAUNHOFER, AbstractGlass, Conrady, Herzberger, PowerSeries, Sellmeier
from focusjax.optics._lens_text import LensFileError, LensText

_INDEX_ERROR = 1e-3
"""By which a formula's n_d may differ from the one that the catalogue states."""
_COEFFICIENTS = {1: 6, 2: 6, 3: 6, 4: 5, 5: 3, 6: 8, 10: 8, 11: 10, 12: 8}
"""How many each formula of Zemax has, by its number; those that are left out are 0."""
_SCHOTT = (2.0, -2.0, -4.0, -6.0, -8.0)
_EXPONENTS = {1: _SCHOTT, 10: (*_SCHOTT, -10.0, -12.0), 12: (*_SCHOTT, 4.0, 6.0)}


@dataclasses.dataclass
class _Entry:
    """What a catalogue says of one glass.

    Attributes:
        name: as it is written there.
        line: where the glass begins, from 1.
        formula: its number, as text.
        n_d: as stated, at 587.56 nm, as text.
        coefficients: of the formula, as text.
        range_um: wavelengths in micrometres that the formula is for, as text; empty where nothing is said.
    """

    name: str
    line: int
    formula: str
    n_d: str
    coefficients: list[str] = dataclasses.field(default_factory=list)
    range_um: list[str] = dataclasses.field(default_factory=list)


@dataclasses.dataclass(frozen=True)
class GlassFile:
    """The glasses of one AGF file.

    Attributes:
        text: its lines, for messages.
        entries: by the name in lower case.
    """

    text: LensText
    entries: Mapping[str, _Entry]

    def find(self, name: str) -> AbstractGlass | None:
        """The glass of that name, in any case; None where the file has none.

        Raises:
            LensFileError: numbers that are none, or a formula that is not supported or gives another n_d.
        """
        entry = self.entries.get(name.strip().lower())
        return None if entry is None else _glass(self.text, entry)


def read_agf(path: str | Path) -> GlassFile:
    """The glasses of an AGF file: of each glass the lines NM, CD and LD are read, the others left out.

    Formulas are those of Zemax: Schott (1), Sellmeier 1 to 3 and 5 (2, 4, 6, 11), Herzberger (3), Conrady
    (5) and the extended ones (10, 12). A glass is looked at when it is asked for, so that others do no harm.

    Raises:
        LensFileError: a file that cannot be read, or that holds no glass.
    """
    text = LensText(Path(path))
    entries: dict[str, _Entry] = {}
    entry: _Entry | None = None
    for number, line in enumerate(text.lines, start=1):
        key, *words = line.split() or [""]
        if key == "NM":
            if len(words) < 4:
                raise text.refuse(number, "NM ends early; expected name, formula, code and n_d")
            entry = _Entry(words[0], number, words[1], words[3])
            entries.setdefault(words[0].lower(), entry)
        elif key == "CD" and entry is not None:
            entry.coefficients = words
        elif key == "LD" and entry is not None:
            entry.range_um = words[:2]
    if not entries:
        raise LensFileError(f"{path}: has no glass; expected an AGF catalogue, with lines that begin with NM")
    return GlassFile(text, entries)


def glass_finder(files: Sequence[str | Path]) -> Callable[[str], AbstractGlass]:
    """`find_glass`, with AGF files that are looked into before the table that comes with the package.

    Raises:
        LensFileError: see `read_agf`.
    """
    catalogues = [read_agf(path) for path in files]

    def find(name: str) -> AbstractGlass:
        for catalogue in catalogues:
            found = catalogue.find(name)
            if found is not None:
                return found
        return find_glass(name)

    return find


def _glass(text: LensText, entry: _Entry) -> AbstractGlass:
    """The glass of an entry, checked against its n_d where the formula reaches so far."""

    def number(word: str, what: str) -> float:
        return text.number(entry.line, word, f"{what} of glass {entry.name}")

    stated = number(entry.formula, "the formula")
    formula, n_d = int(stated), number(entry.n_d, "n_d")
    count = _COEFFICIENTS.get(formula)
    if count is None:
        known = ", ".join(str(number) for number in _COEFFICIENTS)
        raise text.refuse(
            entry.line,
            f"glass {entry.name} has the dispersion formula {stated:g}; supported are {known}",
        )
    given = [number(word, "a coefficient") for word in entry.coefficients[:count]]
    if not any(given):
        raise text.refuse(entry.line, f"glass {entry.name} has no coefficients; expected a line CD of them")
    glass = _of_formula(formula, [*given, *[0.0] * (count - len(given))])
    ends = [number(word, "the range") for word in entry.range_um]
    lowest, highest = ends if len(ends) == 2 else (0.0, float("inf"))
    if lowest <= FRAUNHOFER["d"] * 1e-3 <= highest:
        found = float(glass.index(jnp.asarray(FRAUNHOFER["d"], dtype=float)))
        if not abs(found - n_d) <= _INDEX_ERROR:
            raise text.refuse(
                entry.line,
                f"glass {entry.name} has n_d = {n_d:g}, but its formula {formula} gives"
                f" {found:.6g}; expected both alike, within {_INDEX_ERROR:g}",
            )
    return glass


def _of_formula(formula: int, c: list[float]) -> AbstractGlass:
    def array(values: Sequence[float]) -> Float[Array, " t"]:
        return jnp.asarray(values, dtype=float)

    if formula in _EXPONENTS:
        return PowerSeries(jnp.asarray(c[0], dtype=float), array(c[1:]), _EXPONENTS[formula])
    if formula == 3:
        return Herzberger(array(c))
    if formula == 4:
        # n^2 = 1 + A + B1 L^2 / (L^2 - l1^2) + B2 / (L^2 - l2^2),
        # the last a Sellmeier term less a constant.
        a, b1, l1, b2, l2 = c
        pole = l2**2
        last = b2 / pole if pole else 0.0
        return Sellmeier(jnp.asarray(a - last, dtype=float), array([b1, last]), array([l1**2, pole]))
    if formula == 5:
        return Conrady(*(jnp.asarray(value, dtype=float) for value in c))
    return Sellmeier(jnp.asarray(0.0, dtype=float), array(c[::2]), array(c[1::2]))
