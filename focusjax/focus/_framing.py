"""Wishes for where things are shown: rows about places in the picture, beside those about blur."""

import dataclasses
from typing import Any, TypeAlias

import numpy as np

from focusjax.focus._image_points import ACROSS, AT_LEAST, AT_MOST, DOWN, EQUAL
from focusjax.focus._places import BEHIND, Place
from focusjax.focus._units import pixels
from focusjax.focus._wishes import InFrame, ShownAt, Wish
from focusjax.geometry import Camera

Row: TypeAlias = tuple[Any, int, bool, int]


def frames(wish: Wish) -> bool:
    """Whether `wish` is about where something is shown."""
    return isinstance(wish, ShownAt | InFrame)


def ends(place: Place, wish: Wish) -> Place:
    """What of a place's extent the rows of `wish` are about (see `framing_rows`).

    Sliding the frame and zooming keep it the extent's middle, or its ends.
    """
    if place.trouble == BEHIND:
        return dataclasses.replace(
            place, rows=np.tile(place.rows[:1], (4 if isinstance(wish, InFrame) else 2, 1))
        )
    x, y, disparity = place.rows.T
    if isinstance(wish, ShownAt):
        middle = [(x.min() + x.max()) / 2, (y.min() + y.max()) / 2, disparity.mean()]
        return Place(np.tile(middle, (2, 1)))
    return Place(place.rows[[x.argmin(), x.argmax(), y.argmin(), y.argmax()]])


def framing_rows(wish: Wish, camera: Camera) -> list[Row]:
    """Target in pixels, relation, whether it is signed, and quantity of every row of a wish about places."""
    if isinstance(wish, ShownAt):
        return [(wish.x, EQUAL, True, ACROSS), (wish.y, EQUAL, True, DOWN)]
    assert isinstance(wish, InFrame)
    margin = pixels(wish.margin, camera)
    return [
        (margin, AT_LEAST, True, ACROSS),
        (camera.width - margin, AT_MOST, True, ACROSS),
        (margin, AT_LEAST, True, DOWN),
        (camera.height - margin, AT_MOST, True, DOWN),
    ]
