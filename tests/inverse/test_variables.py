"""From settings to variables without bounds and back, within what layers serve."""

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, varied_layers, varied_scene

from focusjax.inverse import widest_lens
from focusjax.inverse._variables import make_variables, settings_of
from focusjax.layers import peel
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.trace import check_reach, widest_opening

FREE = ("focus", "f_number", "tilt", "swing", "gain")
LIKE = jnp.zeros((24, 32, 3))


def test_a_start_is_kept():
    layers = varied_layers()
    lens = TiltShiftLens(jnp.array([0.1, -0.05, 0.5]), jnp.array(5.0 / 40))
    variables = make_variables(layers, lens, FREE, None, LIKE)
    back = variables.settings(variables.start(layers), layers)
    # Observed: 1e-16, but for the opening, whose room is found again.
    np.testing.assert_allclose(back, settings_of(lens, jnp.array(1.0)), rtol=1e-9)


def test_any_variables_give_a_lens_that_the_layers_serve():
    """Layers of one ordinary lens: far from its focus only smaller openings are served."""
    layers = varied_layers()
    variables = make_variables(layers, layers.lens, FREE, None, LIKE)
    closed = 0
    for number in range(40):
        any_ = jnp.asarray(np.random.default_rng(number).normal(size=5) * 3)
        settings = variables.settings(any_, layers)
        check_reach(layers, variables.lens_at(settings))
        share = 0.5 * (1 + float(jnp.sin(any_[1])))
        closed += float(settings[1]) < 0.8 * share * float(layers.lens.aperture_radius)
    # Most are focused far from where these layers were peeled for.
    assert closed > 5


def test_layers_of_the_widest_lens_serve_every_lens_in_its_range():
    camera = front_camera()
    f_number = float(camera.focal_length) / (2 * 6.0 / 40)
    widest = widest_lens(camera, min_focus_distance=1.0, f_number=f_number, max_tilt=0.03)
    layers = peel(varied_scene(), camera, widest, supersampling=2)
    radius = jnp.array(6.0 / 40)
    lean = np.sin(0.03) / float(camera.focal_length)
    for focus in (0.0, 0.4, 1.0):
        assert float(widest_opening(layers, ThinLens(jnp.array(focus), radius))) == 1.0
    # Everywhere in the frame the focus is between infinity and a metre.
    lens = TiltShiftLens(jnp.array([0.6 * lean, 0.6 * lean, 0.5]), radius)
    assert float(widest_opening(layers, lens)) == 1.0
    check_reach(layers, lens)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"min_focus_distance": 0.0}, "min_focus_distance is 0 m; expected a positive length"),
        ({"f_number": 0.0}, "f-number is 0.0; expected a positive number"),
        ({"max_tilt": 2.0}, "max_tilt is 2.0 rad; expected 0 up to less than pi/2"),
        ({"f_number": 0.01, "max_tilt": 0.5}, "comes within a tenth of the nearest focus"),
    ],
)
def test_a_widest_lens_out_of_range(options, message):
    with pytest.raises(ValueError, match=message):
        widest_lens(front_camera(), **{"min_focus_distance": 1.0, "f_number": 2.0, **options})
