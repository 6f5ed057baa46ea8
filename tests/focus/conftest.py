"""A camera, a lens, and wishes straight ahead of them, for the tests of the focus solve."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.focus import EQUAL, ImagePoints
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens


@pytest.fixture
def make_setup():
    """Builds camera and lens on call, so that a test can do it in float32, too."""

    def build(*, focus_distance=5.0, f_number=2.0):
        camera = make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
        lens = thin_lens(focus_distance=focus_distance, f_number=f_number, focal_length=0.05)
        return camera, lens

    return build


@pytest.fixture
def make_points():
    """Image points from (disparity, target, signed, weight) rows, one wish each.

    The last row is repeated without weight up to `size` rows: what is compiled for one problem then
    serves the others.
    """

    def build(*rows, tolerance=1.0, size=6):
        rows = [*rows, *[(*rows[-1][:3], 0.0)] * (size - len(rows))]
        disparity, target, signed, weight = zip(*rows, strict=True)
        count = len(rows)
        return ImagePoints(
            xy=jnp.full((count, 2), 100.0, dtype=float),
            disparity=jnp.asarray(disparity, dtype=float),
            target=jnp.asarray(target, dtype=float),
            signed=jnp.asarray(signed),
            weight=jnp.asarray(weight, dtype=float),
            tolerance=jnp.full(count, tolerance, dtype=float),
            wish=jnp.arange(count),
            names=tuple(f"wish {index}" for index in range(count)),
        )

    return build


@pytest.fixture
def make_frames(make_points):
    """Points of every frame from disparities [t, n], and targets, signs and weights that broadcast to that.

    All problems have the same structure, so that what is compiled for one serves the others: one row more,
    unsigned and without weight, and a relation.
    """

    def build(disparity, target=0.0, signed=True, weight=1.0, relation=EQUAL):
        arrays = np.broadcast_arrays(np.asarray(disparity, dtype=float), target, signed, weight)
        found = []
        for t in range(len(arrays[0])):
            points = make_points(*zip(*(array[t] for array in arrays), strict=True), (0.5, 0.0, False, 0.0))
            found.append(dataclasses.replace(points, relation=jnp.full(points.wish.shape, relation)))
        return found

    return build
