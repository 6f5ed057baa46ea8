"""Real lenses for several wavelengths: their focus, their bounds, and bands between three of them."""

import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import biconvex

from focusjax.geometry import look_at
from focusjax.lens import PrescriptionLens, SpectralLens, prescription_lens, spectral_lens
from focusjax.optics import first_order

CAMERA = look_at((1.0, 0.5, 2.0), (0.0, 0.0, 0.0), width=60, height=40, focal_length=0.05)
FILM = (59.8, 39.7)
DISPARITIES = [0.0, 0.3, 0.5, 1.7]


@pytest.fixture(scope="module")
def single() -> PrescriptionLens:
    return prescription_lens(biconvex(), CAMERA, focus_distance=2.0, f_number=4)


@pytest.fixture(scope="module")
def coloured(single: PrescriptionLens) -> SpectralLens:
    return spectral_lens(single)


def test_a_simple_lens_focuses_blue_nearer_to_itself(coloured: SpectralLens):
    """The focal length for blue is the shorter, so that the film is in focus for nearer things."""
    axis = CAMERA.principal_point
    red, green, blue = (float(channel.lens.bounds.focus[0]) for channel in coloured.channels())
    assert red < green < blue
    # Which is what the glass says: the power changes by (n_blue - n_red) / (n_d - 1).
    prescription = coloured.lens.prescription
    power = 1e3 / float(first_order(prescription).focal_length)
    n_red, n_d, n_blue = (float(prescription.indices(jnp.asarray(w))[1]) for w in (650.0, 587.56, 475.0))
    # Observed: within 1 %, as the lens is thick and near the thing.
    assert blue - red == pytest.approx(power * (n_blue - n_red) / (n_d - 1.0), rel=0.05)
    assert float(coloured.blur(CAMERA, axis, jnp.asarray(0.5))) == pytest.approx(
        float(coloured.lens.blur(CAMERA, axis, jnp.asarray(0.5)))
    )


def test_bounds_hold_the_rays_of_all_colours(coloured: SpectralLens):
    film = jnp.asarray(FILM)
    for disparity in DISPARITIES:
        centre, radius = coloured.footprint(CAMERA, film, jnp.asarray(disparity))
        for channel in coloured.channels():
            theirs, size = channel.lens.footprint(CAMERA, film, jnp.asarray(disparity))
            assert float(jnp.linalg.norm(theirs - centre)) + float(size) <= float(radius) * (1 + 1e-9)
            assert float(channel.lens.reach(CAMERA, jnp.asarray(disparity))) <= float(
                coloured.reach(CAMERA, jnp.asarray(disparity))
            )


@pytest.mark.parametrize(
    ("wavelengths", "message"),
    [
        ((650, 510), "expected three, of red, green and blue"),
        ((650, 510, 0), "the wavelength is 0 nm; expected 300 to 2500"),
        ((650, 510, float("nan")), "the wavelength is nan nm; expected 300 to 2500"),
    ],
)
def test_wavelengths_are_three_of_light_that_glass_refracts(single: PrescriptionLens, wavelengths, message):
    with pytest.raises(ValueError, match=message):
        spectral_lens(single, wavelengths)


def test_more_bands_are_of_wavelengths_between(single: PrescriptionLens, coloured: SpectralLens):
    smooth = spectral_lens(single, bands=5).channels()
    focus = [float(channel.lens.bounds.focus[0]) for channel in smooth]
    np.testing.assert_allclose(focus[::2], [float(c.lens.bounds.focus[0]) for c in coloured.channels()])
    assert (np.diff(focus) > 0).all()
    np.testing.assert_allclose(np.sum([channel.colour for channel in smooth], axis=0), 1.0)
    assert smooth[1].colour[0] > 0 < smooth[1].colour[1]
    with pytest.raises(ValueError, match="there are 4 bands; expected 3, 5, 7"):
        spectral_lens(single, bands=4)
