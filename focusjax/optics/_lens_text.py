"""The lines of a lens or glass file, and refusals and warnings that name the line at fault."""

import math
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from focusjax.optics._catalogue import UnknownGlassError, find_glass, index_glass
from focusjax.optics._glass import AbstractGlass
from focusjax.optics._stated_glass import stated_glass

_LARGEST = 16 << 20
"""Bytes of the largest file that is read; the largest catalogues of glass have less than one MiB."""


class LensFileError(ValueError):
    """A lens file that cannot be read; the message names the file and the line."""


class LensText:
    """A lens or glass file's lines, and refusals that name the one at fault.

    Args:
        path: the file.
        find: gives the glass of a name, or raises a ValueError.

    Attributes:
        path: the file.
        lines: its text, line by line.
    """

    def __init__(self, path: Path, find: Callable[[str], AbstractGlass] = find_glass) -> None:
        self.path, self._find = path, find
        try:
            with path.open("rb") as stream:
                data = stream.read(_LARGEST + 1)
        except OSError as error:
            raise LensFileError(f"{path}: {error.strerror or error}") from None
        if len(data) > _LARGEST:
            raise LensFileError(f"{path}: is larger than {_LARGEST >> 20} MiB; expected a lens or glass file")
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        try:
            self.lines = data.decode("utf-16" if wide else "utf-8-sig").splitlines()
        except UnicodeDecodeError as error:
            if wide:
                raise LensFileError(
                    f"{path}: begins as UTF-16 text, but is none from byte {error.start} of {len(data)} on;"
                    " was it cut off while it was copied?"
                ) from None
            self.lines = data.decode("latin-1").splitlines()

    def refuse(self, line: int, why: object) -> LensFileError:
        """The error to raise about a line, counted from 1."""
        return LensFileError(f"{self.path}, line {line}: {why}")

    def number(self, line: int, text: object, what: str) -> float:
        """A finite number, or a refusal that says what was expected there."""
        try:
            value = float(str(text))
        except ValueError:
            raise self.refuse(line, f"{what} is {text!r}; expected a number") from None
        if not math.isfinite(value):
            raise self.refuse(line, f"{what} is {text!r}; expected a finite number")
        return value

    def glass(self, line: int, name: str) -> AbstractGlass:
        """A glass by name, or a refusal.

        Raises:
            UnknownGlassError: there is none of that name; callers say in which line.
            LensFileError: a number that makes no glass, or a catalogue at fault.
        """
        try:
            return self._find(name)
        except (UnknownGlassError, LensFileError):
            raise
        except ValueError as error:
            raise self.refuse(line, error) from None

    def stated_glass(self, line: int, table: Mapping[str, Any]) -> AbstractGlass:
        """A glass by a table of numbers."""
        try:
            return stated_glass(table)
        except ValueError as error:
            raise self.refuse(line, f"the glass {error}") from None

    def index(self, line: int, n_d: float, v_d: float | None) -> AbstractGlass:
        """A medium by its index and Abbe number."""
        try:
            return index_glass(n_d, v_d)
        except ValueError as error:
            raise self.refuse(line, error) from None

    def opening(self, line: int, value: float) -> float:
        """A semi-diameter, positive."""
        if not value > 0:
            raise self.refuse(line, f"an aperture is {value:g}; expected a positive one")
        return value

    def warn(self, line: int, what: str) -> None:
        """Say of a line, counted from 1, that it is not taken as it stands."""
        warnings.warn(f"{self.path}, line {line}: {what}", UserWarning, stacklevel=1)

    def warn_of_stand_in(self, line: int, name: str, n_d: float, v_d: float) -> None:
        """Say that a glass of the file is known by two numbers only."""
        self.warn(
            line,
            f"glass {name!r} is not in the catalogue; taken by the file's n_d = {n_d:g} and V_d = {v_d:g}",
        )
