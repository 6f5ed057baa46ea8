"""Shots with a model of close focus, against stills and searches by the textbook formula."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from close_focus_cases import CAMERA, FRAMING_FIRST, PIXELS, SENSOR, STATED, ahead, start_of, textbook_blur
from gradients import check_gradients
from scipy.optimize import least_squares

import focusjax as fj
from focusjax.focus import AtPoint, Blur, FocusPoint, Sharp, locate, residuals, solve, solve_frames
from focusjax.lens import close_focus_lens

PLACES = [(0.16, 0.3), (0.17, 0.3), (0.25, 0.3), (0.4, 0.3)]
TARGETS = (15, 14, 25, 12)


def frames():
    """Something near that comes and goes, and something behind it that stays."""
    return [
        locate(
            [FocusPoint(AtPoint((0.0, 0.0, -near)), Sharp(), name="near"),
             FocusPoint(AtPoint((0.0, 0.0, -far)), Blur(target), name="far")],
            CAMERA,
        )
        for (near, far), target in zip(PLACES, TARGETS, strict=True)
    ]  # fmt: skip


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_frames_that_nothing_ties_together_are_solved_one_by_one(model):
    points = frames()
    free = {"free": ("focus", "f_number"), "close_focus": model}
    together = solve_frames(points, CAMERA, start_of(model), smoothness=0.0, steadiness=0.0, **free)
    settings = together.settings()
    for frame, each in enumerate(points):
        alone = solve(each, CAMERA, start_of(model), **free)
        found = alone.settings()
        expected = {
            "focus_per_m": alone.lens.focus_disparity,
            "f_number": found.f_number,
            "focal_length_mm": 1000 * found.focal_length,
            "image_distance_mm": 1000 * found.image_distance,
        }
        for name, value in expected.items():
            np.testing.assert_allclose(settings[name][frame], value, rtol=1e-6)
        camera, lens = together.at(frame)
        # What makes the picture blurs as the solution says.
        np.testing.assert_allclose(
            residuals(jax.tree.map(lambda leaf, t=frame: leaf[t], together.points), camera, lens)[:2],
            together.error[frame][:2],
            atol=1e-9,
        )


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_frames_together_cost_no_more_than_by_the_textbook(model):
    """Least squares of scipy over all foci, in image distances, with the smoothness that is documented."""
    points = frames()
    found = solve_frames(points, CAMERA, start_of(model), close_focus=model, smoothness=2.0, steadiness=0.5)
    offset = STATED if model == "framing" else -STATED
    pixels_per_unit = STATED / 4.0 * (STATED * PIXELS / SENSOR)

    def rows(foci):
        blur = np.array([textbook_blur(model, 1 / w, 4.0, at) for w, at in zip(foci, PLACES, strict=True)])
        setting = pixels_per_unit / (1 / foci + offset)
        wishes = [blur[:, 0], np.abs(blur[:, 1]) - TARGETS]
        return np.concatenate(
            [*wishes, np.sqrt(2.0) * np.diff(setting, n=2), np.sqrt(0.5) * np.diff(setting)]
        )

    tried = [least_squares(rows, 1 / np.array(first), bounds=(0.5, 9.9), xtol=1e-14, ftol=1e-14, gtol=1e-14)
             for first in ((0.16, 0.17, 0.25, 0.4), (0.2, 0.2, 0.2, 0.2), (0.5, 0.5, 0.5, 0.5))]  # fmt: skip
    best = min(tried, key=lambda each: each.cost)
    assert float(found.cost) == pytest.approx(best.cost, rel=1e-9)
    np.testing.assert_allclose(found.settings()["focus_per_m"], best.x, rtol=1e-6)


@pytest.mark.parametrize("model", FRAMING_FIRST)
def test_frames_are_differentiable(model):
    points = frames()[:3]

    def answer(disparity, stated):
        camera = dataclasses.replace(CAMERA, focal_length=STATED * stated)
        _, lens = close_focus_lens(camera, model, focus_distance=1.0, f_number=4.0)
        moved = [dataclasses.replace(each, disparity=at) for each, at in zip(points, disparity, strict=True)]
        found = solve_frames(moved, camera, lens, close_focus=model, smoothness=2.0)
        return found.lens.focus_disparity, found.camera.focal_length / STATED

    check_gradients(answer, jnp.stack([each.disparity for each in points]), jnp.asarray(1.0))


def test_frames_refuse_what_a_picture_refuses():
    points = locate(ahead((0.2, Sharp())), CAMERA)
    near = dataclasses.replace(locate(ahead((0.04, Sharp())), CAMERA), names=points.names)
    start, glass = start_of("breathing"), fj.lens_preset("cooke_triplet_50mm_f4")
    with pytest.raises(ValueError, match=r"the focal length over the distance of '0\.2 m' is 1\.25"):
        solve_frames([points, near], CAMERA, start, close_focus="breathing")
    through = fj.prescription_lens(glass, CAMERA, focus_distance=2.0)
    with pytest.raises(ValueError, match="`through` is a real lens, whose glass says"):
        solve_frames([points, points], CAMERA, start, close_focus="breathing", through=through)
