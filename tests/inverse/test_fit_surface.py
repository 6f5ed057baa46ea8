"""Focal surfaces found again from their pictures."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, varied_scene

from focusjax.inverse import fit_focal_surface, widest_lens
from focusjax.layers import peel
from focusjax.lens import ThinLens, focal_surface, focal_surface_lens
from focusjax.trace import render

PLACES = [(6.0, 16.0), (9.5, 5.0), (16.0, 10.0), (16.0, 21.0)]
"""On the ball at the border, the bar, the ball in the middle, and the floor."""
TRUE = np.array([0.75, 0.9, 0.45, 0.7])
RADIUS = 8.0 / 40
GAIN = 0.7


@pytest.fixture(scope="module")
def layers():
    camera = front_camera()
    f_number = float(camera.focal_length) / (2 * 12.0 / 40)
    return peel(
        varied_scene(),
        camera,
        widest_lens(camera, min_focus_distance=0.8, f_number=f_number),
        supersampling=2,
    )


@pytest.mark.slow
def test_control_values_opening_and_gain_are_found(layers):
    camera = front_camera()
    surface = focal_surface(PLACES, TRUE)
    true = focal_surface_lens(surface, camera, ThinLens(jnp.array(0.0), jnp.array(RADIUS)))
    target = GAIN * np.asarray(render(layers, true, rays=256, even=True, seed=5))
    start = ThinLens(jnp.array(0.0), jnp.array(0.05))
    fit = fit_focal_surface(target, layers, start, focal_surface(PLACES, 0.1), free=("f_number", "gain"))
    found = np.asarray(fit.surface.focus_disparity)
    assert np.abs(found - TRUE).max() < 0.02
    assert abs(float(fit.lens.aperture_radius) / RADIUS - 1) < 0.02
    assert abs(fit.gain / GAIN - 1) < 0.005
    assert (np.abs(found - TRUE) < 5 * fit.standard_errors).all()
    assert fit.converged
    again = fit.gain * np.asarray(render(layers, fit.lens, rays=64, even=True))
    np.testing.assert_allclose(fit.picture, again, rtol=0, atol=1e-12)


def test_what_is_no_name_is_refused(layers):
    with pytest.raises(ValueError, match="free has 'focus'; expected some of"):
        fit_focal_surface(
            np.ones((24, 32, 3)), layers, layers.lens, focal_surface(PLACES, 0.1), free=("focus",)
        )
