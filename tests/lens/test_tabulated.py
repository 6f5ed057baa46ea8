"""Tables over the image height as aberrations: against Seidel's closed forms, and what keeps within them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sample_lenses import CAMERA, thin
from scipy.interpolate import PchipInterpolator

from focusjax.lens import AberratedLens, Disk, height_curve, seidel, tabulated_aberrations

PITCH = float(CAMERA.sensor_width) / CAMERA.width
CORNER = 0.5 * float(np.hypot(CAMERA.width, CAMERA.height)) * PITCH


def test_curves_follow_scipys_monotone_cubic_between_their_ends():
    """But for the slopes at the ends, which are the axis's 0 and the last line's."""
    heights, values = np.array([0.0, 3, 5, 8, 13, 21]) * 1e-3, np.array([0.0, 1, 2, 2.5, 2, -1])
    curve = height_curve(heights, values)
    at = np.linspace(3e-3, 13e-3, 101)
    found = jax.vmap(curve)(jnp.asarray(at))
    np.testing.assert_allclose(found, PchipInterpolator(heights, values)(at), atol=1e-12)
    assert float(jax.grad(curve)(jnp.array(0.0))) == 0.0
    # Beyond its end, along the last line.
    assert float(curve(jnp.array(0.029))) == pytest.approx(-1.0 - 3.0, abs=1e-12)


def test_seidels_five_are_tables_of_powers():
    """At the tables' heights, where nothing is between: ray for ray."""
    lens = thin(Disk())
    terms = {"w040": 0.7, "w131": -1.1, "w222": 0.6, "w220": -0.4, "w311": 0.9}
    third_order = seidel(lens, CAMERA, **terms)
    full = float(CAMERA.focal_px * lens.aperture_radius)
    heights = np.linspace(0.0, CORNER, 6)
    h = heights / CORNER
    # Barrel distortion of w311 |h|^2 h pixels, from where the light lands.
    looked_at = heights + terms["w311"] * h**3 * PITCH
    tables = {
        "distortion": np.append(0.0, heights[1:] / looked_at[1:] - 1.0),
        "sagittal": 2.0 * terms["w220"] * h**2 / full,
        "tangential": 2.0 * (terms["w220"] + terms["w222"]) * h**2 / full,
        "spherical": np.full(6, 4.0 * terms["w040"] / full),
        "coma": terms["w131"] * h * PITCH,
    }
    curves = {name: height_curve(heights, values, even=name != "coma") for name, values in tables.items()}
    (tabulated,) = tabulated_aberrations(curves, lens.aperture_radius)
    way = np.array([0.6, -0.8])
    for height in heights[1:]:
        film = jnp.asarray(np.asarray(CAMERA.principal_point) + height / PITCH * way)
        for pupil in ([0.0, 0.0], [0.5, -0.3], [-0.8, 0.6]):
            b = full * jnp.array(pupil)
            found, wanted = (
                one.offset(CAMERA, film, jnp.array(pupil), b) for one in (tabulated, third_order)
            )
            np.testing.assert_allclose(found, wanted, atol=1e-10)


def test_tables_of_different_heights_make_terms_that_add_up():
    coarse, fine = [0.0, CORNER], np.linspace(0.0, CORNER, 5)
    curves = {
        "distortion": height_curve(coarse, [0.0, -0.03]),
        "sagittal": height_curve(fine, 0.02 * fine / CORNER),
        "tangential": height_curve(fine, -0.05 * fine / CORNER),
        "coma": None,
    }
    terms = tabulated_aberrations(curves, 0.04)
    assert [sorted(term.values) for term in terms] == [["distortion"], ["sagittal", "tangential"]]
    ray = AberratedLens(thin(Disk()), terms).ray(CAMERA, jnp.array([40.0, 15.0]), jnp.array([0.0, 0.0]))
    # Barrel: what lands 20 px from the middle was meant for farther out.
    straight = np.asarray(ray.a) - np.asarray(CAMERA.principal_point)
    share = float(curves["distortion"](jnp.array(20 * PITCH)))
    np.testing.assert_allclose(straight, [20.0 / (1.0 + share), 0.0], atol=1e-12)
    assert straight[0] > 20.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: height_curve([0.0, 1.0], [1.0]), "2 heights and 1 values; expected two or more"),
        (lambda: height_curve([0.1, 1.0], [1.0, 2.0]), "expected rising ones from 0 on"),
        (lambda: height_curve([0.0, 1.0], [1.0, np.nan]), "expected numbers within 1e\\+09"),
        (lambda: height_curve([0.0, 1.0], [1.0, 2.0], even=False), "starts with 1 on the axis"),
        (
            lambda: tabulated_aberrations({"coma": height_curve([0.0, 1.0], [0.0, 1.0])}, 1.0),
            "the curve of coma has even = True; expected an odd one",
        ),
        (lambda: tabulated_aberrations({"barrel": None}, 1.0), "there is no aberration 'barrel'"),
    ],
)
def test_what_is_no_table_is_refused(make, message: str):
    with pytest.raises(ValueError, match=message):
        make()
