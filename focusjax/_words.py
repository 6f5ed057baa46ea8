"""How messages say values and names."""

import difflib
from collections.abc import Iterable, Sequence
from typing import Any

_ALIKE = 0.65
"""Likeness of two names, from 0 to 1, from which on one may be a slip for the other."""


def shown(value: Any) -> str:
    """A number, or an array of numbers, as a person writes it: without the digits of rounding.

    Example:
        >>> shown(np.float32(0.7)), shown([0.5, 1e-9, 2])
        ('0.7', '[0.5, 1e-09, 2]')
    """
    import numpy as np  # Help needs no numbers.

    array = np.asarray(value, dtype=float)
    if array.ndim == 0:
        return f"{float(array):.6g}"
    return "[" + ", ".join(shown(one) for one in array) + "]"


def printable(text: str) -> str:
    r"""Text without control characters, which a terminal would obey; lines stay lines.

    Example:
        >>> printable("a\x1b[2Jb")
        'a\\x1b[2Jb'
    """
    return "".join(
        each if each == "\n" or each.isprintable() else each.encode("unicode_escape").decode()
        for each in text
    )


def nearest_name(name: str, known: Iterable[str]) -> str | None:
    """The known name that `name` may be a slip for; None when none is near."""
    plain = {each.casefold(): each for each in known}
    near = difflib.get_close_matches(name.casefold(), list(plain), n=1, cutoff=_ALIKE)
    return plain[near[0]] if near else None


def did_you_mean(name: str, known: Iterable[str], otherwise: str) -> str:
    """The known name that `name` may be a slip for, as a question; `otherwise` when none is near.

    Example:
        >>> did_you_mean("lam", ["lamp", "vase"], "there are lamp and vase")
        "did you mean 'lamp'?"
        >>> did_you_mean("table", ["lamp", "vase"], "there are lamp and vase")
        'there are lamp and vase'
    """
    near = nearest_name(name, known)
    return otherwise if near is None else f"did you mean {near!r}?"


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else list(names))


def kind_of(value: Any) -> str:
    """What a value is, for somebody who has given the wrong one: "a Camera", "a list of FocusPoint"."""
    name = type(value).__name__
    if isinstance(value, str):
        return f"the text {value!r}"
    if isinstance(value, bool | int | float):
        return f"the number {value!r}"
    if isinstance(value, list | tuple) and len({type(each) for each in value}) == 1:
        return f"a {name} of {type(value[0]).__name__}"
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
