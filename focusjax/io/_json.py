"""JSON files that any program can read."""

import json
import math
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """`value` with infinite and undefined numbers as text ("inf"), since JSON has no word for them."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def json_text(value: Any) -> str:
    """`value` as the text of a JSON file."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def load_json(path: Path) -> Any:
    """What the JSON file `path` holds; None where it is missing, unreadable or broken."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
