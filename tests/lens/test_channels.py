"""Light of several colours: each channel has its own lens, and counts where it should."""

import jax.numpy as jnp
import numpy as np
import pytest
from sample_lenses import CAMERA, CHROMATIC, aberrated, thin

from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    Disk,
    FocusOffset,
    chromatic_lens,
    in_colour,
    pixels_per_wave,
    seidel,
    vignetted_lens,
)

FILM, PUPIL = jnp.array([31.0, 8.0]), jnp.array([0.3, -0.6])


def a_of(lens: AbstractLens) -> jnp.ndarray:
    """Where a ray goes, thrice."""
    return jnp.broadcast_to(lens.ray(CAMERA, FILM, PUPIL).a[:1], 3)


def test_an_achromatic_lens_is_looked_through_once():
    calls = []
    in_colour(lambda lens: calls.append(lens) or a_of(lens), aberrated(thin(Disk())))
    assert len(calls) == 1


def test_red_green_and_blue_are_those_of_their_channels():
    seen = np.asarray(in_colour(a_of, CHROMATIC))
    alone = [float(a_of(channel.lens)[0]) for channel in CHROMATIC.channels()]
    np.testing.assert_array_equal(seen, alone)
    # a = p - b (w_f + offset) + (1 / size - 1) (p - c).
    b, p, c = CHROMATIC.ray(CAMERA, FILM, PUPIL).b[0], FILM[0], CAMERA.principal_point[0]
    focus, size = np.array([0.45, 0.51, 0.55]), np.array([1.01, 1.005, 0.98])
    np.testing.assert_allclose(seen, p - b * focus + (1 / size - 1) * (p - c), rtol=1e-12)


def test_pairs_of_lenses_are_looked_through_together():
    other = chromatic_lens(thin(Disk()), focus_offset=(0.2, 0.3, 0.4))
    seen = np.asarray(in_colour(lambda one, two: a_of(one) - a_of(two), CHROMATIC, other))
    np.testing.assert_allclose(seen, np.asarray(in_colour(a_of, CHROMATIC) - in_colour(a_of, other)))


def test_wrappers_keep_the_colours_of_what_they_wrap():
    for wrap in (
        lambda lens: vignetted_lens(lens, CAMERA, corner_shift=0.5),
        lambda lens: AberratedLens(lens, (FocusOffset(jnp.array(0.1)),)),
    ):
        outside = np.asarray(in_colour(a_of, wrap(CHROMATIC)))
        inside = [float(a_of(wrap(channel.lens))[0]) for channel in CHROMATIC.channels()]
        np.testing.assert_array_equal(outside, inside)


def test_more_bands_lie_between_and_share_colours():
    lens = chromatic_lens(thin(Disk()), focus_offset=(-0.1, 0.0, 0.3), bands=5)
    colours = np.array([channel.colour for channel in lens.channels()])
    np.testing.assert_allclose(colours.sum(axis=0), 1.0, rtol=1e-12)
    np.testing.assert_allclose(colours[1] / colours[0, 0], [0.5, 0.5 * 0.75, 0.0], rtol=1e-12)
    offsets = [float(terms[0].dioptres) for terms in lens.aberrations]
    np.testing.assert_allclose(offsets, [-0.1, -0.05, 0.0, 0.15, 0.3], atol=1e-12)


def test_a_wave_in_pixels():
    """At f/2, one wave of 500 nm is 2 um on the sensor."""
    pitch = float(CAMERA.focal_length / CAMERA.focal_px)
    assert float(pixels_per_wave(CAMERA, 2.0, 500e-9)) * pitch == pytest.approx(2e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: chromatic_lens(CHROMATIC), "given a lens that is chromatic itself"),
        (lambda: chromatic_lens(thin(Disk()), bands=4), "there are 4 bands; expected 3, 5, 7"),
        (lambda: chromatic_lens(thin(Disk()), focus_offset=(0, 1)), "expected finite numbers for red, green"),
        (lambda: chromatic_lens(thin(Disk()), magnification=(1, 0, 1)), "expected positive numbers near 1"),
        (lambda: AberratedLens(thin(Disk()), ()), "has no aberrations; give one"),
        (lambda: seidel(thin(Disk(), radius=0.0), CAMERA, w040=1), "a closed lens has no Seidel"),
        (lambda: seidel(thin(Disk()), CAMERA, w131=float("inf")), "w131 is inf; expected a finite number"),
        (lambda: vignetted_lens(thin(Disk()), CAMERA, corner_shift=0.5, disk=0), "radius is 0; expected"),
        (lambda: vignetted_lens(thin(Disk()), CAMERA, corner_shift=float("nan")), "corner shift is nan"),
    ],
)
def test_what_cannot_be_is_refused(make, message: str):
    with pytest.raises(ValueError, match=message):
        make()
