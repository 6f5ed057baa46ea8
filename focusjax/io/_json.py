"""Values that JSON can hold."""

import math
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
