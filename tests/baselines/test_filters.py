"""Gather, scatter and multilayer: what they keep, how near they come to the truth, what they refuse."""

import functools
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, varied_scene, wide_lens

from focusjax.baselines import RayScene, lens_picture, multilayer, pinhole_view, scatter
from focusjax.lens import ThinLens
from focusjax.metrics import psnr
from focusjax.post import gather

CAMERA = front_camera(64, 48)
LENS = wide_lens(CAMERA, pixels_per_dioptre=12.0, focus=0.5)
"""Blur radii: 6 pixels at infinity and 6 for the bar in front."""
FILTERS = {
    "gather": gather,
    "scatter": scatter,
    "scatter normalised": functools.partial(scatter, normalised=True),
    "multilayer": multilayer,
}
every_filter = pytest.mark.parametrize("name", FILTERS)


@cache
def ready() -> RayScene:
    return RayScene(varied_scene())


@cache
def view() -> tuple[np.ndarray, np.ndarray]:
    return pinhole_view(ready(), CAMERA)


@cache
def truth() -> np.ndarray:
    return lens_picture(ready(), CAMERA, LENS, rays=128)


def steps(height: int = 48, width: int = 64) -> np.ndarray:
    """Disparities of three upright strips, and of a square in front of them."""
    out = np.repeat(np.array([0.0, 0.5, 0.9, 0.5]), width // 4)[None].repeat(height, axis=0)
    out[10:30, 20:40] = 1.2
    return out


@pytest.mark.parametrize(
    ("name", "observed"),
    [("gather", 28.4), ("scatter", 19.7), ("scatter normalised", 26.1), ("multilayer", 31.1)],
)
def test_against_the_ray_cast(name, observed):
    """The numbers are those observed; the sharp view itself has 19.8 dB.

    The plain sum of scatter adds a bright sky to what hides it, which undoes what it gains elsewhere.
    """
    picture = np.asarray(FILTERS[name](*view(), CAMERA, LENS))
    assert psnr(picture, truth()) == pytest.approx(observed, abs=0.5)


@every_filter
def test_uniform_stays_uniform_at_one_depth(name):
    image, disparity = np.full((48, 64, 3), 0.7), np.full((48, 64), 0.2)
    picture = np.asarray(FILTERS[name](image, disparity, CAMERA, LENS))
    np.testing.assert_allclose(picture, 0.7, rtol=1e-12)


@pytest.mark.parametrize("name", ["gather", "scatter normalised", "multilayer"])
def test_uniform_stays_uniform_over_all_depths(name):
    picture = np.asarray(FILTERS[name](np.full((48, 64, 3), 0.7), steps(), CAMERA, LENS))
    np.testing.assert_allclose(picture, 0.7, rtol=1e-12)


def test_scatter_keeps_the_light_of_highlights():
    """Points a thousand times as bright as white, each at another depth, far from the border."""
    image, disparity = np.zeros((48, 64, 3)), np.full((48, 64), 0.5)
    for number, column in enumerate((12, 25, 38, 50)):
        image[24, column], disparity[24, column] = 1000.0, (0.0, 0.3, 0.55, 1.1)[number]
    picture = scatter(image, disparity, CAMERA, LENS)
    # Every weight is a share of one; observed: 1e-14.
    np.testing.assert_allclose(picture.sum(axis=(0, 1)), image.sum(axis=(0, 1)), rtol=1e-10)
    disk = picture[24, 12, 0]
    assert disk == pytest.approx(1000.0 / (np.pi * 6.0**2), rel=0.02)  # observed 0.4 %
    assert picture.min() > -1e-9


def test_scatter_draws_at_every_radius_between_its_steps():
    """The second moment of a point's light is that of its disk, whatever the step."""
    y, x = np.mgrid[:48, :64]
    for disparity in (0.02, 0.11, 0.23):
        image, depth = np.zeros((48, 64, 3)), np.full((48, 64), disparity)
        image[24, 32] = 1.0
        radius = 12.0 * (0.5 - disparity)
        light = scatter(image, depth, CAMERA, LENS, radius_step=0.25)[..., 0]
        moment = (light * ((x - 32) ** 2 + (y - 24) ** 2)).sum()
        # A disk's mean square distance is r^2 / 2, a pixel's area adds 1/6. Observed: 0.6 %.
        assert moment == pytest.approx(radius**2 / 2 + 1 / 6, rel=0.02)


@every_filter
def test_a_pinhole_changes_nothing(name):
    closed = ThinLens(jnp.array(0.5), jnp.array(0.0))
    picture = np.asarray(FILTERS[name](*view(), CAMERA, closed))
    np.testing.assert_allclose(picture, view()[0], atol=1e-12)


def test_gather_takes_the_shape_of_the_opening():
    class HalfLens(ThinLens):
        """Only the right half of the opening lets light through."""

        def pupil_point(self, sample):
            point = super().pupil_point(sample)
            return jnp.stack([jnp.abs(point[0]), point[1]])

    lens = HalfLens(LENS.focus_disparity, LENS.aperture_radius)
    image = np.zeros((48, 64, 3))
    image[24, 32] = 1.0
    picture = np.asarray(gather(image, np.zeros((48, 64)), CAMERA, lens, taps=256))[..., 0]
    # Rays b = 12 v pass at disparity 0, in front of nothing, where a = p - b w_f: to the left of p.
    assert picture[:, :32].sum() == 0.0
    assert picture[:, 33:].sum() > 0.5


@pytest.mark.parametrize("taps", [8, 256])
def test_gather_keeps_what_is_sharp_from_leaking_into_the_blur(taps):
    """A sharp white strip before a black wall out of focus, also where taps stand for blocks of pixels."""
    image, disparity = np.zeros((48, 64, 3)), np.zeros((48, 64))
    image[:, 30:34], disparity[:, 30:34] = 1.0, 0.5
    picture = np.asarray(gather(image, disparity, CAMERA, LENS, taps=taps))[..., 0]
    np.testing.assert_allclose(picture[:, 31:33], 1.0, atol=1e-12)
    # One pixel is the filter's own; without care a third of the strip's light is there. Observed: 0.
    assert picture[:, :28].max() < 1e-12


def test_blocks_keep_few_taps_from_noise():
    """Lamps far out of focus, which taps of single pixels mostly miss."""
    image = np.zeros((48, 64, 3))
    image[4::8, 4::8] = 64.0
    limit = np.asarray(gather(image, np.zeros((48, 64)), CAMERA, LENS, taps=4096))
    few = np.asarray(gather(image, np.zeros((48, 64)), CAMERA, LENS, taps=16))
    # Observed: 0.74 with blocks of 2 x 2, 1.83 without.
    assert np.sqrt(np.mean((few - limit) ** 2)) < 0.8


def test_more_layers_come_nearer():
    errors = [psnr(multilayer(*view(), CAMERA, LENS, layers=n), truth()) for n in (2, 4, 16)]
    # Observed: 22.2, 27.3 and 31.1 dB.
    assert errors[0] < errors[1] < errors[2]


def test_multilayer_looks_past_what_is_in_front():
    """A blurred strip in front lets the sharp wall through at its edges, with the wall's own brightness."""
    image, disparity = np.full((48, 64, 3), 0.5), np.full((48, 64), 0.5)
    image[:, 28:36], disparity[:, 28:36] = 0.0, 1.0
    picture = multilayer(image, disparity, CAMERA, LENS, layers=8)[24, :, 0]
    # The strip's middle covers |x| < 4 of a disk of radius 6.
    x = (np.arange(6000) + 0.5) / 6000 * 4
    covered = 4 / (np.pi * 6**2) * np.sqrt(6**2 - x**2).mean() * 4
    assert picture[31] == pytest.approx(0.5 * (1 - covered), abs=0.01)  # observed 0.003
    assert picture[10] == pytest.approx(0.5)


@every_filter
@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda image, depth: (image[:-1], depth), r"the image is 64 x 47 pixels but .* is 64 x 48"),
        (lambda image, depth: (image, depth[:, 1:]), r"the disparity map is 63 x 48 pixels"),
        (lambda image, depth: (image * np.inf, depth), r"the image has 9216 values that are not finite"),
        (lambda image, depth: (image, depth * np.nan), r"the disparity map has 3072 values that are not"),
        (lambda image, depth: (image, depth - 1.0), r"the least disparity is -1 1/m; expected 0"),
    ],
    ids=["image size", "disparity size", "image values", "disparity values", "behind"],
)
def test_refuses_what_does_not_fit(name, change, sentence):
    image, disparity = change(np.ones((48, 64, 3)), np.zeros((48, 64)))
    with pytest.raises(ValueError, match=sentence):
        FILTERS[name](image, disparity, CAMERA, LENS)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (functools.partial(gather, taps=0), "taps is 0; expected a whole number, at least 1"),
        (functools.partial(scatter, radius_step=0.0), r"radius_step is 0\.0 pixels; expected a positive"),
        (functools.partial(multilayer, layers=1), "layers is 1; expected at least 2"),
    ],
)
def test_refuses_settings(call, sentence):
    with pytest.raises(ValueError, match=sentence):
        call(np.ones((48, 64, 3)), np.zeros((48, 64)), CAMERA, LENS)


def test_the_view_knows_depth_and_averages_colour():
    image, disparity = view()
    assert image.shape == (48, 64, 3)
    # The wall, far from its edges, and the sky, which has none.
    assert disparity[4, 60] == pytest.approx(0.12, rel=1e-9)
    np.testing.assert_allclose(image[4, 60], (0.2, 0.2, 0.6), rtol=1e-12)
    assert disparity[4, 23] == 0.0
    # The bar ends at 21.2 pixels: the first of three rays across the pixel meets it, the middle one does not.
    np.testing.assert_allclose(image[4, 21], (np.array([0.9, 0.4, 0.1]) + 2.0) / 3.0, rtol=1e-12)
    assert disparity[4, 21] == 0.0
    with pytest.raises(ValueError, match="edge is 2; expected an odd number"):
        pinhole_view(ready(), CAMERA, edge=2)
