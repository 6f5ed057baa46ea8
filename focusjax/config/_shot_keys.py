"""Keyframes in a config: rows with a frame, in order."""

import itertools
from typing import Any

from pydantic import Field

from focusjax.config._values import Number, Table


class Key(Table):
    """A keyframe."""

    frame: Number = Field(description="the keyframe's frame; the shot's first one is 1")


def in_order(keys: tuple[Key, ...], what: str) -> None:
    """Refuse keyframes that are not in ascending order."""
    for earlier, later in itertools.pairwise(keys):
        if not earlier.frame < later.frame:
            raise ValueError(
                f"has a keyframe of {what} at frame {later.frame:g} after one at frame {earlier.frame:g}; put"
                " them in ascending order, each frame once"
            )


def values_of(keys: tuple[Any, ...], name: str) -> dict[float, Any]:
    """One key's values by frame, of the keyframes that have it."""
    return {key.frame: value for key in keys if (value := getattr(key, name)) is not None}
