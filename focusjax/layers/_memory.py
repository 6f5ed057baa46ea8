"""Whether layers fit into this machine's memory, before they are put together."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from focusjax.layers._boxes import Boxes, covered_area
from focusjax.layers._clip import ScreenTriangles
from focusjax.layers._grid import Grid

_BYTES = 200
"""Per sample that is kept, while layers are put together; measured over one to eight full layers."""
_BYTES_OF_ROOM = 8
"""Per sample of the grid and layer, whether anything is kept there or not."""
_BYTES_OF_PLACE = 40
"""Per place for a sample that is empty; measured as 19 in single precision."""
_BYTES_OF_FRAGMENT = 48
"""Of each time that a triangle covers a sample, while layers are peeled: 43 to 50 over twenty full panes."""
_SHARE = 0.9
"""Of the memory that layers may take: the rest is for the system and for the scene."""
_SHARE_HELD = 0.4
"""That layers of many times may take together: putting together the next ones takes about as much again."""
_CONTAINER_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def check_frame(grid: Grid) -> None:
    """Refuse a grid of which not even one full layer fits.

    Raises:
        ValueError: naming what it needs.
    """
    memory = machine_memory()
    needed = _BYTES * grid.size
    if memory is None or needed <= _SHARE * memory:
        return
    raise ValueError(
        f"a layer of {grid.columns} x {grid.rows} samples needs about {needed / 1e9:.3g} GB and this machine"
        f" has {memory / 1e9:.3g} GB; {_smaller(needed, memory)}"
    )


def _smaller(needed: float, memory: int) -> str:
    """What to do where samples need too much: less in both directions."""
    percent = math.floor(100.0 * math.sqrt(_SHARE * memory / needed))
    return f"lower the supersampling, or the picture's width and height to {percent} %"


def _rounded(value: float) -> str:
    """Three digits, and no powers of ten for what people count in thousands."""
    return f"{float(f'{value:.3g}'):g}"


def check_fragments(triangles: ScreenTriangles, boxes: Sequence[Boxes], grid: Grid) -> None:
    """Refuse triangles that cover the samples so many times that all of it does not fit.

    Boxes are larger than what is in them, so that nearly always they alone show that there is room.

    Raises:
        ValueError: naming what they need, and what would fit.
    """
    memory = machine_memory()
    if memory is None:
        return
    room = _SHARE * memory / _BYTES_OF_FRAGMENT
    if sum(float(some.samples.sum()) for some in boxes) <= room:
        return
    count = covered_area(grid, triangles, boxes)
    if count <= room:
        return
    raise ValueError(
        f"surfaces cover the {grid.columns} x {grid.rows} samples about {_rounded(count / grid.size)} times"
        f" over, which needs about {_rounded(_BYTES_OF_FRAGMENT * count / 1e9)} GB, and this machine has"
        f" {_rounded(memory / 1e9)} GB, enough for {_rounded(room / grid.size)} times; leave some of the"
        f" surfaces out, or {_smaller(_BYTES_OF_FRAGMENT * count, memory)}"
    )


def check_layers(grid: Grid, kept: Sequence[int], limit: str) -> None:
    """Refuse layers on a grid that do not fit, of so many samples `kept` in each, nearest layer first.

    `limit` is the argument that bounds their number.

    Raises:
        ValueError: naming the number of layers that would fit.
    """
    memory = machine_memory()
    if memory is None or not len(kept):
        return
    needed = np.cumsum(np.asarray(kept, dtype=float) * _BYTES + grid.size * _BYTES_OF_ROOM)
    fitting = int((needed <= _SHARE * memory).sum())
    if fitting == len(kept):
        return
    remedy = f"lower {limit} to {fitting}, or the" if fitting else "not even one fits: lower the"
    raise ValueError(
        f"{len(kept)} layers that hold {sum(kept)} samples need about {needed[-1] / 1e9:.3g} GB and this"
        f" machine has {memory / 1e9:.3g} GB; {remedy} supersampling or the picture's size"
    )


def layers_fit(grid: Grid, count: int, kept: int, room: int) -> bool:
    """Whether `count` layers on a grid fit that keep so many samples in all, and have room for so many."""
    memory = machine_memory()
    needed = kept * _BYTES + (room - kept) * _BYTES_OF_PLACE + count * grid.size * _BYTES_OF_ROOM
    return memory is None or needed <= _SHARE * memory


def check_held(held: int, what: str, remedy: str) -> None:
    """Refuse layers of so many times that those of the next ones may not fit beside the bytes `held`.

    Raises:
        ValueError: it says `what` layers these are, and the `remedy` that would take less.
    """
    memory = machine_memory()
    if memory is not None and held > _SHARE_HELD * memory:
        raise ValueError(
            f"{what} take {held / 1e9:.3g} GB, and making more of them takes as much again, but this"
            f" machine has {memory / 1e9:.3g} GB; {remedy}"
        )


def machine_memory() -> int | None:
    """Bytes of memory that this machine, or the container on it, has; None if the system reports none.

    Not those that are free: most of what is not can be had back at once, as it holds copies of files.
    """
    try:
        physical = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None
    return min([physical, *_limits_of_container()])


def _limits_of_container() -> list[int]:
    """Bytes that control groups, of version 2 and 1, allow a container's processes together."""
    limits = []
    for file in _CONTAINER_LIMITS:
        try:
            limits.append(int(file.read_text()))
        except (OSError, ValueError):
            # There is no such group, or "max", which is no limit.
            continue
    return limits
