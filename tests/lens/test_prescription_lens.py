"""Real lenses as sources of rays: framing, bounds, light, derivatives, pictures."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import biconvex
from scipy.stats import qmc
from small_scenes import SQUARE, ball

from focusjax.geometry import look_at
from focusjax.layers import peel
from focusjax.lens import (
    Disk,
    PrescriptionLens,
    ThinLens,
    at_wavelength,
    focused_lens,
    prescription_lens,
)
from focusjax.metrics import psnr
from focusjax.optics import (
    RGB_WAVELENGTHS,
    air,
    film_distance,
    find_glass,
    first_order,
    index_glass,
    lens_preset,
    make_prescription,
    opened_to,
    singlet,
    sphere,
    with_focal_length,
)
from focusjax.scene import constant_background, make_object, make_scene
from focusjax.trace import render
from focusjax.trace._emitter_aim import aim_at

CAMERA = look_at((1.0, 0.5, 2.0), (0.0, 0.0, 0.0), width=60, height=40, focal_length=0.05)
FILM = [(30.0, 20.0), (46.3, 13.8), (59.8, 39.7), (0.4, 22.0)]
DISPARITIES = [0.0, 0.3, 0.5, 1.7]
SQUARE_POINTS = qmc.Sobol(2, rng=np.random.default_rng(2)).random_base2(12)


@pytest.fixture(scope="module")
def gauss() -> PrescriptionLens:
    """Wide open, with vignetting that leaves a fifth of the light to the corners."""
    return prescription_lens(lens_preset("gauss_jp62087922_f1.8_1987"), CAMERA, focus_distance=2.0)


@pytest.fixture(scope="module")
def single() -> PrescriptionLens:
    """A simple lens, with all its aberrations."""
    return prescription_lens(biconvex(), CAMERA, focus_distance=2.0, f_number=4)


@pytest.fixture(params=["gauss", "single"])
def lens(request) -> PrescriptionLens:
    return request.getfixturevalue(request.param)


@eqx.filter_jit
def rays_at(lens, film):
    return jax.vmap(lambda sample: lens.ray(CAMERA, film, lens.pupil_point(sample)))(
        jnp.asarray(SQUARE_POINTS)
    )


@eqx.filter_jit
def bounds_at(lens, film, disparity):
    return (
        lens.footprint(CAMERA, film, disparity),
        lens.reach(CAMERA, disparity),
        lens.parallax(CAMERA),
        lens.blur(CAMERA, film, disparity),
    )


def test_bounds_hold_all_rays_with_light(lens):
    farthest = dict.fromkeys(DISPARITIES, 0.0)
    widest = 0.0
    corners = np.random.default_rng(3).uniform((0, 0), (60, 40), (40, 2))
    for film in map(jnp.array, [*FILM, *corners]):
        rays = rays_at(lens, film)
        lit = np.asarray(rays.weight) > 0
        a, b = np.asarray(rays.a)[lit], np.asarray(rays.b)[lit]
        widest = max(widest, np.linalg.norm(b, axis=1).max())
        for w in DISPARITIES:
            (centre, radius), reach, parallax, _ = bounds_at(lens, film, jnp.array(w))
            away = np.linalg.norm(a + b * w - np.asarray(centre), axis=1).max()
            assert away <= float(radius)
            if w == 1.7:
                # Observed: 0.69 to 0.93; least for the simple lens, whose spot in focus is wide.
                assert away >= 0.5 * float(radius)
            strays = np.abs(a + b * w - np.asarray(film)).max()
            assert strays <= float(reach)
            farthest[w] = max(farthest[w], strays / float(reach))
        assert widest <= float(parallax)
    assert widest > 0.85 * float(parallax)
    assert min(farthest.values()) > 0.5


def test_the_axis_is_the_pinholes_and_has_all_the_light(lens):
    centre = jnp.asarray(CAMERA.principal_point)
    ray = eqx.filter_jit(lambda: lens.ray(CAMERA, centre, jnp.zeros(2)))()
    np.testing.assert_allclose(ray.a, centre, atol=1e-12)
    np.testing.assert_allclose(ray.b, 0.0, atol=1e-12)
    # Observed: 1.0001.
    assert float(rays_at(lens, centre).weight.mean()) == pytest.approx(1.0, abs=2e-3)


def test_light_falls_off_as_the_fourth_power_of_the_cosine_and_by_vignetting(single, gauss):
    corner = jnp.array([59.8, 39.7])
    cosine = np.cos(np.arctan(np.linalg.norm(np.array(corner) - (30, 20)) / float(CAMERA.focal_px)))
    # The stop is the lens itself: nothing else cuts rays off. Observed: 4.4 % more, as the film is farther.
    light = float(rays_at(single, corner).weight.mean())
    assert light == pytest.approx(cosine**4, rel=0.06)
    even = dataclasses.replace(single, falloff=False)
    assert float(rays_at(even, corner).weight.mean()) == pytest.approx(1.0, rel=0.06)
    # Observed: 0.23.
    assert 0.1 < float(rays_at(gauss, corner).weight.mean()) < 0.3


def test_vignetted_highlights_are_cats_eyes(gauss):
    """Narrower along the radius than across it, more so the farther out."""
    ratios = []
    for film in ((30.0, 20.0), (45.0, 20.0), (59.0, 20.0)):
        rays = rays_at(gauss, jnp.array(film))
        b = np.asarray(rays.b)[np.asarray(rays.weight) > 0]
        ratios.append(np.ptp(b[:, 0]) / np.ptp(b[:, 1]))
    # Observed: 1.00, 0.85, 0.60.
    assert ratios[0] == pytest.approx(1.0, abs=0.02)
    assert ratios[0] - 0.05 > ratios[1] > ratios[2] + 0.05


def test_stopped_down_it_is_the_thin_lens():
    """In the middle of the picture, where third-order terms are small: the same a and b."""
    lens = prescription_lens(biconvex(), CAMERA, focus_distance=1.5, f_number=32, focus="paraxial")
    pupil = first_order(lens.prescription).entrance_pupil_radius * 1e-3
    thin = ThinLens(jnp.asarray(1 / 1.5), pupil)
    for film in (jnp.array([31.0, 19.0]), jnp.array([28.0, 21.5])):
        rays = rays_at(lens, film)
        lit = np.asarray(rays.weight) > 0
        a, b = np.asarray(rays.a)[lit], np.asarray(rays.b)[lit]
        met = a + b / 1.5
        # Observed: 1.4e-3 and 2.8e-3 pixels, of third-order terms.
        np.testing.assert_allclose(met, np.broadcast_to(film, met.shape), atol=4e-3)
        # The soft rim lets in 1 % more; no sample is quite on it.
        assert 0.97 < np.linalg.norm(b, axis=1).max() / float(thin.parallax(CAMERA)) < 1.0101
        blur, wanted = (bounds_at(one, film, jnp.array(2.0))[3] for one in (lens, thin))
        # Observed: 1.4 %.
        assert float(blur) == pytest.approx(float(wanted), rel=0.02)


def test_a_traced_focus_has_the_smaller_spot(gauss):
    near, _ = film_distance(gauss.prescription, gauss.indices, jnp.asarray(0.5e-3))
    paraxial = dataclasses.replace(gauss, film_place=near)

    def spot(lens):
        rays = rays_at(lens, CAMERA.principal_point)
        landed = np.asarray(rays.a + rays.b * 0.5)[np.asarray(rays.weight) > 0]
        return landed.std(axis=0).max()

    # Observed: 0.43.
    assert spot(gauss) < 0.8 * spot(paraxial)


def test_breathing_lets_the_picture_grow():
    film = jnp.array([34.0, 20.0])
    still, grown = (
        prescription_lens(biconvex(), CAMERA, focus_distance=0.5, f_number=16, breathing=breathing)
        for breathing in (False, True)
    )

    def looks(lens):
        rays = rays_at(lens, film)
        return float((rays.a + rays.b * 2.0)[np.asarray(rays.weight) > 0].mean(axis=0)[0])

    # What a place of the fixed film sees is nearer to the axis: by about the magnification, 0.05 / 0.45.
    assert looks(still) == pytest.approx(34.0, abs=0.02)
    assert looks(grown) - 30.0 == pytest.approx(4.0 * 50.0 / float(still.film_scale), rel=1e-3)
    assert 1.05 < float(still.film_scale) / 50.0 < 1.15


def test_colours_focus_elsewhere(single):
    """N-BK7 bends blue more: its focus is nearer to the lens, so that on the film a nearer thing is sharp."""
    sharp = []
    for wavelength in RGB_WAVELENGTHS:
        lens = at_wavelength(single, wavelength)
        zero, one = (float(bounds_at(lens, jnp.array([30.0, 20.0]), jnp.array(w))[3]) for w in (0.0, 1.0))
        sharp.append(zero / (zero - one))
    assert sharp[0] < sharp[1] < sharp[2]
    n = [float(find_glass("N-BK7").index(jnp.asarray(w))) for w in RGB_WAVELENGTHS]
    shift = (n[2] - n[0]) / (n[1] - 1) / 0.05
    # A thin lens's power changes by that.
    assert sharp[2] - sharp[0] == pytest.approx(shift, rel=0.05)


def test_derivatives_are_those_of_differences():
    """By focus, the prescription's curvatures and thickness, and through the lens's own making."""
    lens = opened_to(with_focal_length(biconvex(), 50.0), 4.0)
    film, sample = jnp.array([47.0, 12.0]), jnp.array([0.8, 0.35])

    def mix(given):
        bend, thicker, focus = given
        bent = eqx.tree_at(
            lambda lens: (lens.surfaces[0].curvature, lens.thicknesses),
            lens,
            (lens.surfaces[0].curvature * bend, lens.thicknesses * thicker),
        )
        made = dataclasses.replace(focused_lens(bent, CAMERA, focus), pupils=fixed)
        ray = made.ray(CAMERA, film, made.pupil_point(sample))
        return ray.a @ jnp.array([1.0, 0.5]) + ray.b @ jnp.array([0.7, -1.0])

    @jax.jit
    def slopes(given):
        along = jnp.array([0.5, -0.3, 0.2])
        ends = jax.vmap(mix)(given[None] + jnp.array([1e-5, -1e-5])[:, None] * along[None])
        return jax.jvp(mix, (given,), (along,))[1], (ends[0] - ends[1]) / 2e-5

    given = jnp.array([1.0, 1.0, 0.5])
    fixed = focused_lens(lens, CAMERA, given[2]).pupils
    slope, difference = slopes(given)
    # The differences' own error is near that.
    assert float(slope) == pytest.approx(float(difference), rel=1e-7)


def test_dark_corners_and_closed_pupils_have_finite_derivatives():
    """A deep hole: the corners see nothing at all."""
    glass = find_glass("N-BK7")
    blind = make_prescription(
        [sphere(0.0), sphere(1 / 52.0), sphere(-1 / 52.0)],
        [30.0, 5.0, 0.0],
        [2.0, 4.0, 4.0],
        [air(), glass, air()],
        stop=1,
    )
    lens = prescription_lens(blind, CAMERA, focus_distance=2.0)
    corner = jnp.array([59.9, 0.2])
    rays = rays_at(lens, corner)
    np.testing.assert_array_equal(rays.weight, 0.0)
    np.testing.assert_array_equal(rays.a, np.broadcast_to(corner, rays.a.shape))

    @eqx.filter_jit
    @eqx.filter_grad
    def slopes(lens, films):
        rays = jax.vmap(lambda film: lens.ray(CAMERA, film, jnp.array([0.3, 0.9])))(films)
        blurs = jax.vmap(lambda film: lens.blur(CAMERA, film, jnp.asarray(1.0)))(films)
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves((rays, blurs)))

    films = jnp.stack([corner, CAMERA.principal_point, jnp.array([45.0, 20.0])])
    for leaf in jax.tree.leaves(slopes(lens, films)):
        assert np.isfinite(leaf).all()


def test_the_tracer_renders_it_unchanged(single):
    """A white world is as bright as the light that falls on the film: darker towards the corners."""
    white = make_scene(
        [make_object("card", *card(), colour=(0, 0, 0), emission=1.0)],
        background=constant_background(1.0),
        unlit=True,
    )
    image = np.asarray(render(peel(white, CAMERA, single, supersampling=2), single, rays=64, even=True))[
        ..., 0
    ]
    light = [float(rays_at(single, jnp.array(film)).weight.mean()) for film in ((30.5, 20.5), (58.5, 38.5))]
    # The noise of 64 rays a pixel is below that.
    assert image[20, 30] == pytest.approx(light[0], rel=0.02)
    assert image[37:40, 57:60].mean() == pytest.approx(light[1], rel=0.02)


def card():
    """Across the view of the camera, in focus."""
    pose = np.asarray(CAMERA.world_from_camera)
    corners = np.array([(-0.4, -0.3, -2.0), (0.4, -0.3, -2.0), (0.4, 0.3, -2.0), (-0.4, 0.3, -2.0)])
    return corners @ pose[:3, :3].T + pose[:3, 3], SQUARE


@pytest.mark.slow
def test_stopped_far_down_it_renders_the_thin_lens_picture():
    """Of a small field, where the lens hardly distorts; its rays: test_stopped_down_it_is_the_thin_lens."""
    camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05, sensor_width=0.008)
    scene = make_scene(
        [ball("near", (0.03, 0.02, 0.5), 0.06, 1), ball("far", (-0.06, 0.0, -0.6), 0.15, 2)],
        background=constant_background(0.2),
        unlit=True,
    )
    lens = prescription_lens(biconvex(), camera, focus_distance=2.0, f_number=22, falloff=False)
    pupil = first_order(lens.prescription).entrance_pupil_radius * 1e-3
    thin = ThinLens(jnp.asarray(0.5), pupil)
    real, ideal = (
        np.asarray(render(peel(scene, camera, one, supersampling=2), one, rays=256, even=True))
        for one in (lens, thin)
    )
    # Observed: 55.6 dB.
    assert psnr(real, ideal) > 50


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"focus_distance": 0.04}, "focus distance 0.04 m is within the front focal point of biconvex"),
        ({"focus_distance": -1}, "focus distance is -1 m"),
        ({"focus_distance": 2, "f_number": 1.2}, "biconvex opens to f/2.73 at most"),
        ({"focus_distance": 2, "focus": "sharp"}, "focus is 'sharp'; expected"),
    ],
)
def test_bad_values_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        prescription_lens(biconvex(), CAMERA, **given)


def test_a_film_inside_the_lens_is_refused():
    """Of a ball of index 2.2 the focus is within it."""
    ball = singlet(10.0, -10.0, thickness=20.0, semi_diameter=9.9, glass=index_glass(2.2))
    with pytest.raises(ValueError, match=r"the film of singlet would be .* mm inside the lens"):
        prescription_lens(ball, CAMERA, focus_distance=2)


def test_a_fisheye_is_taken_as_far_as_perspective_goes():
    """A front of strong negative power, behind which a small lens looks backwards past 80 degrees."""
    front, rear = index_glass(1.8), index_glass(1.6)
    bird = make_prescription(
        [sphere(1 / 60.0), sphere(1 / 9.0), sphere(0.0), sphere(1 / 11.0), sphere(-1 / 11.0)],
        [1.5, 20.0, 0.5, 4.0, 0.0],
        [30.0, 8.95, 1.5, 5.0, 5.0],
        [front, air(), air(), rear, air()],
        stop=2,
        name="bird's eye",
    )

    def through(sensor_width: float) -> PrescriptionLens:
        camera = look_at(
            (0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.0052, sensor_width=sensor_width
        )
        return prescription_lens(bird, camera, focus_distance=1.0)

    with pytest.raises(ValueError, match=r"bird's eye looks farther than 80.5 degrees .* at 2[0-9] pixels"):
        through(0.0177)
    lens = through(0.009)
    # The corners, at 46 degrees of the pinhole, look 69 degrees off the axis.
    assert float(lens.bounds.beyond.max()) < 0.5
    assert np.degrees(np.arctan(float(lens.bounds.at_infinity[-4]))) > 65


def test_rays_are_aimed_at_places_in_the_scene(gauss: PrescriptionLens):
    """Aperture points are found again from the places that their rays pass."""
    disparity = jnp.asarray(1.7)
    points = jax.vmap(Disk().point)(jnp.asarray(SQUARE_POINTS[:256]))

    @eqx.filter_jit
    def aimed(lens, film):
        def one(point):
            ray = lens.ray(CAMERA, film, point)
            return aim_at(CAMERA, lens, film, ray.at(disparity), disparity), ray.weight

        return jax.vmap(one)(points)

    for film in FILM:
        found, weight = aimed(gauss, jnp.asarray(film))
        lit = np.asarray(weight) > 0
        # In pixels: but for some in corners whose first guess glass stops. Observed: 0.36 at most, 0.90 near.
        off = np.asarray(found.off)[lit]
        assert off.max() < 0.5
        near = off < 0.01
        assert near.mean() > 0.85
        away = np.abs(np.asarray(found.pupil) - np.asarray(points))[lit][near]
        assert away.max() < 0.01
