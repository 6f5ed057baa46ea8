"""Whether the layers that are asked for fit into this machine's memory, before any work is done."""

import os

from focusjax.layers._grid import Grid

_BYTES = 200
"""Per sample and layer while layers are put together; measured over one to eight full layers."""
_SHARE = 0.9
"""Of the memory that layers may take: the rest is for the system and for the scene."""


def check_memory(grid: Grid, max_layers: int) -> None:
    """Refuse more layers than fit.

    All layers are counted, as how many a scene needs is known only when they are made.

    Raises:
        ValueError: naming the number of layers that would fit.
    """
    memory = machine_memory()
    if memory is None:
        return
    fitting = int(_SHARE * memory / (_BYTES * grid.size))
    if max_layers <= fitting:
        return
    size = f"{grid.columns} x {grid.rows} samples"
    needed = f"need about {max_layers * grid.size * _BYTES / 1e9:.3g} GB"
    limit = f"this machine has {memory / 1e9:.3g} GB"
    remedy = f"lower max_layers to {fitting}, or the" if fitting else "not even one fits: lower the"
    raise ValueError(
        f"{max_layers} layers of {size} {needed} and {limit}; {remedy} supersampling or the picture's size"
    )


def machine_memory() -> int | None:
    """Bytes of memory of this machine; None where the system does not tell.

    Not those that are free: most of what is not can be had back at once, as it holds copies of files.
    """
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None
