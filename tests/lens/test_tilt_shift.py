"""The tilt-shift lens is what a tilted thin lens in front of a sensor does, in a photographer's terms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import check_gradients
from tilted_thin_lens import TracedLens

from focusjax.geometry import Camera, look_at, make_camera
from focusjax.lens import (
    ThinLens,
    TiltShiftLens,
    as_tilt_shift,
    focal_plane_through,
    lens_for_plane,
    movements_of,
    thin_lens,
    tilt_back,
    tilt_shift_lens,
)

DEGREE = np.pi / 180
LENGTH = 0.09
LENSES = {
    "forward tilt": (2.0, 8.0, 0.0),
    "backward tilt, right swing": (3.0, -5.0, 7.0),
    "strong tilt, left swing": (0.7, 25.0, -20.0),
    "plane parallel to the view axis": (np.inf, 8.0, 0.0),
    "not tilted": (1.5, 0.0, 0.0),
}
every_setting = pytest.mark.parametrize(
    ("distance", "tilt", "swing"), [pytest.param(*values, id=name) for name, values in LENSES.items()]
)


def frame(length: float = LENGTH, **slide: float) -> Camera:
    """A 4 x 5 camera, 100 pixels wide, looking along -z."""
    size = {"width": 100, "height": 80, "sensor_width": 0.12}
    return make_camera(np.eye(4), focal_length=length, **size, **slide)


def made(distance: float, tilt: float, swing: float, f_number: float = 2.0, **more) -> TiltShiftLens:
    """The lens for angles in degrees."""
    angles = {"tilt": tilt * DEGREE, "swing": swing * DEGREE}
    values = {"focus_distance": distance, "focal_length": LENGTH, "f_number": f_number, **angles}
    return tilt_shift_lens(**(values | more))


def traced(distance: float, tilt: float, swing: float) -> TracedLens:
    """The same lens in glass: its axis, and the sensor where the lens equation puts it."""
    t, s = tilt * DEGREE, swing * DEGREE
    axis = np.array([np.cos(t) * np.sin(s), -np.sin(t), np.cos(t) * np.cos(s)])
    # An object at `distance` along Z is distance * axis_z ahead along the axis, its image 1 / (1/F - 1/that).
    image = 1.0 / (1.0 / LENGTH - 1.0 / (distance * axis[2]))
    return TracedLens(axis, LENGTH, image / axis[2])


FILMS = [(50.0, 40.0), (3.0, 70.0), (90.0, 12.0)]


@every_setting
@pytest.mark.parametrize("film", FILMS)
def test_it_is_the_tilted_thin_lens_traced_exactly(distance: float, tilt: float, swing: float, film):
    """All rays of a film point meet in one point of the plane, and are the rays (a, b) of the lens."""
    camera, lens, glass = frame(), made(distance, tilt, swing), traced(distance, tilt, swing)
    f, radius = float(camera.focal_px), float(lens.aperture_radius)
    away = (np.array(film) - np.asarray(camera.principal_point)) / f
    pupil = glass.opening(radius)
    direction = glass.from_film(away * [1, -1], pupil)
    plane = np.asarray(lens.plane)
    # Where each ray meets the plane, as a place in the picture and a disparity, so that infinity is one too.
    nearness = (direction @ plane) / (1.0 - pupil @ plane)
    disparity = nearness / (pupil[:, 2] * nearness + direction[:, 2])
    expected = plane @ [*(away * [1, -1]), 1.0]
    # Observed: 2e-15 1/m.
    np.testing.assert_allclose(disparity, expected, rtol=0, atol=2e-14)
    seen = pupil[:, :2] * disparity[:, None] + _slopes(direction) * (1 - pupil[:, 2:] * disparity[:, None])
    # Observed: 3e-14 pixels, of all rays from the same film point.
    every_ray = np.broadcast_to(f * away, seen.shape)
    np.testing.assert_allclose(f * seen * [1, -1], every_ray, rtol=0, atol=2e-13)

    turned = _in_lens_axes(glass.axis, pupil) / radius
    rays = jax.vmap(lambda v: lens.ray(camera, jnp.array(film), v))(jnp.array(turned))
    crossing = pupil[:, :2] - pupil[:, 2:] * _slopes(direction)
    # Observed: 7e-16 pixels per dioptre, and 2e-14 pixels.
    np.testing.assert_allclose(rays.b, f * crossing * [1, -1], rtol=0, atol=7e-15)
    far = np.asarray(camera.principal_point) + f * _slopes(direction) * [1, -1]
    np.testing.assert_allclose(rays.a, far, rtol=0, atol=2e-13)


def _slopes(direction: np.ndarray) -> np.ndarray:
    return direction[:, :2] / direction[:, 2:]


def _in_lens_axes(axis: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points of the opening [n, 2] (x right, y down) after the smallest turn that makes the axis upright."""
    fold = np.outer(axis[:2], axis[:2]) / (1 + axis[2])
    turn = np.concatenate([np.eye(2) - fold, -axis[None, :2]])
    return points @ turn * [1, -1]


@pytest.mark.parametrize("tilt", [2.0, 4.0, 8.0])
def test_an_upright_opening_would_differ_in_the_first_order_of_the_tilt(tilt: float):
    """By E sin(t) times (x, y) and E w_f; across the hinge only, where the view is off the axis."""
    camera, lens = frame(), made(2.0, tilt, 0.0)
    film = jnp.array([80.0, 70.0])
    angle = jnp.linspace(0.0, 2 * jnp.pi, 25)
    pupil = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    rays = jax.vmap(lambda v: lens.ray(camera, film, v))(pupil)
    reach = float(camera.focal_px * lens.aperture_radius)
    off = np.linalg.norm(np.asarray(rays.b) - reach * np.asarray(pupil), axis=1).max() / reach
    x, y = (np.asarray(film) - np.asarray(camera.principal_point)) / float(camera.focal_px)
    sharp = float(lens.focal_disparity(camera, film))
    derived = np.sin(tilt * DEGREE) * (np.hypot(x, y) + float(lens.aperture_radius) * sharp)
    # Observed: 0.0197, 0.0387 and 0.0747 of the blur's radius for 2, 4 and 8 degrees: 0.97, 0.95 and 0.91
    # of what is derived.
    assert 0.8 * derived < off < derived + np.sin(tilt * DEGREE) ** 2


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
@pytest.mark.parametrize(("tilt", "slant"), [(8.0, 80.0), (3.0, 45.0), (15.0, 90.0), (1.0, 100.0)])
def test_merklinger(tilt: float, slant: float, precision):
    """J = f / sin(tilt); film at A = f sin(slant) / sin(slant - tilt); plane on the axis at D = J tan(slant).

    `slant` is the angle between the film and the plane in focus, which meets the lens's own plane parallel
    to the film J below the lens.
    """
    hinge = LENGTH / np.sin(tilt * DEGREE)
    film = LENGTH * np.sin(slant * DEGREE) / np.sin((slant - tilt) * DEGREE)
    normal = np.array([0.0, -np.sin(slant * DEGREE), np.cos(slant * DEGREE)])
    plane = focal_plane_through((0.0, -hinge, 0.0), normal)
    lens = lens_for_plane(plane, frame(), f_number=8)
    # Observed: 6e-17 1/m.
    expected = 1 / (hinge * np.tan(slant * DEGREE))
    assert float(lens.focus_disparity) == pytest.approx(expected, rel=0, abs=6e-16)
    found = movements_of(lens.plane.astype(precision), frame().focal_length.astype(precision))
    # Observed: 2e-16 relative in float64; 1.4e-7 in float32.
    tolerance = 2e-15 if precision == jnp.float64 else 1e-6
    assert float(found.hinge_distance) == pytest.approx(hinge, rel=tolerance, abs=0)
    assert float(found.image_distance) == pytest.approx(film, rel=tolerance, abs=0)
    assert float(found.tilt) == pytest.approx(tilt * DEGREE, rel=tolerance, abs=0)
    assert float(found.swing) == 0.0


def test_the_tables_of_a_90_mm_lens():
    """Merklinger's J: 90 mm at 8 degrees 647 mm, at 1 degree 5.16 m."""
    for tilt, hinge in ((8.0, 0.6467), (1.0, 5.157), (2.0, 2.579)):
        found = made(5.0, tilt, 0.0).movements(frame())
        # Observed: 1.7e-4 m, by which the tables are rounded.
        assert float(found.hinge_distance) == pytest.approx(hinge, abs=5e-4)


def test_focusing_turns_the_plane_about_the_hinge():
    """All planes for one tilt, and all planes of one blur, hold the same line below the lens."""
    hinge = np.array([0.0, -LENGTH / np.sin(8 * DEGREE), 0.0])
    for distance in (0.4, 1.0, 5.0, np.inf):
        lens = made(distance, 8.0, 0.0)
        for along in (-3.0, 0.0, 2.0):
            # Observed: exactly 1.
            there = np.asarray(lens.plane) @ (hinge + np.array([along, 0, 0]))
            assert there == pytest.approx(1.0, rel=0, abs=1e-15)


def test_settings_come_back_from_the_plane():
    for distance, tilt, swing in LENSES.values():
        found = made(distance, tilt, swing).movements(frame())
        # Observed: 6e-17 and 1.4e-17 rad.
        assert float(found.tilt) == pytest.approx(tilt * DEGREE, rel=0, abs=5e-16)
        assert float(found.swing) == pytest.approx(swing * DEGREE, rel=0, abs=5e-16)
        # Observed: equal, and 2e-16 relative.
        assert float(found.focus_distance) == pytest.approx(distance, rel=1e-15, abs=0)
        assert float(found.image_distance) == pytest.approx(
            traced(distance, tilt, swing).sensor, rel=2e-15, abs=0
        )


def test_positive_tilt_is_sharp_near_below_and_positive_swing_near_to_the_right():
    camera = frame()
    down, up = jnp.array([50.0, 75.0]), jnp.array([50.0, 5.0])
    right, left = jnp.array([95.0, 40.0]), jnp.array([5.0, 40.0])
    tilted, swung = made(2.0, 5.0, 0.0), made(2.0, 0.0, 5.0)
    assert tilted.focal_disparity(camera, down) > 0.5 > tilted.focal_disparity(camera, up)
    assert swung.focal_disparity(camera, right) > 0.5 > swung.focal_disparity(camera, left)
    # Something 2 m away is behind the focus where that is nearer.
    assert tilted.blur(camera, down, jnp.array(0.5)) > 0 > tilted.blur(camera, up, jnp.array(0.5))


def test_without_tilt_it_is_the_thin_lens():
    camera = frame()
    thin = thin_lens(focus_distance=1.3, focal_length=LENGTH, f_number=2.0)
    film, pupil, w = jnp.array([12.0, 70.0]), jnp.array([0.3, -0.8]), jnp.array(0.2)
    for lens in (made(1.3, 0.0, 0.0), as_tilt_shift(thin)):
        ours, theirs = lens.ray(camera, film, pupil), thin.ray(camera, film, pupil)
        # Observed: 1.6e-16 relative in b, all else equal.
        np.testing.assert_allclose(ours.b, theirs.b, rtol=1e-15)
        np.testing.assert_allclose(ours.a, theirs.a, rtol=1e-15)
        assert float(lens.blur(camera, film, w)) == pytest.approx(
            float(thin.blur(camera, film, w)), rel=1e-15, abs=0
        )
        assert float(lens.parallax(camera)) == float(thin.parallax(camera))
        assert float(lens.focus_distance()) == pytest.approx(float(thin.focus_distance()), rel=1e-15, abs=0)
        assert float(lens.f_number(camera)) == pytest.approx(2.0, rel=1e-15, abs=0)
    assert as_tilt_shift(made(1.3, 3.0, 0.0)).plane[1] != 0


@eqx.filter_jit
def knobs(plane, camera):
    return eqx.filter(movements_of(plane, camera.focal_length), eqx.is_array)


def test_gradients_of_the_movements_and_of_the_back():
    # Observed: 6e-10 and 2.5e-9 of the largest.
    check_gradients(knobs, jnp.array([0.8, -1.1, 0.4]), frame(), rtol=2e-8)
    check_gradients(tilt_back, frame(), made(2.0, 8.0, -3.0), rtol=2e-8)


@pytest.mark.parametrize(("distance", "tilt", "swing"), [(2.0, 8.0, 0.0), (1.0, -6.0, 9.0)])
def test_a_tilted_back_focuses_on_the_same_plane_of_the_world(distance, tilt, swing):
    """The sensor lies where the level lens images the plane, and world points on it are sharp."""
    camera, lens = frame(), made(distance, tilt, swing)
    turned, same = tilt_back(camera, lens)
    # Images of three points of the plane by the level lens's equation: the sensor goes through them.
    points = np.array([(0.1, 0.1), (-0.3, 0.2), (0.2, -0.4)])
    depth = (1 - points @ np.asarray(lens.plane[:2])) / float(lens.plane[2])
    places = np.column_stack([points, depth])
    images = -places * LENGTH / (places[:, 2:] - LENGTH)
    normal = np.cross(images[1] - images[0], images[2] - images[0])
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    mirror = np.array([1, 1, -1])
    view = -np.asarray(turned.world_from_camera[:3, 2]) * mirror
    # Observed: 4e-16, and 1.4e-16 relative.
    np.testing.assert_allclose(view, normal, rtol=0, atol=4e-15)
    assert float(same.movements(turned).image_distance) == pytest.approx(
        -images[0] @ normal, rel=1.5e-15, abs=0
    )
    # The lens is level: its axis in the world is as it was, and on the same pixel.
    axis = np.append(float(turned.focal_length) * np.asarray(same.plane[:2]), 0.0)
    axis[2] = np.sqrt(1 - axis @ axis)
    # Observed: 2e-16, and the same pixel to the bit.
    level = turned.world_from_camera[:3, :3] @ (axis * mirror)
    np.testing.assert_allclose(level, [0, 0, -1], rtol=0, atol=2e-15)
    seen, _ = turned.project(jnp.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(seen, camera.principal_point, rtol=0, atol=5e-14)
    for place in places * mirror:
        xy, w = turned.project(jnp.array(place))
        # Observed: 6e-16 pixels.
        assert float(same.blur(turned, xy, w)) == pytest.approx(0.0, abs=6e-15)


def test_rise_and_shift_move_the_frame_without_changing_perspective():
    """Everything moves by the same pixels, uprights stay upright, and what is sharp stays sharp."""
    still, slid = frame(), frame(rise=0.012, shift=-0.006)
    lens = made(2.0, 8.0, 0.0)
    places = jnp.array([(0.3, 1.0, -4.0), (0.3, -1.0, -4.0), (-1.0, 0.2, -9.0)])
    before, w = jax.vmap(still.project)(places)
    after, _ = jax.vmap(slid.project)(places)
    # Up by 10 pixels of sensor: things are lower in the picture. Left by 5: they are more to the right.
    # Observed: exact, as are the blurs.
    np.testing.assert_allclose(after - before, np.broadcast_to([5.0, 10.0], (3, 2)), rtol=0, atol=1e-13)
    blurs = [
        jax.vmap(lambda p, d, c=c: lens.blur(c, p, d))(xy, w) for c, xy in ((still, before), (slid, after))
    ]
    np.testing.assert_allclose(*blurs, rtol=0, atol=1e-13)
    with pytest.raises(ValueError, match="rise is nan m; expected a finite length"):
        look_at((0, 0, 1), (0, 0, 0), width=4, height=3, focal_length=0.05, rise=float("nan"))


HARD = {
    "600 mm": (0.6, 20.0, 2.0, 6.0),
    "phone, 2 mm": (0.002, 0.3, 2.2, 6.0),
    "f 0.5": (0.05, 1.0, 0.5, 10.0),
    "scene of 1 mm": (0.0004, 0.001, 4.0, 5.0),
    "scene of 10 km": (0.05, 1e4, 2.0, 0.4),
}


@pytest.mark.parametrize("precision", [jnp.float64, jnp.float32])
@pytest.mark.parametrize(("length", "distance", "f_number", "tilt"), HARD.values(), ids=HARD)
def test_hard_lenses_keep_their_plane(length, distance, f_number, tilt, precision):
    """Movements come back and rays of a film point meet, in both precisions."""
    size = {"width": 100, "height": 80, "sensor_width": 1.2 * length}
    camera = make_camera(np.eye(4), focal_length=length, **size)
    lens = made(distance, tilt, -tilt / 2, f_number, focal_length=length)
    lens, camera = jax.tree.map(lambda a: a.astype(precision), (lens, camera))
    found = lens.movements(camera)
    # Observed: 2e-16 relative in float64, 1e-7 in float32.
    tolerance = 2e-15 if precision == jnp.float64 else 1e-6
    assert float(found.tilt) == pytest.approx(tilt * DEGREE, rel=tolerance, abs=0)
    assert float(found.focus_distance) == pytest.approx(distance, rel=tolerance, abs=0)
    film = jnp.array([88.0, 9.0], dtype=precision)
    sharp = lens.focal_disparity(camera, film)
    for v in ((1.0, 0.0), (-0.6, 0.8), (0.0, -1.0)):
        met = lens.ray(camera, film, jnp.array(v, dtype=precision)).at(sharp)
        # Observed: the film point to the bit; a step of rounding there is 1.4e-14 and 8e-6 pixels.
        np.testing.assert_allclose(met, film, rtol=0, atol=5e-14 if precision == jnp.float64 else 3e-5)
        assert bool(jnp.isfinite(lens.parallax(camera)))


GOOD = {"focus_distance": 2.0, "focal_length": 0.05, "f_number": 2.0, "tilt": 0.1}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tilt": 1.6}, r"tilt is 1\.6 rad; expected an angle between -pi/2 and pi/2"),
        ({"swing": np.nan}, "swing is nan rad; expected an angle between"),
        (
            {"tilt": 0.9},
            r"takes a tilt of 51\.57 degrees in all; the limit is 45, so use a shorter focal length",
        ),
        ({"tilt": 0.2, "max_tilt": 0.15}, r"takes a tilt of 11\.46 degrees in all; the limit is 8\.594"),
        ({"max_tilt": 1.6}, r"the tilt limit is 1\.6 rad; expected 0 up to less than pi/2"),
        ({"focus_distance": 0.0501, "tilt": 0.5}, r"meets the view axis at 0\.0501 m, within 0\.05697 m"),
        ({"focus_distance": 0.04}, r"focus distance 0\.04 m is within the focal length"),
        ({"f_number": None}, "give exactly one of f-number and aperture radius"),
    ],
)
def test_bad_settings_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        tilt_shift_lens(**{**GOOD, **changes})


@pytest.mark.parametrize(
    ("plane", "message"),
    [
        pytest.param((0.0, -30.0, 0.5), r"hinge at 0\.03333 m, within the focal", id="near centre"),
        pytest.param((0.0, -9.0, 0.5), "takes a tilt of 54.1 degrees in all", id="steep"),
        pytest.param((0.0, 0.0, 20.0), r"meets the view axis at 0\.05 m, within 0\.09 m", id="close"),
        pytest.param((0.0, 0.1, -1.0), "behind the lens all over the frame", id="behind"),
        pytest.param((0.0, np.nan, 1.0), "expected three finite numbers", id="not finite"),
    ],
)
def test_planes_out_of_reach_are_refused(plane, message):
    with pytest.raises(ValueError, match=message):
        lens_for_plane(jnp.array(plane), frame(), f_number=4)


def test_a_plane_through_the_lens_centre_is_refused():
    with pytest.raises(ValueError, match="contains the lens centre; it is seen edge-on and no lens can"):
        focal_plane_through((0.0, 0.0, 3.0), (0.0, 1.0, 0.0))
    with pytest.raises(ValueError, match=r"the plane's normal is .*; expected three finite numbers"):
        focal_plane_through((0.0, 0.0, 3.0), (0.0, np.inf, 0.0))


def test_plane_parallel_to_the_view_axis():
    """A floor 1.5 m below the lens: sharp from the feet to the horizon, by a tilt of asin(F / 1.5 m)."""
    camera = frame()
    lens = lens_for_plane(focal_plane_through((0, -1.5, 4), (0, 1, 0)), camera, f_number=4)
    assert np.isinf(lens.focus_distance())
    # Observed: 1.2e-16 relative.
    assert float(lens.movements(camera).tilt) == pytest.approx(np.arcsin(LENGTH / 1.5), rel=1e-15, abs=0)
    for depth in (4.0, 40.0, 4e6):
        xy, w = camera.project(jnp.array([0.7, -1.5, -depth]))
        # Observed: 7e-19 pixels.
        assert float(lens.blur(camera, xy, w)) == pytest.approx(0.0, abs=1e-16)
    assert isinstance(as_tilt_shift(ThinLens(jnp.array(0.0), jnp.array(0.1))), TiltShiftLens)
