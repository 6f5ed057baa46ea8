"""Wishes for where things are shown: rows about places in the picture, beside those about blur."""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from focusjax.focus._image_points import ACROSS, AT_LEAST, AT_MOST, DOWN, EQUAL, ImagePoints
from focusjax.focus._places import BEHIND, Place
from focusjax.focus._points import InFrame, ShownAt, Wish
from focusjax.focus._units import pixels
from focusjax.geometry import Camera

_Row = tuple[int, int, float]


def frames(wish: Wish) -> bool:
    """Whether `wish` is about where something is shown."""
    return isinstance(wish, ShownAt | InFrame)


def ends(place: Place, wish: Wish) -> Place:
    """What of a place's extent the rows of `wish` are about (see `_rows`).

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


def with_framing(points: ImagePoints, wishes: Sequence[Wish], camera: Camera) -> ImagePoints:
    """The points, with the rows of wishes about places made such rows.

    Each row has all of its wish's weight: a wish costs its weight times the square of its distance in
    pixels from the place it is to be at.
    """
    if not any(frames(wish) for wish in wishes):
        return points
    index = np.asarray(points.wish)
    relation = np.zeros(len(index), dtype=int) if points.relation is None else np.asarray(points.relation)
    quantity, target = np.zeros(len(index), dtype=int), np.asarray(points.target).astype(float)
    signed, weight = np.asarray(points.signed).copy(), np.asarray(points.weight).astype(float)
    relation = relation.copy()
    for number, wish in enumerate(wishes):
        rows = np.flatnonzero(index == number)
        if not frames(wish):
            continue
        quantity[rows], relation[rows], target[rows] = zip(*_rows(wish, camera), strict=True)
        signed[rows] = True
        weight[rows] *= len(rows)
    return dataclasses.replace(
        points,
        target=jnp.asarray(target, dtype=float),
        signed=jnp.asarray(signed),
        weight=jnp.asarray(weight, dtype=float),
        relation=jnp.asarray(relation),
        quantity=jnp.asarray(quantity),
    )


def _rows(wish: Wish, camera: Camera) -> list[_Row]:
    """Quantity, relation and target in pixels of every row of a wish about places."""
    if isinstance(wish, ShownAt):
        return [(ACROSS, EQUAL, float(wish.x)), (DOWN, EQUAL, float(wish.y))]
    assert isinstance(wish, InFrame)
    margin = pixels(wish.margin, camera)
    return [
        (ACROSS, AT_LEAST, margin),
        (ACROSS, AT_MOST, camera.width - margin),
        (DOWN, AT_LEAST, margin),
        (DOWN, AT_MOST, camera.height - margin),
    ]
