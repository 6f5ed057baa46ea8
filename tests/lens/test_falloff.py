"""Vignetting: natural, of two disks, of a hood, from tables, and as real glass has it."""

import dataclasses
import re
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.geometry import Camera, look_at
from focusjax.layers import Layers, peel
from focusjax.lens import (
    AbstractLens,
    DarkenedLens,
    PrescriptionLens,
    ThinLens,
    VignettedLens,
    cosine_falloff,
    depth_of_field_lens,
    hooded_lens,
    illumination,
    prescription_lens,
    table_falloff,
    thin_lens,
    vignetted_lens,
    vignetted_like,
)
from focusjax.lens._pupils import from_film, openness
from focusjax.optics import converging_length, lens_preset
from focusjax.scene import Scene, constant_background, make_object, make_scene
from focusjax.trace import render

CAMERA = look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=0.028)
CENTRES = np.stack(np.meshgrid(np.arange(36) + 0.5, np.arange(24) + 0.5), axis=-1)
TANGENTS = np.linalg.norm(CENTRES - (18, 12), axis=-1) / float(CAMERA.focal_px)


def thin(f_number: float = 2.0) -> ThinLens:
    return thin_lens(focus_distance=3.0, focal_length=0.028, f_number=f_number)


@cache
def bright_scene() -> Scene:
    """Of radiance 1 all over: a sky, and a wall that covers part of it."""
    square = np.array([(-1.0, -1.0, -3), (0.2, -1.0, -3), (0.2, 0.9, -3), (-1.0, 0.9, -3)])
    wall = make_object("wall", square, np.array([(0, 1, 2), (0, 2, 3)]), colour=(0, 0, 0), emission=1.0)
    return make_scene([wall], background=constant_background(1.0), unlit=True)


@cache
def bright() -> Layers:
    return peel(bright_scene(), CAMERA, thin(1.4), supersampling=1)


def measured(lens: DarkenedLens) -> np.ndarray:
    """Of the uniform scene, in grey; all by one program, as long as the lens is of the same kind."""
    return np.asarray(render(bright(), lens, rays=256, even=True))[..., 1]


def lit_all_over(lens: AbstractLens, side: int = 64) -> np.ndarray:
    """In the middle of each pixel."""
    light = illumination(lens, CAMERA, jnp.asarray(CENTRES.reshape(-1, 2)), side=side)
    return np.asarray(light).reshape(24, 36)


def squares(picture: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels."""
    return picture.reshape(12, 2, 18, 2).mean(axis=(1, 3))


def overlap(apart: np.ndarray, first: float, second: float) -> np.ndarray:
    """Area that two disks share, over that of the first (of radii, and so far apart)."""
    inside = np.maximum(apart, 1e-12)
    a = np.arccos(np.clip((inside**2 + first**2 - second**2) / (2 * inside * first), -1, 1))
    b = np.arccos(np.clip((inside**2 + second**2 - first**2) / (2 * inside * second), -1, 1))
    shared = first**2 * (a - np.sin(2 * a) / 2) + second**2 * (b - np.sin(2 * b) / 2)
    return shared / (np.pi * first**2)


def test_natural_vignetting_is_cos_to_the_fourth():
    light = lit_all_over(DarkenedLens(thin(), cosine_falloff()), side=2)
    np.testing.assert_allclose(light, np.cos(np.arctan(TANGENTS)) ** 4, rtol=1e-9)


def test_two_disks_darken_by_the_area_that_they_share():
    """In the rendered picture, and as the cosine does, too."""
    tube = vignetted_lens(thin(), CAMERA, corner_shift=1.0, disk=1.1)
    corner = np.hypot(18, 12) / float(CAMERA.focal_px)
    formula = overlap(TANGENTS / corner, 1.0, 1.1)
    # The grid of rays and the soft edge; observed 0.23 % off at most.
    np.testing.assert_allclose(lit_all_over(tube), formula, rtol=0.005)
    both = measured(DarkenedLens(tube, cosine_falloff()))
    # Of squares of 2 x 2 pixels, against the noise of 256 rays; observed 1.3 % off at most.
    np.testing.assert_allclose(squares(both), squares(formula * np.cos(np.arctan(TANGENTS)) ** 4), rtol=0.02)
    assert formula.min() < 0.6


def test_corners_darken_as_cats_eyes_narrow():
    """What a highlight far behind the focus loses is what the film point loses of a uniform scene."""
    tube = vignetted_lens(thin(), CAMERA, corner_shift=1.0, disk=1.1)
    places = jnp.array([[18.0, 12.0], [27.0, 18.0], [34.0, 22.0]])
    samples = jnp.asarray(np.random.default_rng(0).random((4096, 2)))
    pupil = jax.vmap(tube.pupil_point)(samples)
    weights = jax.vmap(lambda at: jax.vmap(lambda p: tube.ray(CAMERA, at, p).weight)(pupil))(places)
    eyes = np.asarray((weights > 0.5).mean(axis=1))
    # Observed 0.6 %: the noise of 4096 points.
    np.testing.assert_allclose(illumination(tube, CAMERA, places), eyes, rtol=0.03)


def test_stopping_down_takes_optical_vignetting_away_and_leaves_the_natural():
    tube = vignetted_lens(thin(2.0), CAMERA, corner_shift=0.7, disk=1.1)
    closed = dataclasses.replace(tube, lens=thin(8.0))
    corner = jnp.array([[0.5, 0.5]])
    assert float(illumination(tube, CAMERA, corner)[0]) < 0.8
    assert float(illumination(closed, CAMERA, corner)[0]) == pytest.approx(1.0, abs=1e-12)
    natural = DarkenedLens(closed, cosine_falloff())
    assert float(illumination(natural, CAMERA, corner)[0]) == pytest.approx(
        np.cos(np.arctan(TANGENTS[0, 0])) ** 4, rel=1e-12
    )


def test_a_hood_cuts_corners_off():
    """Mechanical vignetting: at 60 mm, a mouth of 25 mm radius shades what is 0.42 off the axis."""
    hood = hooded_lens(thin(4.0), radius=0.025, distance=0.06)
    opening = float(thin(4.0).aperture_radius)
    wanted = overlap(TANGENTS * 0.06, opening, 0.025)
    found = lit_all_over(hood)
    # The mouth's edge is 5 % of its radius wide, a third of this opening: observed 0.008 off.
    np.testing.assert_allclose(found, wanted, atol=0.03)
    assert found[12, 18] == 1.0
    assert found[0, 0] == 0.0
    # Observed 0.05, of pixels that are cut in two.
    assert float(np.abs(measured(DarkenedLens(hood, cosine_falloff(0.0))) - wanted).max()) < 0.08


@cache
def double_gauss(f_number: float) -> tuple[Camera, PrescriptionLens]:
    camera = look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=0.05)
    lens = lens_preset("gauss_jp62087922_f1.8_1987")
    return camera, prescription_lens(lens, camera, focus_distance=np.inf, f_number=f_number)


@pytest.mark.parametrize("f_number", [1.85, 2.8])
def test_two_disks_darken_as_the_traced_glass(f_number):
    """At places between those that the disks are fitted at, relative to the axis."""
    camera, traced = double_gauss(f_number)
    lens = thin_lens(focus_distance=np.inf, focal_length=0.05, f_number=f_number)
    model = vignetted_like(lens, traced, camera)
    places = jnp.stack([jnp.linspace(18, 35.5, 8), jnp.linspace(12, 23.5, 8)], axis=1)
    found = np.asarray(illumination(model, camera, places))
    truth = np.asarray(illumination(traced, camera, places))
    # Observed 0.2 % and 0.4 % off at most.
    np.testing.assert_allclose(found / found[0], truth / truth[0], rtol=0.02)
    assert (truth[-1] < 0.3) == (f_number < 2)


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("biogon_us2721499_f4.5_1955", 0.291),
        ("gauss_us2673491_f2_1954", 0.153),
        ("sonnar_us1998704_f2_1935", 0.411),
    ],
)
def test_light_in_the_corner_of_a_full_frame_is_that_of_rays_by_optiland(name, share):
    """Wide open, at the lens's own focal length, focused at infinity, as a share of that on the axis.

    Of a grid of Optiland's rays (0.6.3), those within all semi-diameters were counted at fields around the
    corner's; the beam's cross-section, times the solid angle of a piece of the film, is the light there.
    """
    prescription = lens_preset(name)
    length = 1e-3 * converging_length(prescription)
    camera = look_at((0, 0, 0), (0, 0, -1), width=36, height=24, focal_length=length)
    lens = prescription_lens(prescription, camera, focus_distance=np.inf)
    axis, corner = np.asarray(illumination(lens, camera, jnp.array([[18.0, 12.0], [36.0, 24.0]])))
    # Observed: 0.004.
    assert corner / axis == pytest.approx(share, abs=0.008)


def test_light_through_glass_is_what_leaves_its_last_surface():
    """The rays of a double Gauss against light summed over its last surface, ray by ray.

    That a rendered picture has the light of the rays: test_prescription_lens.
    """
    camera, traced = double_gauss(2.8)
    prescription, indices = traced.prescription, traced.indices
    half = float(prescription.semi_diameters[-1])
    x, y = np.meshgrid(*[np.linspace(-half, half, 201)] * 2)
    grid = tuple(jnp.asarray(a.ravel()) for a in (x, y))

    @jax.jit
    def light(film):
        def one(*target):
            found, cosine = from_film(prescription, indices, traced.film_place, tuple(film), target)
            return openness(found.clearance) * cosine**4

        return jnp.sum(jax.vmap(one)(*grid))

    # Some twice, for as many as of `test_two_disks_darken_as_the_traced_glass`, which has compiled it.
    places = np.array([(18.0, 12.0), *[(18.5, 12.5), (30.5, 19.5), (35.5, 23.5)] * 2, (18.0, 12.0)])
    found = np.asarray(illumination(traced, camera, jnp.asarray(places)))
    for place, share in zip(places, found / found[0], strict=True):
        film = -traced.film_scale * (place - (18, 12)) / float(camera.focal_px) * np.array([1, -1])
        wanted = float(light(jnp.asarray(film)) / light(jnp.zeros(2)))
        assert share == pytest.approx(wanted, rel=0.02), place


def test_a_table_is_what_it_says():
    heights, shares = [0.0, 0.005, 0.015, 0.022], [1.0, 0.97, 0.6, 0.3]
    lens = DarkenedLens(thin(), table_falloff(CAMERA, heights, shares))
    places = jnp.array([[18.0, 12.0], [23.0, 12.0], [28.0, 12.0], [18.0, 22.0]])
    # Pixels are 1 mm.
    np.testing.assert_allclose(illumination(lens, CAMERA, places, side=2), [1, 0.97, 0.785, 0.785], rtol=1e-9)
    wanted = np.interp(TANGENTS * 0.028, heights, shares)
    np.testing.assert_allclose(lit_all_over(lens, side=2), wanted, rtol=1e-9)


def test_a_table_that_does_not_reach_the_corner_says_how_far_it_reaches():
    message = (
        "reaches 18.00 mm from the axis, and the picture's farthest corner is 21.63 mm away; add the 3.63 mm"
        " that are missing, or ask for extrapolation"
    )
    with pytest.raises(ValueError, match=re.escape(message)):
        table_falloff(CAMERA, [0, 0.018], [1, 0.5])
    asked = table_falloff(CAMERA, [0, 0.009, 0.018], [1, 0.8, 0.5], extrapolate=True)
    # The last line goes on.
    beyond = asked.share(CAMERA, jnp.array([36.0, 24.0]))
    assert beyond == pytest.approx(0.5 - 0.3 / 9 * (np.hypot(18, 12) - 18))
    steep = table_falloff(CAMERA, [0, 0.018], [1, 0.01], extrapolate=True)
    assert steep.share(CAMERA, jnp.array([36.0, 24.0])) == 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: table_falloff(CAMERA, [0, 0.03], [1]), "expected two or more, as many of both"),
        (lambda: table_falloff(CAMERA, [0.001, 0.03], [1, 0.5]), "expected rising ones from 0 on"),
        (lambda: table_falloff(CAMERA, [0, 0.03], [1, -0.5]), "expected 0 or more, and 1 on the axis"),
        (lambda: cosine_falloff(-1), "power of the cosine is -1"),
        (lambda: hooded_lens(thin(), radius=0, distance=1), "hood's radius is 0 m"),
        (lambda: hooded_lens(thin(), radius=1, distance=-1), "hood's distance is -1 m"),
        (lambda: depth_of_field_lens(CAMERA, 1, 2, circle_px=0), "circle of confusion is 0 px"),
        (lambda: depth_of_field_lens(CAMERA, 1, 2, f_number_range=(8, 2)), "f-numbers are 8 to 2"),
    ],
)
def test_values_that_are_none_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_derivatives_of_the_light_by_the_vignetting():
    def light(radius, distance, power, shares):
        tube = VignettedLens(thin(), 0.008 * radius, 0.01 * distance)
        lens = DarkenedLens(
            DarkenedLens(tube, cosine_falloff()), table_falloff(CAMERA, [0, 0.01, 0.03], [1, 1, 1])
        )
        lens = dataclasses.replace(
            lens,
            falloff=dataclasses.replace(lens.falloff, shares=shares),
            lens=dataclasses.replace(lens.lens, falloff=dataclasses.replace(lens.lens.falloff, power=power)),
        )
        places = jnp.array([[18.0, 12.0], [30.0, 15.0], [2.0, 3.0]])
        return illumination(lens, CAMERA, places, side=32)

    slopes = check_gradients(
        light, jnp.array(1.0), jnp.array(1.0), jnp.array(4.0), jnp.array([1.0, 0.9, 0.4])
    )
    # Each counts in the corners.
    assert (np.abs(slopes[2, 1:]) > 1e-3).sum() >= 4


def test_derivatives_of_the_rendered_picture_by_the_vignetting():
    """Through the tracer, of a uniform scene, against differences of the light that many more rays bring."""
    layers, places = bright(), jnp.asarray(CENTRES[:8, :8].reshape(-1, 2))

    def dark(radius, power):
        tube = VignettedLens(thin(), radius, jnp.array(0.01))
        return DarkenedLens(tube, dataclasses.replace(cosine_falloff(), power=power))

    @eqx.filter_jit
    @eqx.filter_grad
    def slopes(values, layers):
        return render(layers, dark(*values), even=True, rays=1024)[:8, :8].mean()

    def light(*values):
        return float(illumination(dark(*map(jnp.asarray, values)), CAMERA, places).mean())

    found = slopes((jnp.array(0.008), jnp.array(4.0)), layers)
    wanted = (
        (light(0.00801, 4.0) - light(0.00799, 4.0)) / 2e-5,
        (light(0.008, 4.01) - light(0.008, 3.99)) / 2e-2,
    )
    # Observed 6 % and 0.2 % off, the noise of rays in the disk's narrow edge; 0.4 % with another seed.
    assert found[0] == pytest.approx(wanted[0], rel=0.12)
    assert found[1] == pytest.approx(wanted[1], rel=0.01)
