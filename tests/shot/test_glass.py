"""A shot through a real lens: wishes of all kinds are met and reported as a still's are."""

import re

import numpy as np
import pytest
from boxes_config import write_boxes

from focusjax.config import ConfigError, load_config
from focusjax.job import run
from focusjax.lens import TiltedPrescriptionLens, pupil_radius
from focusjax.shot import build_shot, solve_shot
from focusjax.shot._report import shot_summary

CHANGES = [
    'lens.prescription="gauss_jp62087922_f1.8_1987"',
    "lens.focus_distance_m=inf",
    "solve={free=['focus']}",
    "focus=[{name='front', point=[-0.4, 0, -1.75], sharp=true},"
    " {name='behind', point=[1, 0, -4.75], blur_px=1}]",
]


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return write_boxes(tmp_path_factory.mktemp("boxes"))


@pytest.mark.slow
def test_every_frame_is_solved_as_a_still_is(boxes):
    """The wishes count in full in the first two of three frames; the last one follows them."""
    timed = "{name='front', to_frame=2}, {name='behind', to_frame=2}"
    config = load_config(boxes, [*CHANGES, f"shot={{frames=3, fade_frames=0, wishes=[{timed}]}}"])
    solved = solve_shot(build_shot(config))
    outcome = run(load_config(boxes, CHANGES), rendering=False)
    still = outcome.solution
    focus = solved.solution.settings()["focus_per_m"]
    np.testing.assert_allclose(focus, 1 / float(outcome.glass.exact.focus_distance()), rtol=1e-5)
    # One wish is sharp, one is blurred, and neither is met.
    np.testing.assert_allclose(solved.solution.blur[:2, :2], np.stack([still.blur] * 2), atol=1e-3)
    for number in (1, 3):
        made, found = solved.seen_with(number, fit=False)[1], solved.solution.glass_at(number - 1)
        assert float(made.focus_distance()) == pytest.approx(float(found.focus_distance()), rel=1e-6)
        assert float(pupil_radius(made)) == pytest.approx(float(pupil_radius(found)), rel=1e-6)
    told = shot_summary(config, solved, None, {}, {})
    rows = told["frames"][0]["wishes"]
    assert [row["got_px"] for row in rows] == pytest.approx(np.asarray(still.blur).tolist(), abs=1e-3)
    assert {each["wish"] for each in told["diagnosis"]["missed"]} == {
        row["name"] for row in rows if not row["met"]
    }


@pytest.mark.slow
def test_tilted_frames_are_solved_as_a_tilted_still_is(boxes):
    """Both of two frames, in which the wishes count in full."""
    timed = "shot={frames=2, fade_frames=0}"
    turned = [*CHANGES, "lens.tilt_deg=2"]
    solved = solve_shot(build_shot(load_config(boxes, [*turned, timed])))
    still = run(load_config(boxes, turned), rendering=False).solution
    np.testing.assert_allclose(solved.solution.settings()["tilt_deg"], [2, 2], rtol=1e-5)
    # Observed: 1.3e-6 px.
    np.testing.assert_allclose(solved.solution.blur[:, :2], np.stack([still.blur] * 2), atol=1e-3)
    made, found = solved.seen_with(2, fit=False)[1], solved.solution.glass_at(1)
    assert isinstance(made, TiltedPrescriptionLens)
    np.testing.assert_allclose(made.plane, found.plane, rtol=1e-5)


def test_keyframes_turn_the_glass(boxes):
    turned = "shot={frames=3, lens=[{frame=1, tilt_deg=0}, {frame=3, tilt_deg=2}]}"
    shot = build_shot(load_config(boxes, [*CHANGES, turned]))
    glass = shot.glass.as_made(3, shot.cameras[2], shot.lenses[2])
    assert isinstance(glass, TiltedPrescriptionLens)
    np.testing.assert_allclose(np.degrees(glass.tilt_and_swing()[0]), 2.0, rtol=1e-5)


def test_height_fields_are_not_turned(boxes):
    heights = (boxes.parent / "flat.npy").as_posix()
    np.save(heights, np.zeros((9, 9)))
    sizes = "width_mm=20, scale_mm=1, thickness_mm=5, glass={n_d=1.5, v_d=60}"
    field = f"lens.height_field={{file='{heights}', {sizes}}}"
    turned = "shot={frames=2, lens=[{frame=1, tilt_deg=3}]}"
    message = "keyframes of tilt_deg and a lens.height_field, which has no such setting; leave one out"
    with pytest.raises(ConfigError, match=re.escape(message)):
        build_shot(load_config(boxes, [*CHANGES[1:], field, turned]))
