"""A camera, a lens, and wishes straight ahead of them, for the tests of the focus solve."""

import jax.numpy as jnp
import pytest

from focusjax.focus import ImagePoints
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
