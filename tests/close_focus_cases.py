"""A camera, wishes straight ahead and the textbook's blur, for solves with a model of close focus."""

import numpy as np
import pytest

import focusjax as fj
from focusjax.focus import AtPoint, FocusPoint
from focusjax.lens import close_focus_lens

MODELS = ("framing", "breathing")
FRAMING_FIRST = ("framing", pytest.param("breathing", marks=pytest.mark.slow))
"""For tests that compile much, where the other model, of a length of the other sign, goes the same way."""
STATED, SENSOR, PIXELS = 0.05, 0.036, 640
CAMERA = fj.look_at((0, 0, 0), (0, 0, -1), width=PIXELS, height=480, focal_length=STATED)


def start_of(model, distance=1.0, number=4.0):
    return close_focus_lens(CAMERA, model, focus_distance=distance, f_number=number)[1]


def ahead(*wishes):
    """Wishes straight ahead, as (distance, wish)."""
    return [FocusPoint(AtPoint((0.0, 0.0, -z)), wish, name=f"{z} m") for z, wish in wishes]


def textbook_blur(model, distance, number, places):
    """Signed diameters in pixels, by image distances and the focal length, as the papers have it."""
    if model == "framing":
        length = 1.0 / (1.0 / STATED + 1.0 / distance)
        image = STATED
    else:
        length = STATED
        image = 1.0 / (1.0 / length - 1.0 / distance)
    sharp_at = 1.0 / (1.0 / length - 1.0 / np.asarray(places))
    return (length / number) * (image - sharp_at) / sharp_at * (PIXELS / SENSOR)
