"""Numbers and names in the files of other programs."""

import re

FARTHEST = 1e6
"""Metres that stand for an infinite focus distance, for which most formats have no word."""


def number(value: float) -> str:
    """As short as it can be without losing a digit.

    Example:
        >>> number(2.0), number(0.1)
        ('2', '0.1')
    """
    text = repr(float(value))
    return text.removesuffix(".0")


def identifier(name: str) -> str:
    """`name` as a word of letters, digits and underscores that does not start with a digit.

    Example:
        >>> identifier("Two 50s"), identifier("50 mm")
        ('Two_50s', '_50_mm')
    """
    word = re.sub(r"\W", "_", name, flags=re.ASCII) or "Camera"
    return f"_{word}" if word[0].isdigit() else word


def distance(metres: float) -> float:
    """A focus distance that is finite."""
    return min(metres, FARTHEST)
