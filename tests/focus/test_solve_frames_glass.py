"""Frames through glass: as stills are, in the blur that the picture has, and smooth over time."""

import jax
import numpy as np
import pytest
from ray_spots import rms_diameter

import focusjax as fj
from focusjax.focus import ArgumentError, solve_frames

CAMERA = fj.look_at((0, 0, 0), (0, 0, -1), width=240, height=160, focal_length=0.05)
FRAMES = 5
"""One fewer than there is room for."""
FREE = ("focus", "f_number")
ROOM = (2.0, 2.0 * (1 + 1e-9))
"""None to speak of for the f-number; what is compiled with it free serves all tests."""


@pytest.fixture(scope="module")
def glass():
    return fj.prescription_lens(fj.lens_preset("gauss_jp62087922_f1.8_1987"), CAMERA, focus_distance=2.0)


def start(f_number=2.0):
    return fj.thin_lens(focus_distance=2.0, f_number=f_number, focal_length=0.05)


def places(frame):
    """Of a figure that comes nearer, and of what is behind it."""
    return (0.06, 0.03, -0.9 + 0.02 * frame), (-0.15, 0.05, -1.6)


def wished(frame, *, near=1.0, far=1.0):
    """With a weight for each."""
    here, there = places(frame)
    return fj.locate(
        [
            fj.FocusPoint(fj.AtPoint(here), fj.Sharp(), name="near", weight=near),
            fj.FocusPoint(fj.AtPoint(there), fj.Blur(7.0), name="far", weight=far),
        ],
        CAMERA,
    )


def still(frame, glass, **options):
    options = {"f_number_range": ROOM} | options
    return fj.solve(wished(frame), CAMERA, start(), through=glass, free=FREE, **options)


def solved(points, glass, **options):
    options = {"f_number_range": ROOM} | options
    return solve_frames(points, CAMERA, start(), through=glass, free=FREE, **options)


@pytest.fixture(scope="module")
def together(glass):
    return solved([wished(frame) for frame in range(FRAMES)], glass, smoothness=10.0)


@pytest.mark.slow
def test_one_frame_is_solved_as_a_still_is(glass):
    for room in (ROOM, (1.0, 22.0)):
        alone = still(0, glass, f_number_range=room)
        frame = solved([wished(0)], glass, f_number_range=room)
        # Observed: 5e-7 px.
        np.testing.assert_allclose(frame.blur[0, :2], alone.blur, atol=1e-5)
        np.testing.assert_allclose(frame.error[0, :2], alone.error, atol=1e-5)
        assert float(frame.cost) == pytest.approx(float(alone.cost), rel=1e-6)
        assert float(frame.at(0)[1].aperture_radius) == pytest.approx(
            float(alone.lens.aperture_radius), rel=1e-5
        )


def test_what_is_reported_is_what_rays_of_the_final_lens_have(together):
    frame = FRAMES - 1
    lens = together.glass_at(frame)
    assert 1 / float(lens.focus_distance()) == pytest.approx(together.settings()["focus_per_m"][frame])
    points = wished(frame)
    for number, row in enumerate(together.table(frame)):
        # Observed: 0.002 px off.
        found = float(rms_diameter(lens, CAMERA, points.xy[number], points.disparity[number]))
        assert abs(row.got) == pytest.approx(found, abs=0.02)


def test_smoothness_acts_on_the_focus_through_glass(glass):
    """The wish for sharpness stops halfway; what is left pulls the focus away at once, or slowly."""
    points = [wished(frame, near=float(frame < FRAMES // 2)) for frame in range(FRAMES)]
    loose = solved(points, glass, smoothness=0.0, steadiness=0.0)
    stiff = solved(points, glass, smoothness=1e3, steadiness=0.0)
    rough = [change.largest_changes()["focus_per_m"].pixels_per_frame2 for change in (loose, stiff)]
    # Observed: 1.24 and 0.0004 px per frame^2.
    assert rough[1] < 0.05 * rough[0]
    assert float(stiff.cost) > float(loose.cost)
    # Without smoothness, every frame is a still. Observed: 8e-6 px.
    np.testing.assert_allclose(loose.blur[1, :2], still(1, glass).blur, atol=1e-4)


@pytest.mark.slow
def test_no_focus_beside_it_is_better(glass, together):
    """By the cost as it is stated: errors of the glass, and differences of the focus in pixels."""

    def cost(pixels, error):
        bend, pace = np.diff(pixels, n=2), np.diff(pixels)
        return 0.5 * (np.sum(error**2) + 10.0 * np.sum(bend**2) + np.sum(pace**2))

    focus = together.settings()["focus_per_m"]
    scale = np.asarray(together.pixels)[:, 0] / focus
    best = cost(scale * focus, np.asarray(together.error)[:, :2])
    assert best == pytest.approx(float(together.cost), rel=1e-6)
    for step in (-0.004, 0.004):
        moved = focus + step * np.linspace(-1.0, 1.0, FRAMES) ** 2
        errors = []
        for frame in range(FRAMES):
            limits = {
                "min_focus_distance": 1 / (moved[frame] + 1e-9),
                "max_focus_distance": 1 / (moved[frame] - 1e-9),
            }
            held = still(frame, glass, **limits)
            errors.append(np.asarray(held.error))
        assert cost(scale * moved, np.array(errors)) > best


def test_what_wishes_cost_each_other_is_that_of_solving_again(glass, together):
    (conflict,) = fj.diagnose(together).conflicts
    gains = {conflict.first: conflict.first_gains, conflict.second: conflict.second_gains}
    for number, name in enumerate(("near", "far")):
        points = [wished(frame, **{("far", "near")[number]: 0.0}) for frame in range(FRAMES)]
        alone = solved(points, glass, smoothness=10.0)
        gained = np.abs(np.asarray(together.error)) - np.abs(np.asarray(alone.error))
        # Observed: 0.001 px off.
        assert gains[name] == pytest.approx(gained[:, number].max(), abs=0.02)


def test_what_glass_cannot_do_is_refused(glass):
    points = [wished(0), wished(1)]
    with pytest.raises(ArgumentError, match="there are 1 lenses of through for 2 frames"):
        solve_frames(points, CAMERA, start(), through=[glass])

    def cost(weight):
        return solve_frames(points, CAMERA, start(), through=glass, smoothness=weight).cost

    with pytest.raises(ArgumentError, match="frames are solved through glass with known values and without"):
        jax.grad(cost)(1.0)
    triplet = fj.prescription_lens(fj.lens_preset("cooke_triplet_50mm_f4"), CAMERA, focus_distance=2.0)
    with pytest.raises(ArgumentError, match="the glass of frame 1 is another lens than that of frame 0"):
        solve_frames(points, CAMERA, start(4.0), through=[glass, triplet])
