"""JSON files that any program can read."""

import json
import math
from pathlib import Path
from typing import Any


def for_json(value: Any) -> Any:
    """`value` with every number that is not finite as text, since JSON has no word for those.

    Dicts, lists and tuples are gone through, however deep; tuples become lists. All else stays as it is.

    Example:
        >>> for_json({"far_m": float("inf"), "pixel": (1.5, 2.0)})
        {'far_m': 'inf', 'pixel': [1.5, 2.0]}
    """
    if isinstance(value, dict):
        return {key: for_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [for_json(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def json_text(value: Any) -> str:
    """`value` as the text of a JSON file."""
    return json.dumps(for_json(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def load_json(path: Path) -> Any:
    """What the JSON file `path` holds; None where it is missing, unreadable or broken."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def differing_keys(old: Any, new: Any, above: str = "") -> list[str]:
    """Dotted keys at which two values differ.

    Example:
        >>> differing_keys({"a": {"b": 1}, "c": [2, 3]}, {"a": {"b": 1}, "c": [2, 4]})
        ['c.1']
    """
    if old == new:
        return []
    pairs: list[tuple[str, Any, Any]]
    if isinstance(old, dict) and isinstance(new, dict):
        pairs = [(key, old.get(key), new.get(key)) for key in dict.fromkeys([*new, *old])]
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = [(str(number), *both) for number, both in enumerate(zip(old, new, strict=True))]
    else:
        return [above] if above else []
    return [key for step, a, b in pairs for key in differing_keys(a, b, f"{above}.{step}" if above else step)]
