"""Values of config keys as text and back, and the axes of a grid."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from focusjax.batch._errors import BatchError

Change = tuple[str, Any]
"""A dotted key of the config, and the value it gets."""


def toml_text(value: Any) -> str:
    """`value` as TOML writes it, on one line.

    Example:
        >>> toml_text([2, "words", {"sharp": True}])
        '[2, "words", {sharp = true}]'
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # A text in JSON is a basic string in TOML.
        return json.dumps(value)
    if isinstance(value, Mapping):
        pairs = (f"{_key(str(key))} = {toml_text(item)}" for key, item in value.items())
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(toml_text(item) for item in value) + "]"
    return str(value)


def shown(value: Any) -> str:
    """`value` as a person reads it: as TOML, words without quotes."""
    return value if isinstance(value, str) else toml_text(value)


def parse_grid(texts: Sequence[str]) -> dict[str, list[Any]]:
    """The axes of a grid from `KEY=[VALUE, ...]` texts.

    Example:
        >>> parse_grid(["lens.f_number=[2, 4]", 'render.quality=["draft"]'])
        {'lens.f_number': [2, 4], 'render.quality': ['draft']}

    Raises:
        BatchError: a text that is not of this form, or a key given twice.
    """
    axes: dict[str, list[Any]] = {}
    for text in texts:
        key, equals, values = text.partition("=")
        key = key.strip()
        try:
            found = tomllib.loads(f"values = {values}")["values"] if equals and key else None
        except tomllib.TOMLDecodeError:
            found = None
        if not isinstance(found, list):
            raise BatchError(
                f"--grid {text}: expected KEY=[VALUE, ...], for example lens.f_number=[2, 4, 8]; text in the"
                ' brackets wants quotes, as in ["draft", "good"]'
            )
        if key in axes:
            raise BatchError(f"--grid {text}: {key} has a --grid already; put all its values into one")
        axes[key] = found
    return axes


def check_grid(axes: Mapping[str, Sequence[Any]]) -> None:
    """Refuse axes without values, or with the same value twice.

    Raises:
        BatchError: see above.
    """
    for key, values in axes.items():
        if isinstance(values, str) or not values:
            raise BatchError(f"the grid's {key} has no values; give some, for example [2, 4, 8]")
        texts = [toml_text(value) for value in values]
        for text in texts:
            if texts.count(text) > 1:
                raise BatchError(f"the grid's {key} has {text} {texts.count(text)} times; give it once")


def _key(text: str) -> str:
    bare = text.replace("_", "").replace("-", "")
    return text if bare.isascii() and bare.isalnum() else json.dumps(text)
