"""A camera and lenses to be exported, and what their parts are in numbers."""

import jax.numpy as jnp
import numpy as np

from focusjax import look_at, polygon, thin_lens, tilt_shift_lens

WIDTH, HEIGHT = 80, 60


def slid_camera(**changes):
    """Off every axis, and slid by a whole number of half pixels: 4.5 to the right, 2 down."""
    pixel = 0.036 / WIDTH
    size = {"width": WIDTH, "height": HEIGHT, "focal_length": 0.05, "shift": 4.5 * pixel, "rise": -2 * pixel}
    return look_at((0.2, 0.3, 1.2), (0.05, 0.0, -0.1), **(size | changes))


def round_lens(**changes):
    return thin_lens(**({"focus_distance": 1.3, "f_number": 1.8, "focal_length": 0.05} | changes))


def bladed_lens():
    return round_lens(aperture=polygon(5, rotation=0.3))


def turned_lens():
    return tilt_shift_lens(
        focus_distance=1.2,
        tilt=0.1,
        swing=-0.05,
        f_number=2.0,
        focal_length=0.05,
        aperture=polygon(5, rotation=0.3, roundness=0.2),
    )


def world_points():
    """Points [n, 3] before the camera, inside and outside of the frame."""
    return np.random.default_rng(3).uniform((-0.4, -0.3, -2.0), (0.5, 0.4, 0.6), (20, 3))


def projected(camera, points):
    """Where `camera` sees them, in pixels [n, 2]."""
    return np.array([np.asarray(camera.project(jnp.asarray(point))[0]) for point in points])
