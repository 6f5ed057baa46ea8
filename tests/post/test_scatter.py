"""Small lights out of focus in post-processing: their light is sent where the lens sends it, and kept."""

import jax.numpy as jnp
import numpy as np
from small_scenes import front_camera

from focusjax.lens import ThinLens, polygon
from focusjax.post import PinholeView, post_process


def test_a_lamp_becomes_the_picture_of_the_opening_and_keeps_its_light():
    camera = front_camera(48, 32)
    image = np.full((32, 48, 3), 0.2)
    image[15:17, 23:25] = 100.0
    view = PinholeView(jnp.asarray(image), jnp.full((32, 48), 0.5))
    lens = ThinLens(jnp.array(1.0), jnp.array(0.4), polygon(4))
    found = np.asarray(post_process(view, camera, lens, taps=16))
    assert abs(found.sum() / image.sum() - 1) < 1e-3
    radius = abs(float(lens.blur(camera, camera.principal_point, jnp.array(0.5)))) / 2
    y, x = np.indices((32, 48)) + 0.5
    # A square opening with its corners on the axes: |x| + |y| up to the radius.
    off = np.abs(x - 24) + np.abs(y - 16)
    inside = found[off < radius - 2.5, 0]
    expected = 0.2 + 4 * 99.8 / (2 * radius**2)
    np.testing.assert_allclose(inside.mean(), expected, rtol=0.05)
    # Observed: 0.0094, of the blocks in which gathering reads what is left of the lamp, white.
    np.testing.assert_allclose(found[off > radius + 2.5, 0], 0.2, atol=0.02)
