"""Solves with a model of close focus, against searches by the textbook formula, which share no code."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from close_focus_cases import CAMERA, FRAMING_FIRST, MODELS, STATED, ahead, start_of, textbook_blur
from gradients import check_gradients
from scipy.optimize import least_squares

import focusjax as fj
from focusjax.focus import (
    AtLeast,
    AtMost,
    AtPoint,
    Blur,
    FocusPoint,
    InFrame,
    OnSensor,
    Prior,
    SameBlur,
    Sharp,
    diagnose,
    locate,
    residuals,
    solve,
    solve_many,
    stacked,
)
from focusjax.lens import close_focus_lens, lens_settings, thin_lens, tilt_shift_lens


def brute_force(model, places, cost, numbers, near, far):
    """Least cost over a grid of focus and f-number, refined from its ten best places."""
    foci = 1.0 / np.linspace(1.0 / far, 1.0 / near, 400)
    tried = [(cost(textbook_blur(model, d, n, places)) @ cost(textbook_blur(model, d, n, places)), d, n)
             for d in foci for n in numbers]  # fmt: skip
    best = min(tried)[0]
    for _, d, n in sorted(tried)[:10]:
        ends = ([1.0 / far, numbers[0] * (1 - 1e-12)], [1.0 / near, numbers[-1] * (1 + 1e-12)])
        found = least_squares(
            lambda p: cost(textbook_blur(model, 1.0 / p[0], p[1], places)),
            np.clip([1.0 / d, n], *ends),
            bounds=ends,
            xtol=1e-14,
            ftol=1e-14,
            gtol=1e-14,
        )
        best = min(best, 2.0 * found.cost)
    return 0.5 * best


@pytest.mark.parametrize("free", [("focus",), ("focus", "f_number")])
@pytest.mark.parametrize("model", MODELS)
def test_the_optimum_of_the_model_is_found(model, free):
    places = np.array([0.16, 0.22, 0.35])
    wishes = ahead((0.16, Blur(12)), (0.22, Sharp()), (0.35, Blur(25)))
    options: dict[str, Any] = {"f_number_range": (2.8, 22.0)} if "f_number" in free else {}
    found = solve(locate(wishes, CAMERA), CAMERA, start_of(model), free=free, close_focus=model, **options)

    def cost(blur):
        return np.array([abs(blur[0]) - 12, blur[1], abs(blur[2]) - 25])

    numbers = np.geomspace(2.8, 22.0, 120) if "f_number" in free else [4.0]
    near = STATED if model == "framing" else 2 * STATED
    expected = brute_force(model, places, cost, numbers, near, 5.0)
    # Observed 6e-12.
    assert float(found.cost) == pytest.approx(expected, rel=1e-6)
    settings = found.settings()
    blur = textbook_blur(model, float(found.lens.focus_distance()), float(settings.f_number), places)
    np.testing.assert_allclose(found.blur, blur, rtol=1e-9, atol=1e-9)
    # The lens in the camera that comes out blurs as the solution says.
    np.testing.assert_allclose(
        residuals(found.points, found.camera, found.lens), found.error, rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("model", MODELS)
def test_limits_to_the_f_number_are_to_that_which_is_set(model):
    wishes = ahead((0.2, Sharp()), (0.4, Blur(200)))
    found = solve(
        locate(wishes, CAMERA), CAMERA, start_of(model), free=("focus", "f_number"), close_focus=model,
        f_number_range=(2.0, 16.0),
    )  # fmt: skip
    assert found.active_bounds == ("min_f_number",)
    np.testing.assert_allclose(found.settings().f_number, 2.0, rtol=1e-12)
    # What `ThinLens` calls its f-number is the working one.
    assert float(found.lens.f_number(found.camera)) > 2.2


@pytest.mark.parametrize("model", MODELS)
def test_with_the_focus_alone_the_f_number_stays(model):
    wishes = ahead((0.15, Sharp()), (0.25, Blur(30)))
    found = solve(locate(wishes, CAMERA), CAMERA, start_of(model, 2.0, 5.6), close_focus=model)
    np.testing.assert_allclose(found.settings().f_number, 5.6, rtol=1e-12)
    kept = found.settings().image_distance if model == "framing" else found.settings().focal_length
    np.testing.assert_allclose(kept, STATED, rtol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_life_size_is_the_nearest_focus(model):
    far = 2 * STATED if model == "breathing" else STATED
    sharp = ahead((far * 1.0000001, Sharp()))
    found = solve(locate(sharp, CAMERA), CAMERA, start_of(model), close_focus=model)
    np.testing.assert_allclose(found.settings().magnification, 1.0, rtol=1e-6)
    nearer = solve(locate(ahead((0.9 * far, Sharp())), CAMERA), CAMERA, start_of(model), close_focus=model)
    assert nearer.active_bounds == ("min_focus_distance",)
    np.testing.assert_allclose(nearer.settings().magnification, 1.0, rtol=1e-12)


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_limits_to_blur_and_shared_blur_are_met_by_a_search(model):
    wishes = ahead((0.2, AtMost(3)), (0.3, AtLeast(8)), (0.8, Sharp()))
    same = FocusPoint(AtPoint((0.0, 0.0, -0.5)), SameBlur("0.2 m"), name="same")
    found = solve(
        locate([*wishes, same], CAMERA),
        CAMERA,
        start_of(model),
        free=("focus", "f_number"),
        close_focus=model,
    )
    places = np.array([0.2, 0.3, 0.8, 0.5])

    def cost(blur):
        blur = np.abs(blur)
        return np.array([max(blur[0] - 3, 0), min(blur[1] - 8, 0), blur[2], blur[3] - blur[0]])

    near = STATED if model == "framing" else 2 * STATED
    expected = brute_force(model, places, cost, np.geomspace(1.0, 32.0, 120), near, 5.0)
    # Observed 1e-9.
    assert float(found.cost) <= expected * (1 + 1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_solutions_are_differentiable(model):
    points = locate(ahead((0.2, Blur(5)), (0.3, Blur(10)), (0.6, Sharp())), CAMERA)

    def solved(points, stated):
        camera = dataclasses.replace(CAMERA, focal_length=stated)
        _, lens = close_focus_lens(camera, model, focus_distance=1.0, f_number=4.0)
        return solve(points, camera, lens, close_focus=model, min_focus_distance=0.11)

    def by_wishes(target, weight):
        asked = dataclasses.replace(points, target=target, weight=weight)
        return solved(asked, jnp.asarray(STATED)).lens.focus_disparity

    def by_places_and_length(disparity, factor):
        found = solved(dataclasses.replace(points, disparity=disparity), STATED * factor)
        lengths = found.settings().focal_length, found.camera.focal_length
        return found.lens.focus_disparity, *(each / STATED for each in lengths)

    if model == FRAMING_FIRST[0]:
        # Wishes count in both models alike.
        check_gradients(by_wishes, points.target, points.weight)
    check_gradients(by_places_and_length, points.disparity, jnp.asarray(1.0))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.slow
def test_the_f_number_is_differentiable_at_a_bound_and_inside(model):
    points = locate(ahead((0.2, Sharp()), (0.3, Blur(25)), (0.6, Blur(48))), CAMERA)

    def answer(target, widest):
        found = solve(
            dataclasses.replace(points, target=target), CAMERA, start_of(model, number=8.0),
            free=("focus", "f_number"), f_number_range=(widest, 22.0), close_focus=model,
        )  # fmt: skip
        return found.lens.focus_disparity, found.settings().f_number

    check_gradients(answer, points.target, jnp.asarray(1.5), rtol=1e-6)  # observed 4e-10
    assert 1.6 < float(answer(points.target, jnp.asarray(1.5))[1]) < 20.0
    check_gradients(answer, 3.0 * points.target, jnp.asarray(4.0), rtol=1e-6)


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_standard_errors_are_those_of_the_model(model):
    points = locate(ahead((0.2, Sharp()), (0.3, Blur(25)), (0.6, Blur(48))), CAMERA)

    def at(target):
        found = solve(
            dataclasses.replace(points, target=target), CAMERA, start_of(model), free=("focus", "f_number"),
            close_focus=model,
        )  # fmt: skip
        return jnp.stack([found.lens.focus_disparity, found.settings().f_number])

    slopes = np.asarray(jax.jacrev(at)(points.target))
    found = solve(points, CAMERA, start_of(model), free=("focus", "f_number"), close_focus=model)
    assert found.active_bounds == found.undetermined == ()
    errors = diagnose(found).standard_errors
    expected = np.sqrt(np.sum((slopes * np.asarray(points.tolerance)) ** 2, axis=1))
    # Gauss-Newton, so exact where the wishes are nearly met.
    np.testing.assert_allclose([errors["focus"], errors["f_number"]], expected, rtol=1e-9)  # observed 2e-15


def test_breathing_moves_what_is_off_the_axis():
    place = (0.01, 0.005, -0.2)
    points = locate([FocusPoint(AtPoint(place), Sharp())], CAMERA)
    found = solve(points, CAMERA, start_of("breathing"), close_focus="breathing")
    np.testing.assert_allclose(found.points.xy[0], found.camera.project(jnp.array(place))[0], rtol=1e-12)
    np.testing.assert_allclose(found.camera.focal_length, 0.05 * 0.2 / 0.15, rtol=1e-9)
    kept = solve(points, CAMERA, start_of("framing"), close_focus="framing")
    np.testing.assert_array_equal(kept.points.xy, points.xy)
    np.testing.assert_array_equal(kept.camera.focal_length, CAMERA.focal_length)


@pytest.mark.parametrize("model", MODELS)
def test_blur_in_millimetres_is_on_the_sensor(model):
    wishes = ahead((0.2, Sharp()), (0.4, Blur(OnSensor(0.5))))
    points = locate(wishes, CAMERA)
    found = solve(points, CAMERA, start_of(model), free=("focus", "f_number"), close_focus=model)
    length = float(found.settings().focal_length)
    image = float(found.settings().image_distance)
    # Lee09 eq. 1: s A |1 / d_f - 1 / d| is half of it.
    circle = length / float(found.settings().f_number) * image * (1 / 0.2 - 1 / 0.4)
    assert 1000 * circle == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_an_expected_f_number_is_that_which_is_set(model):
    wishes = ahead((0.2, Sharp()), (0.4, AtMost(1e3)))
    found = solve(
        locate(wishes, CAMERA), CAMERA, start_of(model), free=("focus", "f_number"), close_focus=model,
        priors={"f_number": Prior(7.0, sigma=0.01)},
    )  # fmt: skip
    np.testing.assert_allclose(found.settings().f_number, 7.0, rtol=1e-6)


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_many_at_once_are_as_one_by_one(model):
    sets = [locate(ahead((0.2, Sharp()), (z, Blur(8))), CAMERA) for z in (0.3, 0.5)]
    together = solve_many(stacked(sets), CAMERA, start_of(model), close_focus=model)
    for index, points in enumerate(sets):
        alone = solve(points, CAMERA, start_of(model), close_focus=model)
        np.testing.assert_allclose(together.at(index).lens.focus_disparity, alone.lens.focus_disparity)
        np.testing.assert_allclose(together.at(index).settings().f_number, alone.settings().f_number)


def test_what_is_printed_is_what_is_set():
    found = solve(locate(ahead((0.2, Sharp())), CAMERA), CAMERA, start_of("framing"), close_focus="framing")
    assert str(found).splitlines()[0] == "Focus 20 cm, f/4.0, 40 mm"


def test_without_a_model_nothing_changes():
    points = locate(ahead((0.2, Sharp()), (0.4, Blur(10))), CAMERA)
    start = thin_lens(focus_distance=1, f_number=4, focal_length=STATED)
    plain = solve(points, CAMERA, start)
    said = solve(points, CAMERA, start, close_focus="ignored")
    np.testing.assert_array_equal(plain.lens.focus_disparity, said.lens.focus_disparity)
    found = plain.settings()
    np.testing.assert_allclose([found.f_number, found.focal_length], [4.0, STATED])


def refused(match: str, *, wishes: Any = None, lens: Any = None, **options: Any) -> None:
    points = locate(wishes or ahead((0.2, Sharp())), CAMERA)
    options = {"close_focus": "breathing", **options}
    with pytest.raises(ValueError, match=match):
        solve(points, CAMERA, lens or start_of("breathing"), **options)


def test_what_it_is_not_for_is_refused():
    refused("'tilt' is free; only the focus and the f-number", free=("focus", "tilt"))
    refused("'focal_length' is free", free=("focal_length",), focal_length_range=(0.04, 0.06))
    tilted = tilt_shift_lens(focus_distance=1, tilt=0.1, f_number=4, focal_length=STATED)
    refused("the lens is a TiltShiftLens", lens=tilted)
    refused("the focus has a prior", priors={"focus": Prior(1.0, sigma=1.0)})
    refused("a wish is for the place where something is shown", wishes=ahead((0.2, InFrame(10))))
    refused("the focal length over the distance of '0.04 m' is 1.25", wishes=ahead((0.04, Sharp())))
    within = thin_lens(focus_distance=0.04, aperture_radius=0.01)
    refused("the focal length over the starting focus distance is 1.25", lens=within)
    refused("the starting f-number is 4", free=("focus", "f_number"), f_number_range=(5, 8))
    glass = fj.prescription_lens(fj.lens_preset("cooke_triplet_50mm_f4"), CAMERA, focus_distance=2.0)
    refused("`through` is a real lens, whose glass says", through=glass)


def test_light_and_focus_share_f_numbers_without_it():
    points = locate(ahead((0.2, Sharp())), CAMERA)
    with pytest.raises(ValueError, match="light and focus share f-numbers without it"):
        fj.solve_exposed(
            points, CAMERA, start_of("framing"), 0.18, {"luminance": 20.0}, close_focus="framing"
        )


def test_a_place_that_has_no_say_may_be_anywhere():
    points = locate(ahead((0.2, Sharp()), (0.04, Sharp())), CAMERA)
    points = dataclasses.replace(points, weight=jnp.array([1.0, 0.0]))
    found = solve(points, CAMERA, start_of("breathing"), close_focus="breathing")
    np.testing.assert_allclose(found.lens.focus_distance(), 0.2, rtol=1e-9)
    assert np.isfinite(np.asarray(found.blur)).all()
    assert float(lens_settings(found.camera, found.lens, "breathing").f_number) == pytest.approx(4.0)
