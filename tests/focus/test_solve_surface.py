"""Focal surfaces solved for wishes: met where they can be, smooth, differentiable, confirmed by rays."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients

from focusjax.focus import (
    AT_MOST,
    EQUAL,
    ImagePoints,
    SurfaceSolution,
    _solve_surface,
    diagnose,
    solve_focal_surface,
)
from focusjax.focus._image_points import anonymous
from focusjax.geometry import make_camera
from focusjax.lens import (
    FocalSurface,
    FocalSurfaceLens,
    ThinLens,
    focal_surface,
    focal_surface_lens,
    surface_blur,
    thin_lens,
)

PLACES = np.array([(6.0, 6.0), (50.0, 9.0), (30.0, 40.0), (12.0, 33.0)])
CAMERA = make_camera(np.eye(4), width=64, height=48, focal_length=0.05)


def lens() -> ThinLens:
    return thin_lens(focus_distance=2.0, aperture_radius=0.1)


def wishes(target=(0.0, 0.0, 5.0, -3.0), *, signed=True, xy=PLACES) -> ImagePoints:
    count = len(target)
    return ImagePoints(
        xy=jnp.asarray(xy),
        disparity=jnp.array([0.4, 1.1, 0.6, 0.8]),
        target=jnp.array(target),
        signed=jnp.full(count, signed),
        weight=jnp.array([1.0, 2.0, 1.0, 0.5]),
        tolerance=jnp.ones(count),
        wish=jnp.arange(count),
        names=tuple("abcd"),
    )


def controls() -> FocalSurface:
    return focal_surface(PLACES + 0.3, 0.5)


@pytest.fixture(scope="module")
def found() -> SurfaceSolution:
    """With next to no smoothness."""
    return solve_focal_surface(wishes(), CAMERA, controls(), lens(), smoothness=1e-9)


def test_as_many_controls_as_wishes_meet_them_all(found):
    # Observed: 3e-8 px.
    assert np.abs(found.error).max() < 1e-6
    assert [row.met for row in found.table()] == [True] * 4


@pytest.mark.parametrize("count", [1, 3, 4])
def test_rows_without_weight_that_fill_a_problem_up_change_nothing(count):
    surface = focal_surface(PLACES[:count] + 0.3, 0.5)
    points, smoothness = wishes(), jnp.asarray(1e-3)

    def plain(target):
        asked = anonymous(dataclasses.replace(points, target=target))
        return _solve_surface._solve(asked, CAMERA, surface, lens(), smoothness)

    def filled(target):
        return solve_focal_surface(dataclasses.replace(points, target=target), CAMERA, surface, lens())

    found = filled(points.target)
    focus, *others = plain(points.target)
    for name, want in zip(("blur", "error", "roughness", "cost"), others, strict=True):
        np.testing.assert_allclose(getattr(found, name), want, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.surface.focus_disparity, focus, rtol=1e-9)
    made = focal_surface_lens(found.surface, CAMERA, lens())
    np.testing.assert_array_equal(found.lens.focus_disparity, made.focus_disparity)
    slopes = [
        jax.jacrev(disparities)(points.target)
        for disparities in (lambda t: plain(t)[0], lambda t: filled(t).surface.focus_disparity)
    ]
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-7, atol=1e-12)


def test_a_surface_sampled_for_fewer_pixels_is_the_same_surface():
    fewer = make_camera(np.eye(4), width=32, height=24, focal_length=0.05)
    surface = focal_surface(PLACES, [0.4, 1.1, 0.6, 0.8], aperture_scale=[1.0, 0.5, 0.0, 2.0])
    made = focal_surface_lens(surface, CAMERA, lens())
    found = made.sampled_for(CAMERA, fewer)
    # Every second corner of a pixel is one of theirs.
    np.testing.assert_allclose(found.focus_disparity, made.focus_disparity[::2, ::2], rtol=1e-12)
    np.testing.assert_allclose(found.aperture_scale, made.aperture_scale[::2, ::2], rtol=1e-12)
    place, w = jnp.array([20.0, 11.0]), jnp.array(0.7)
    half = found.blur(fewer, place, w)
    np.testing.assert_allclose(2 * half, made.blur(CAMERA, 2 * place, w), rtol=1e-9)


def test_blur_at_a_point_is_that_of_the_lens_for_the_whole_picture(found):
    """Inside pixels, on their borders and corners, on the picture's frame and beyond it."""
    places = jnp.array([(6.3, 6.8), (50.0, 9.5), (30.0, 40.0), (0.0, 48.0), (64.0, 20.1), (-5.0, 50.0)])
    surface = dataclasses.replace(found.surface, aperture_scale=jnp.array([1.0, 0.5, 1.5, 0.8]))
    whole = focal_surface_lens(surface, CAMERA, lens())
    for place in places:
        own = surface_blur(surface, CAMERA, lens(), place, jnp.asarray(0.7))
        # Observed: 9e-16 of it.
        np.testing.assert_allclose(own, whole.blur(CAMERA, place, jnp.asarray(0.7)), rtol=1e-12)


@eqx.filter_jit
def landings(lens: FocalSurfaceLens, place, disparity, samples):
    """Where rays from a film point are at a disparity."""

    def landing(sample):
        ray = lens.ray(CAMERA, place, lens.pupil_point(sample))
        return ray.a + disparity * ray.b

    return jax.vmap(landing)(samples)


def test_rays_through_a_sharp_point_land_together(found):
    samples = jnp.array(np.random.default_rng(0).uniform(size=(64, 2)))
    for place, disparity in zip(found.points.xy[:2], found.points.disparity[:2], strict=True):
        landed = np.asarray(landings(found.lens, place, disparity, samples))
        # Observed: below 1e-6 px, as the error of the wish.
        assert np.ptp(landed, axis=0).max() < 0.1


def test_smoothness_trades_misses_for_roughness():
    loose, tight = (
        solve_focal_surface(wishes(), CAMERA, controls(), lens(), smoothness=s) for s in (1e-6, 1.0)
    )
    assert tight.roughness < 0.5 * loose.roughness
    assert np.abs(tight.error).max() > np.abs(loose.error).max()
    flat = focal_surface(PLACES + 0.3, tight.surface.focus_disparity)
    # The cost is what the docstring says it is.
    columns, rows = (jnp.arange(n) + 0.5 for n in (16, 12))
    grid = jnp.stack([g.reshape(-1) for g in jnp.meshgrid(columns / 16 * 64, rows / 12 * 48)], axis=1)
    slope = 2 * lens().parallax(CAMERA)
    gradient = jax.jit(jax.vmap(jax.grad(lambda p: slope * flat.at(p)[0])))(grid) * 100
    assert float(tight.roughness) == pytest.approx(float(jnp.sqrt((gradient**2).sum(1).mean())), rel=1e-9)


def test_unsigned_wishes_choose_the_sides_that_can_be_met():
    found = solve_focal_surface(
        wishes((0.0, 0.0, 5.0, 3.0), signed=False), CAMERA, controls(), lens(), smoothness=1e-9
    )
    assert np.abs(found.error).max() < 0.02


@pytest.mark.parametrize("smoothness", [0.0, 1e-3])
def test_coincident_controls_move_alike_and_nothing_is_undetermined(smoothness):
    surface = focal_surface(PLACES[[0, 1, 2, 0]] + 0.3, 0.5)
    found = solve_focal_surface(wishes(), CAMERA, surface, lens(), smoothness=smoothness)
    values = np.asarray(found.surface.focus_disparity)
    assert np.isfinite(values).all()
    assert values[0] == pytest.approx(values[3], abs=1e-9)


def test_derivative_is_that_of_solving_again():
    points, surface, thin = wishes(), controls(), lens()

    def solved(values: jnp.ndarray) -> jnp.ndarray:
        disparity, target, weight = values.reshape(3, 4)
        changed = dataclasses.replace(points, disparity=disparity, target=target, weight=weight)
        return solve_focal_surface(changed, CAMERA, surface, thin).surface.focus_disparity

    values = jnp.concatenate([points.disparity, points.target, points.weight])
    check_gradients(solved, values)


def test_relations_that_say_nothing_change_nothing():
    plain = wishes()
    said = dataclasses.replace(plain, relation=jnp.full(4, EQUAL), notes=("", "hidden", "", ""))
    first, second = (solve_focal_surface(points, CAMERA, controls(), lens()) for points in (plain, said))
    np.testing.assert_array_equal(first.error, second.error)
    assert [row.note for row in second.table()] == ["", "hidden", "", ""]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"smoothness": -1.0}, "smoothness is -1; expected zero"),
        (
            {"points": dataclasses.replace(wishes(), relation=jnp.array([EQUAL, EQUAL, AT_MOST, EQUAL]))},
            "a wish is a limit, or for the blur of another point; a focal surface takes sharpness",
        ),
        ({"lens": thin_lens(focus_distance=2.0, aperture_radius=0.0)}, "a pinhole is sharp everywhere"),
    ],
)
def test_what_cannot_be_solved_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        solve_focal_surface(
            **{"points": wishes(), "camera": CAMERA, "surface": controls(), "lens": lens(), **arguments}
        )


def test_diagnosis_of_what_is_met_says_nothing(found):
    said = diagnose(found)
    assert (said.conflicts, said.unreachable, said.sentences) == ((), (), ())
    assert len(said.singular_values) == 4


def test_diagnosis_of_conflicts_smoothness_and_open_controls():
    """Two wishes at one place contradict each other; two controls are farther off than any wish reaches."""
    places = np.array([(6.0, 6.0), (6.0, 6.0), (50.0, 9.0), (12.0, 33.0)])
    points = wishes((0.0, 8.0, 0.0, 0.0), xy=places)
    said = diagnose(solve_focal_surface(points, CAMERA, controls(), lens(), smoothness=1e-2))
    worst = said.conflicts[0]
    assert (worst.first, worst.second) == ("a", "b")
    assert worst.mutual
    assert said.unreachable == ()
    assert any(
        line.startswith('"a" and "b" pull against each other: without "b", "a"') for line in said.sentences
    )
    assert any(line.startswith("Smoothness costs ") for line in said.sentences)
    alone = dataclasses.replace(points, weight=jnp.array([1.0, 0.0, 0.0, 0.0]))
    found = solve_focal_surface(alone, CAMERA, controls(), lens(), smoothness=0.0)
    few = diagnose(found)
    # What one wish says is of the control beside it.
    assert few.open_controls == (1, 2, 3)
    assert few.sentences == (
        "The wishes leave control points 1, 2 and 3 (counted from 0) open, which the surface given settles.",
    )
    named = diagnose(found, controls=["door", "lamp", "rug", "cat"]).sentences
    assert named[0].startswith('The wishes leave control points "lamp", "rug" and "cat" open, which')
    with pytest.raises(ValueError, match="there are 2 names of control points; expected 4, or none"):
        diagnose(found, controls=["door", "lamp"])
