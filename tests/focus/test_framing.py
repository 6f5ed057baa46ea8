"""Shift and rise put things where they are wished in the picture, and change nothing else."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from focusjax.focus import (
    ACROSS,
    AT_LEAST,
    AT_MOST,
    DOWN,
    AtInfinity,
    AtPoint,
    Blur,
    FocusPoint,
    InDepthRange,
    InFrame,
    OnMask,
    OnObject,
    OnSensor,
    Prior,
    Result,
    Sharp,
    ShownAt,
    diagnose,
    locate,
    solve,
    solve_focal_surface,
)
from focusjax.focus._priors import checked_priors, prior_rows
from focusjax.geometry import Camera, make_camera
from focusjax.lens import ThinLens, focal_surface, thin_lens

LENGTH, SENSOR, WIDTH, HEIGHT = 0.05, 0.036, 640, 480
DENSITY = WIDTH / SENSOR
FREE = ("focus", "shift", "rise")
ZOOM = {"free": (*FREE, "focal_length"), "focal_length_range": (0.02, 0.1)}
SHARP = FocusPoint(AtPoint((0.2, 0.1, -4.0)), Sharp(), name="subject")
TOP = (0.3, 1.2, -4.0)


def camera(**slide: float) -> Camera:
    return make_camera(
        np.eye(4), width=WIDTH, height=HEIGHT, focal_length=LENGTH, sensor_width=SENSOR, **slide
    )


def lens() -> ThinLens:
    return thin_lens(focus_distance=5.0, f_number=2.8, focal_length=LENGTH)


def solved(*wishes: FocusPoint, start: Camera | None = None, **options):
    """At most eight rows, so that one compiled program serves them all."""
    start = camera() if start is None else start
    return solve(locate(wishes, start), start, lens(), **{"free": FREE, **options})


def test_a_point_is_shown_where_it_is_wished():
    """The closed form: a slide by the pixels that it is off; from a frame that is off-centre already."""
    start = camera(shift=0.002, rise=0.001)
    found = solved(SHARP, FocusPoint(AtPoint(TOP), ShownAt(320.0, 100.0)), start=start)
    # Observed: no difference.
    offset = DENSITY * LENGTH * np.array(TOP[:2]) / 4.0
    np.testing.assert_allclose(float(found.camera.shift), offset[0] / DENSITY, rtol=1e-9)
    np.testing.assert_allclose(float(found.camera.rise), (100 - 240 + offset[1]) / DENSITY, rtol=1e-9)
    np.testing.assert_allclose(found.camera.project(jnp.array(TOP))[0], [320, 100], rtol=1e-9)
    assert found.result == Result.solved
    assert [row.met for row in found.table()] == [True, True]


def test_sliding_changes_neither_blur_nor_perspective():
    wishes = [
        SHARP,
        FocusPoint(AtPoint(TOP), ShownAt(320.0, 100.0)),
        FocusPoint(AtPoint((1, 0, -9)), Blur(5.0, signed=True)),
    ]
    found, still = solved(*wishes), solved(*wishes, shift_range=(0, 0), rise_range=(0, 0))
    np.testing.assert_allclose(found.lens.focus_disparity, still.lens.focus_disparity, rtol=1e-12)
    np.testing.assert_allclose(found.blur, still.blur, atol=1e-9)
    # Every point of the world, wherever it is, moves by the same pixels.
    places = jnp.array([(0.3, 1.0, -4.0), (-1.0, -1.0, -9.0)])
    before, after = (jax.vmap(each.project)(places)[0] for each in (still.camera, found.camera))
    slide = found.camera.principal_point - still.camera.principal_point
    assert float(jnp.abs(slide).min()) > 50
    np.testing.assert_allclose(after - before, np.tile(slide, (2, 1)), atol=1e-10)


def test_the_frame_moves_no_farther_than_it_has_to():
    high = FocusPoint(AtPoint((0.3, 1.8, -4.0)), InFrame(20.0), name="high")
    found = solved(SHARP, high)
    np.testing.assert_allclose(found.camera.project(jnp.array([0.3, 1.8, -4.0]))[0][1], 20.0, atol=1e-9)
    # Across it is inside already, and stays where it is: that is what the wishes leave open.
    assert float(found.camera.shift) == 0.0
    assert found.undetermined == ("shift",)
    assert "leave the shift open" in " ".join(diagnose(found).sentences)
    row = found.table()[1]
    assert (row.relation, row.wished, row.met) == ("in frame", 20.0, True)
    assert row.got == pytest.approx(20.0)
    inside = solved(SHARP, FocusPoint(AtPoint((0.3, 0.8, -4.0)), InFrame(OnSensor(1.0))))
    assert float(inside.camera.rise) == 0.0
    # 240 - 0.8 x 888.9 / 4 pixels from the upper edge.
    assert inside.table()[1].got == pytest.approx(62.2222, abs=1e-3)
    assert inside.table()[1].wished == pytest.approx(17.7778, abs=1e-3)


def test_a_place_out_of_reach_is_as_far_off_as_its_miss():
    """Nothing that is free moves the picture: alone, the place is as far off as with the others."""
    wishes = (SHARP, FocusPoint(AtPoint(TOP), ShownAt(300.0, 100.0), name="top"))
    found = solved(*wishes, shift_range=(0, 0), rise_range=(0, 0))
    off = np.hypot(320 + DENSITY * LENGTH * 0.3 / 4 - 300, 240 - DENSITY * LENGTH * 1.2 / 4 - 100)
    (out,) = diagnose(found).unreachable
    assert out.name == "top"
    np.testing.assert_allclose([out.best, found.table()[1].residual], off, rtol=1e-9)


def test_what_cannot_all_be_in_the_frame_is_shared_and_named():
    ends = [FocusPoint(AtPoint((0.3, y, -4.0)), InFrame(20.0), name=f"at {y}") for y in (1.8, -1.1)]
    found = solved(*ends)
    # 2.9 m are 644.4 px high, of 440 px between the margins; both ends miss by half the rest.
    miss = (DENSITY * LENGTH * 2.9 / 4 - 440) / 2
    np.testing.assert_allclose([row.residual for row in found.table()], -miss, rtol=1e-9)
    conflict = diagnose(found).conflicts[0]
    assert {conflict.first, conflict.second} == {"at 1.8", "at -1.1"}
    assert conflict.first_gains == pytest.approx(miss, rel=1e-6)
    # A zoom finds room for both, and goes no wider than that.
    wider = solved(*ends, **ZOOM)
    np.testing.assert_allclose(wider.camera.focal_length, LENGTH * 440 / 644.444444, rtol=1e-6)
    np.testing.assert_allclose(wider.error, 0, atol=1e-9)


def test_limits_hold():
    top = FocusPoint(AtPoint(TOP), ShownAt(320.0, 100.0), name="top")
    held = solved(SHARP, top, rise_range=(-0.002, 0.002))
    assert held.active_bounds == ("max_rise",)
    np.testing.assert_allclose(held.camera.rise, 0.002, rtol=1e-12)
    assert "The largest rise stands in the way" in " ".join(diagnose(held).sentences)
    with pytest.raises(
        ValueError, match=r"the starting rise in metres is 0.03; expected a value in the rise"
    ):
        solved(SHARP, top, start=camera(rise=0.03))
    with pytest.raises(ValueError, match=r"shift range's end in metres is -0.01; expected a finite length"):
        solved(SHARP, top, shift_range=(0.0, -0.01))


def test_an_expectation_is_a_slide_in_metres():
    rows = prior_rows(checked_priors({"rise": Prior(0.002, sigma=0.0005)}, FREE), FREE, camera())
    np.testing.assert_allclose(rows(jnp.array([0.3, 0.0, 0.001])), [0, 0, -2], rtol=1e-12)


def test_the_solution_follows_the_wishes():
    points = locate((SHARP, FocusPoint(AtPoint(TOP), ShownAt(320.0, 100.0))), camera())

    def slides(xy: jnp.ndarray, target: jnp.ndarray) -> jnp.ndarray:
        moved = dataclasses.replace(points, xy=xy, target=target)
        found = solve(moved, camera(), lens(), free=FREE)
        return jnp.stack([found.camera.shift, found.camera.rise])

    by_place, by_target = jax.jacrev(slides, argnums=(0, 1))(points.xy, points.target)
    # Rows: the sharp point, across, down.
    np.testing.assert_allclose(by_target, np.array([[0, -1, 0], [0, 0, 1]]) / DENSITY, atol=1e-12)
    np.testing.assert_allclose(by_place[0, 1], np.array([1, 0]) / DENSITY, atol=1e-12)
    np.testing.assert_allclose(by_place[1, 2], np.array([0, -1]) / DENSITY, atol=1e-12)


def random_wishes(seed: int) -> list[FocusPoint]:
    rng = np.random.default_rng(seed)

    def place() -> AtPoint:
        depth = rng.uniform(2, 8)
        return AtPoint((*(rng.uniform(-0.5, 0.5, 2) * depth), -depth))

    kinds = [Sharp(), Blur(rng.normal(0, 10), signed=True), InFrame(rng.uniform(0, 60))]
    kinds += [ShownAt(*rng.uniform(0, 480, 2))]
    return [FocusPoint(place(), kind, weight=10.0 ** rng.uniform(-2, 2), even_outside=True) for kind in kinds]


def by_scipy(wishes: list[FocusPoint], limits: dict) -> float:
    """The least cost over focus, focal length, shift and rise, on residuals from the points in the world."""

    def residual(value: np.ndarray) -> np.ndarray:
        focus, length, shift, rise = value * [1, 0.1, 0.01, 0.01]
        rows = []
        for wish in wishes:
            x, y, z = np.asarray(wish.where.position) * [1, 1, -1]
            slide = np.array([length * x / z - shift, rise - length * y / z])
            shown = np.array([WIDTH, HEIGHT]) / 2 + DENSITY * slide
            match wish.wish:
                case ShownAt(u, v):
                    miss = shown - [u, v]
                case InFrame(margin):
                    miss = np.minimum([*(shown - margin), *([WIDTH, HEIGHT] - shown - margin)], 0)
                case _:
                    target = wish.wish.diameter if isinstance(wish.wish, Blur) else 0.0
                    # The f-number stays, so the aperture's radius grows with the length.
                    miss = np.array([2 * DENSITY * length * length / 5.6 * (focus - 1 / z) - target])
            rows.append(np.sqrt(wish.weight) * miss)
        return np.concatenate(rows)

    lower = [0, 0.2, *(100 * limits[name][0] for name in ("shift_range", "rise_range"))]
    upper = [1 / 0.5, 1.0, *(100 * limits[name][1] for name in ("shift_range", "rise_range"))]
    best = min(
        scipy.optimize.least_squares(
            residual,
            [0.3, zoom, 0, 0],
            bounds=(lower, upper),
            method="dogbox",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        ).cost
        for zoom in (0.3, 0.5, 0.8)
    )
    return float(best)


def test_random_problems_are_solved_as_scipy_solves_them():
    """With a zoom, so that blur and framing depend on each other."""
    limits = {"shift_range": (-0.004, 0.006), "rise_range": (-0.003, 0.005), "min_focus_distance": 0.5}
    bounds = set()
    for seed in range(12):
        wishes = random_wishes(seed)
        found = solve(locate(wishes, camera()), camera(), lens(), **ZOOM, **limits)
        # Observed: 4e-15 relative.
        np.testing.assert_allclose(float(found.cost), by_scipy(wishes, limits), rtol=1e-8, atol=1e-9)
        bounds |= set(found.active_bounds)
    assert bounds >= {"min_rise", "max_rise", "max_shift", "min_focal_length"}


DOOR = np.array([(x, y, -4.0) for x in (-0.4, 0.5) for y in (-0.2, 3.0)])
MESH = {"vertices": DOOR, "faces": np.array([(0, 1, 2), (1, 2, 3)]), "objects": {"door": range(2)}}


class TestLocate:
    def test_an_object_is_its_whole_extent_in_the_frame_or_not(self):
        points = locate([FocusPoint(OnObject("door"), InFrame(3.0))], camera(), **MESH)
        scale = DENSITY * LENGTH / 4
        x, y = 320 + scale * np.array([-0.4, 0.5]), 240 - scale * np.array([3.0, -0.2])
        shown = np.where(points.quantity == ACROSS, *points.xy.T)
        np.testing.assert_allclose(shown, [*x, *y], rtol=1e-12)
        np.testing.assert_array_equal(points.relation, [AT_LEAST, AT_MOST, AT_LEAST, AT_MOST])
        np.testing.assert_array_equal(points.quantity, [ACROSS, ACROSS, DOWN, DOWN])
        np.testing.assert_allclose(points.target, [3, 637, 3, 477])
        np.testing.assert_allclose(points.weight, 1.0)
        assert points.notes == ("",)
        middle = locate([FocusPoint(OnObject("door"), ShownAt(9, 8))], camera(), **MESH)
        np.testing.assert_allclose(middle.xy, np.tile([x.mean(), y.mean()], (2, 1)), rtol=1e-12)
        np.testing.assert_allclose(middle.target, [9, 8])

    def test_a_mask_is_its_pixels(self):
        mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
        mask[100:200, 30:45] = True
        points = locate(
            [FocusPoint(OnMask(mask), InFrame())], camera(), disparity_map=np.full((HEIGHT, WIDTH), 0.5)
        )
        shown = np.where(points.quantity == ACROSS, *points.xy.T)
        np.testing.assert_allclose(shown, [30, 45, 100, 200])

    def test_what_is_behind_the_camera_does_not_count(self):
        wishes = [SHARP, FocusPoint(AtPoint((0, 0, 4.0)), InFrame(), name="back")]
        found = solve(locate(wishes, camera()), camera(), lens(), free=FREE)
        row = found.table()[1]
        assert (row.note, row.counts, row.relation) == ("behind the camera", False, "in frame")
        star = locate([FocusPoint(AtInfinity((0.0, 2.0, -1.0)), ShownAt(320, 10))], camera())
        assert star.notes == ("",)

    def test_a_depth_range_is_nowhere(self):
        with pytest.raises(ValueError, match="is a depth range, which is nowhere in the picture"):
            FocusPoint(InDepthRange(1.0, 2.0), InFrame())

    @pytest.mark.parametrize(
        ("make", "message"),
        [
            (lambda: ShownAt(float("nan"), 2.0), "the place to be shown at is"),
            (lambda: InFrame(-1.0), "the frame's margin is -1.0; expected zero"),
        ],
    )
    def test_a_value_that_means_nothing_is_refused(self, make, message):
        with pytest.raises(ValueError, match=message):
            make()


def test_a_focal_surface_refuses_wishes_for_places():
    points = locate([SHARP, FocusPoint(AtPoint(TOP), ShownAt(1.0, 2.0))], camera())
    with pytest.raises(ValueError, match="a wish is for a place in the picture"):
        solve_focal_surface(points, camera(), focal_surface([(1.0, 2.0)], 0.5), lens())
