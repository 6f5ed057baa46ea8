"""What is made of an immutable object once, and goes when the object goes."""

import weakref
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

T = TypeVar("T")

_KEPT: dict[tuple[int, Hashable], Any] = {}


def kept(owner: object, what: Hashable, make: Callable[[], T]) -> T:
    """What `make` makes of `owner`, from the second time on without making it again.

    It lies beside the owner, not in it: copies and files of the owner are without it.
    """
    place = id(owner), what
    if place not in _KEPT:
        _KEPT[place] = make()
        weakref.finalize(owner, _KEPT.pop, place, None)
    return _KEPT[place]
