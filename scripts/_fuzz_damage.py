"""Values, tables and bytes damaged by chance."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

ODD_VALUES = (
    *(0, -1, 1, 2, 7, 1e-30, 1e39, -1e39, 1e300, 2**40, 0.5, -0.5, 1e-6, 1e6, 89.9, 360),
    *(
        math.nan,
        math.inf,
        -math.inf,
        True,
        False,
        "",
        "x",
        "near",
        "far",
        "box.ply",
        "../../etc/passwd",
        "[/b]",
    ),
    *(
        [],
        [0],
        [0, 0],
        [0, 0, 0],
        [1, 2, 3],
        [math.nan] * 3,
        [1e20] * 3,
        [[1, 0, 0, 0]] * 4,
        {},
        {"kind": "x"},
    ),
)


def odd(rng: np.random.Generator) -> Any:
    value = ODD_VALUES[rng.integers(len(ODD_VALUES))]
    return float(rng.normal(0, 10)) if rng.random() < 0.2 else value


def nearby(value: Any, rng: np.random.Generator) -> Any:
    """What another might have written there: the same kind, some times as large, or of the other sign."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return str(rng.choice([each for each in ODD_VALUES if isinstance(each, str)]))
    if isinstance(value, list):
        return [nearby(each, rng) if rng.random() < 0.5 else each for each in value]
    if not isinstance(value, int | float):
        return odd(rng)
    changed = -value if rng.random() < 0.2 else value * 10.0 ** rng.normal(0, 0.7)
    return round(changed) if isinstance(value, int) and rng.random() < 0.8 else float(changed)


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every key and index within tables and arrays."""
    inside = (
        list(node.items())
        if isinstance(node, dict)
        else list(enumerate(node))
        if isinstance(node, list)
        else []
    )
    return [each for key, value in inside for each in ((*path, key), *places(value, (*path, key)))]


def change(data: dict[str, Any], rng: np.random.Generator, within: tuple[str, ...] = ()) -> None:
    """Values of a config replaced, removed or repeated, in these tables alone where some are given."""
    for _ in range(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15])):
        found = [path for path in places(data) if not within or path[0] in within]
        if not found:
            return
        path = found[rng.integers(len(found))]
        parent: Any = data
        for key in path[:-1]:
            parent = parent[key]
        act = rng.random()
        if act < 0.7:
            parent[path[-1]] = nearby(parent[path[-1]], rng)
        elif act < 0.85:
            parent[path[-1]] = odd(rng)
        elif act < 0.95:
            del parent[path[-1]]
        elif isinstance(parent, list):
            parent.append(parent[path[-1]])
        else:
            parent[f"{path[-1]}s"] = odd(rng)


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes flipped, left out, repeated, or cut off; numbers in text replaced."""
    act = rng.random()
    if act < 0.35:
        found = list(re.finditer(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?", data[: 1 << 16]))
        if found:
            one = found[rng.integers(len(found))]
            number = [b"0", b"-1", b"nan", b"inf", b"1e39", b"1e-39", b"99999999999", b"x"][rng.integers(8)]
            return data[: one.start()] + number + data[one.end() :]
    if act < 0.5:
        return data[: rng.integers(len(data) + 1)]
    start = int(rng.integers(len(data)))
    end = min(len(data), start + int(rng.integers(1, 64)))
    if act < 0.65:
        return data[:start] + data[end:]
    if act < 0.8:
        return data[:start] + data[start:end] * 2 + data[end:]
    noise = rng.integers(0, 256, end - start, dtype=np.uint8).tobytes()
    return data[:start] + noise + data[end:]


def damage(path: Path, rng: np.random.Generator) -> None:
    data = path.read_bytes()
    for _ in range(rng.integers(1, 3)):
        data = damaged(data, rng) if data else b"\0"
    path.write_bytes(data)
