"""Lenses of height fields against the same lens with analytic surfaces, and ones that are not round."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import GLASS

from focusjax.geometry import look_at
from focusjax.lens import PoorFitError, fitted_lens, polygon, prescription_lens, refitted
from focusjax.optics import (
    find_glass,
    first_order,
    height_field,
    height_field_lens,
    lens_preset,
    put_ahead,
    singlet,
)

CAMERA = look_at((0, 0, 2), (0, 0, 0), width=120, height=90, focal_length=0.05)
RADIUS = 50.0


def picture(count=129, width=24.0, across=0.0):
    """Heights of a convex sphere; `across` is a cylinder's curvature in 1/mm on top of it."""
    y, x = np.meshgrid(*[np.linspace(-width / 2, width / 2, count)] * 2, indexing="ij")
    return np.sqrt(RADIUS**2 - x**2 - y**2) - RADIUS - across * x**2 / 2


def biconvex_of_heights(**keys):
    front, back = (height_field(picture(**keys), width=24.0, scale=1.0, towards=s) for s in ("scene", "film"))
    return height_field_lens(front, back, thickness=5.0, glass=GLASS, semi_diameter=9.0)


@pytest.fixture(scope="module")
def pair():
    analytic = singlet(RADIUS, -RADIUS, thickness=5.0, semi_diameter=9.0, glass=GLASS)
    return [
        prescription_lens(each, CAMERA, focus_distance=2.0, f_number=4)
        for each in (analytic, biconvex_of_heights())
    ]


def rays(lens, camera=CAMERA, count=2000, seed=3):
    """Of film points all over the frame, and where they meet the disparities 0 and 1."""
    square = jnp.asarray(np.random.default_rng(seed).random((count, 4)))

    def one(sample):
        film = sample[:2] * jnp.array([camera.width, camera.height])
        return film, lens.ray(camera, film, lens.pupil_point(sample[2:]))

    return jax.jit(jax.vmap(one))(square)


def test_first_order_data_are_the_spheres(pair):
    analytic, heights = (first_order(each.prescription) for each in pair)
    for name in ("focal_length", "back_focal_distance", "f_number"):
        assert float(getattr(heights, name)) == pytest.approx(float(getattr(analytic, name)), rel=1e-6), name


def test_rays_of_a_spherical_height_field_are_the_spheres(pair):
    """With the pupils of the analytic lens, from the same film points to the same targets."""
    analytic, heights = pair
    square = jnp.asarray(np.random.default_rng(5).random((1000, 4)))

    def both(sample):
        film = sample[:2] * jnp.array([CAMERA.width, CAMERA.height])
        aim = analytic.aim(CAMERA, film, analytic.pupil_point(sample[2:]))
        return [jnp.stack([*each.passing(aim)[0], *each.passing(aim)[1]]) for each in (analytic, heights)]

    wanted, found = jax.jit(jax.vmap(both))(square)
    off = np.abs(np.asarray(found - wanted))
    # Slopes in pixels, and mm in the entrance pupil.
    assert off[:, :2].max() * float(CAMERA.focal_px) < 0.01
    assert off[:, 2:].max() < 1e-3


def test_a_round_height_field_is_fitted_as_its_sphere_is(pair):
    analytic, heights = (fitted_lens(each, CAMERA, error_px=0.05) for each in pair)
    assert float(heights.error.largest()) == pytest.approx(float(analytic.error.largest()), abs=0.01)
    assert heights.transfer.is_round
    assert heights.transfer.degree == analytic.transfer.degree


@pytest.fixture(scope="module")
def toric():
    """Focal lengths that differ by 4 % along x and y."""
    return prescription_lens(biconvex_of_heights(across=0.0004), CAMERA, focus_distance=2.0, f_number=4)


def test_bounds_hold_the_rays_of_a_lens_that_is_not_round(toric):
    film, found = rays(toric)
    lit = np.asarray(found.weight) > 0
    for disparity in (0.0, 0.5, 1.2):
        centre, radius = jax.vmap(lambda p, w=disparity: toric.footprint(CAMERA, p, jnp.asarray(w)))(film)
        away = np.linalg.norm(np.asarray(found.a + found.b * disparity - centre), axis=1)[lit]
        share = away / np.asarray(radius)[lit]
        assert share.max() <= 1.0
        # And not by much more than is needed.
        assert share.max() > 0.6


def test_a_toric_lens_has_two_foci_which_are_those_of_its_curvatures(toric):
    """Along x the power is more by (n - 1) times the cylinder of both faces: the lensmaker's equation."""
    middle = CAMERA.principal_point
    scale = float(toric.prescription.thicknesses[0]) / 5.0

    def focus(direction):
        near = toric.ray(CAMERA, middle, 0.2 * jnp.asarray(direction))
        off = near.a - middle
        return -float(off @ near.b / (near.b @ near.b))

    n = float(GLASS.index(jnp.asarray(587.5618)))
    wanted = 1e3 * (n - 1.0) * 2 * 0.0004 / scale
    # To first order, as the lens is thick.
    assert focus([1.0, 0.0]) - focus([0.0, 1.0]) == pytest.approx(wanted, rel=0.05)


@pytest.mark.slow
def test_a_lens_that_is_not_round_is_fitted_within_what_it_says(toric):
    fitted = fitted_lens(toric, CAMERA, error_px=0.05, nearest=0.8)
    assert not fitted.transfer.is_round
    (_, wanted), (_, found) = rays(toric), rays(fitted)
    lit = (np.asarray(wanted.weight) > 0) & (np.asarray(found.weight) > 0)
    # Observed: 1.8 % are cut off, by both.
    assert (lit == (np.asarray(wanted.weight) > 0)).mean() > 0.999
    for end, disparity in enumerate((0.0, 1.25)):
        off = np.asarray(found.a - wanted.a + (found.b - wanted.b) * disparity)[lit]
        assert np.linalg.norm(off, axis=1).max() <= float(fitted.error.worst[end]) <= 0.05
    # Polynomials of a lens that is the same all around cannot have two foci: the lens's own are pixels apart.
    again = refitted(fitted, toric, CAMERA)
    film, pupil = jnp.array([20.0, 70.0]), jnp.array([0.4, 0.7])
    np.testing.assert_allclose(again.ray(CAMERA, film, pupil).a, fitted.ray(CAMERA, film, pupil).a, atol=1e-6)


@pytest.mark.slow
def test_what_height_fields_cannot_have():
    rough = picture() + 2e-4 * np.random.default_rng(1).normal(size=(129, 129))
    plate = height_field_lens(
        height_field(rough, width=24.0, scale=1.0, towards="scene"),
        thickness=5.0,
        glass=GLASS,
        semi_diameter=9.0,
    )
    lens = prescription_lens(plate, CAMERA, focus_distance=2.0, f_number=8)
    with pytest.raises(PoorFitError, match=r"height field are off by .* px, of 0.05 px allowed; allow more"):
        fitted_lens(lens, CAMERA)
    with pytest.raises(
        ValueError, match="has a height field, whose stop is round, and the aperture is a Polygon"
    ):
        prescription_lens(plate, CAMERA, focus_distance=2.0, f_number=8, aperture=polygon(6))


@pytest.mark.slow
def test_a_flat_plate_ahead_of_a_lens_is_a_plane_parallel_plate():
    """A picture of one grey against glass with two planes, through the whole triplet."""
    triplet, glass = lens_preset("cooke_triplet_50mm_f4"), find_glass("F2")
    flat = height_field(np.full((9, 9), 0.7), width=80.0, scale=3.0, towards="scene")
    plates = (
        height_field_lens(flat, thickness=4.0, glass=glass),
        singlet(np.inf, np.inf, thickness=4.0, semi_diameter=30.0, glass=glass, name="height field"),
    )
    lenses = [
        prescription_lens(put_ahead(plate, triplet, 3.0), CAMERA, focus_distance=1.0, f_number=8)
        for plate in plates
    ]
    assert lenses[0].prescription.stop == triplet.stop + 2
    square = jnp.asarray(np.random.default_rng(2).random((200, 4)))

    def both(sample):
        film = sample[:2] * jnp.array([CAMERA.width, CAMERA.height])
        aim = lenses[1].aim(CAMERA, film, lenses[1].pupil_point(sample[2:]))
        return [jnp.stack([*each.passing(aim)[0], *each.passing(aim)[1]]) for each in lenses]

    found, wanted = jax.jit(jax.vmap(both))(square)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_a_picture_stands_upright_and_the_top_bends_light_as_a_wedge():
    """Glass that is thicker at the top deflects by (n - 1) times its angle, and shows what is higher."""
    ramp = np.broadcast_to(np.linspace(1.0, 0.0, 65)[:, None], (65, 65))
    wedge = height_field_lens(
        height_field(ramp, width=64.0, scale=0.64, towards="scene"), thickness=4.0, glass=find_glass("1.5")
    )
    whole = put_ahead(wedge, lens_preset("cooke_triplet_50mm_f4"), 3.0)
    lens = prescription_lens(whole, CAMERA, focus_distance=1.0, f_number=16)
    ray = lens.ray(CAMERA, CAMERA.principal_point, jnp.zeros(2))
    up = -(float(ray.a[1]) - float(CAMERA.principal_point[1])) / float(CAMERA.focal_px)
    # Light bends to the thick edge, so that it comes from above. Observed: 0.0050002.
    assert up == pytest.approx(0.5 * 0.01, rel=0.001)
    assert float(ray.a[0]) == pytest.approx(float(CAMERA.principal_point[0]), abs=1e-3)


@pytest.mark.parametrize(
    ("values", "keys", "message"),
    [
        (np.zeros((9, 8)), {}, "has 9 x 8 heights; expected as many rows as columns, at least 4"),
        (np.zeros((3, 3)), {}, "has 3 x 3 heights"),
        (
            np.where(np.eye(9), np.nan, 0.0),
            {},
            "has 9 heights that are not finite, the first in row 0, column 0",
        ),
        (np.zeros((9, 9)), {"width": 0.0}, "has a width of 0 mm; expected a positive one"),
        (np.zeros((9, 9)), {"scale": np.inf}, "has a scale of inf mm; expected a finite one"),
        (np.zeros((9, 9)), {"towards": "sensor"}, "has towards 'sensor'; expected 'scene', of a front, or"),
    ],
)
def test_pictures_that_make_no_surface(values, keys, message):
    with pytest.raises(ValueError, match=message):
        height_field(values, **{"width": 20.0, "scale": 1.0, "towards": "scene", **keys})


def test_glass_that_is_air_is_refused():
    bowl = height_field(picture(), width=24.0, scale=1.0, towards="scene")
    with pytest.raises(ValueError, match="has glass of index 1; expected more than 1"):
        height_field_lens(bowl, thickness=2.0, glass=find_glass("1.0"))


def test_heights_that_cross_are_refused_wherever_they_do():
    """A valley along y, which reaches the back's plane 10 mm beside the axis, but not along x."""
    y, _ = np.meshgrid(*[np.linspace(-12, 12, 65)] * 2, indexing="ij")
    valley = height_field(-0.05 * y**2, width=24.0, scale=1.0, towards="scene")
    assert height_field_lens(valley, thickness=5.1, glass=GLASS, semi_diameter=10.0).stop == 0
    with pytest.raises(ValueError, match=r"surface 0 and surface 1 .* cross .* by 0.9\d* mm 10 mm"):
        height_field_lens(valley, thickness=4.1, glass=GLASS, semi_diameter=10.0)


def test_a_lens_wider_than_its_heights_is_refused():
    flat = height_field(np.zeros((9, 9)), width=16.0, scale=1.0, towards="scene")
    with pytest.raises(ValueError, match="has a clear radius of 7 mm, and heights to 6 mm from the axis"):
        height_field_lens(flat, thickness=2.0, glass=GLASS, semi_diameter=7.0)
