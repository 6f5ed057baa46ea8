"""Backgrounds at infinity: elevation, orientation, filtering, and finite gradients."""

from functools import partial

import equinox as eqx
import imageio.v3 as iio
import jax
import jax.numpy as jnp
import numpy as np
import OpenEXR
import pytest

from focusjax.scene import constant_background, gradient_background, image_background


def look(background, *direction):
    return eqx.filter_jit(background.radiance)(jnp.asarray(direction, dtype=float))


def test_constant():
    np.testing.assert_allclose(look(constant_background((1, 2, 3)), 0, 0, -5), [1, 2, 3])


def test_gradient_is_linear_in_elevation():
    sky = gradient_background(bottom=0.0, horizon=1.0, top=(3, 5, 7))
    np.testing.assert_allclose(look(sky, 3, 0, -4), 1.0, atol=1e-12)
    np.testing.assert_allclose(look(sky, 0, 2, 0), [3, 5, 7], atol=1e-12)
    np.testing.assert_allclose(look(sky, 0, -1, 0), 0.0, atol=1e-12)
    np.testing.assert_allclose(look(sky, 0, 1, -1), [2, 3, 4], atol=1e-12)
    np.testing.assert_allclose(look(sky, 0, -np.tan(np.pi / 6), -1), 2 / 3, atol=1e-12)


@pytest.fixture
def panorama(tmp_path):
    """Eight columns by four rows: red counts columns, green counts rows; linear."""
    pixels = np.zeros((4, 8, 3), dtype=np.float32)
    pixels[..., 0] = np.arange(8)
    pixels[..., 1] = np.arange(4)[:, None]
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": pixels}) as file:
        file.write(str(tmp_path / "sky.exr"))
    return tmp_path / "sky.exr"


def test_panorama_faces_minus_z_with_x_to_the_right(panorama):
    sky = image_background(panorama, gain=2.0)
    # The middle of the picture lies between columns 3 and 4 and rows 1 and 2.
    np.testing.assert_allclose(look(sky, 0, 0, -1), [7, 3, 0], atol=1e-5)
    # To the right (+x) is a quarter of the width on; up is towards row 0.
    np.testing.assert_allclose(look(sky, 1, 0, 0), [11, 3, 0], atol=1e-5)
    assert look(sky, 0, 1, -1)[1] < look(sky, 0, -1, -1)[1]
    # Behind, the last column meets the first.
    np.testing.assert_allclose(look(sky, 0, 0, 1)[0], 7, atol=1e-5)
    turned = image_background(panorama, turn=90.0)
    np.testing.assert_allclose(look(turned, 1, 0, 0), [3.5, 1.5, 0], atol=1e-5)


def test_display_pictures_are_decoded(tmp_path):
    iio.imwrite(tmp_path / "grey.png", np.full((2, 4, 3), 128, dtype=np.uint8))
    np.testing.assert_allclose(look(image_background(tmp_path / "grey.png"), 1, 2, 3), 0.2158605, atol=1e-6)


def test_gradients_are_finite_everywhere(panorama):
    for background in (image_background(panorama), gradient_background(0.0, 1.0, 2.0)):
        slopes = jax.jit(jax.jacobian(partial(type(background).radiance, background)))
        for direction in ((0, 1, 0), (0, -1, 0), (0, 0, -1), (0, 0, 0), (1, 0, 0)):
            assert bool(jnp.all(jnp.isfinite(slopes(jnp.asarray(direction, dtype=float)))))


def test_bad_pictures_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"image file .*none\.png does not exist; check the path"):
        image_background(tmp_path / "none.png")
    (tmp_path / "bad.png").write_text("not a picture")
    with pytest.raises(ValueError, match=r"image file .*bad\.png cannot be read"):
        image_background(tmp_path / "bad.png")
    with pytest.raises(ValueError, match=r"gain of the background image is -1"):
        image_background(tmp_path / "bad.png", gain=-1.0)
    with pytest.raises(ValueError, match=r"horizon colour of the background is \(1, 2\)"):
        gradient_background(0.0, (1, 2), 0.0)
