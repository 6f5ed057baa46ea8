"""Files of other programs: numbers and names in them, and one for each frame where they hold one."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

from focusjax.exchange._record import Record

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


def each_frame(record: Record, path: Path, write: Callable[[Record, Path], object]) -> tuple[Path, ...]:
    """Write `path`, or for the frames of a shot `name.0001.ending` and so on, each a record of its own."""
    if not record.is_shot:
        write(record, path)
        return (path,)
    files = []
    for index, frame in enumerate(record.frames):
        files.append(path.with_name(f"{path.stem}.{index + 1:04d}{path.suffix}"))
        one = dataclasses.replace(
            record, frames=(frame,), lenses=(record.lenses[index],), cameras=(record.cameras[index],)
        )
        write(one, files[-1])
    return tuple(files)
