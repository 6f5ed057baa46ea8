"""From the numbers of wishes to the lens in one compiled, differentiable function."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import focusjax as fj
from focusjax.focus import (
    ArgumentError,
    AtInfinity,
    AtLeast,
    AtMost,
    AtPixel,
    AtPoint,
    Blur,
    FocusPoint,
    InDepthRange,
    InFrame,
    OfHeight,
    OnSensor,
    Sharp,
    ShownAt,
    locate,
    solve,
)

CAMERA = fj.make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
START = fj.thin_lens(focus_distance=3.0, f_number=4.0, focal_length=0.05)
MAP = np.full((480, 640), 0.5)


def at(z, wish, **more):
    return FocusPoint(AtPoint((0.0, 0.0, -z)), wish, **more)


def settings(wishes, free=("focus", "f_number"), **options):
    found = solve(locate(wishes, CAMERA), CAMERA, START, free=free, **options)
    return jnp.stack([found.lens.focus_disparity, 100.0 * found.lens.aperture_radius])


MADE = {
    "blur": (9.0, lambda v: [at(2.0, Sharp()), at(5.0, Blur(v))]),
    "signed blur": (9.0, lambda v: [at(2.0, Sharp()), at(5.0, Blur(-v, signed=True))]),
    "on the sensor": (0.5, lambda v: [at(2.0, Sharp()), at(5.0, Blur(OnSensor(v)))]),
    "of the height": (0.02, lambda v: [at(2.0, Sharp()), at(5.0, Blur(OfHeight(v)))]),
    "at least": (19.0, lambda v: [at(2.0, Sharp()), at(5.0, AtLeast(v))]),
    "at most": (2.0, lambda v: [at(2.0, Sharp()), at(5.0, AtMost(v))]),
    "weight": (0.7, lambda v: [at(2.0, Sharp()), at(4.0, Sharp(), weight=v), at(5.0, Blur(8.0))]),
    "place": (2.3, lambda v: [at(v, Sharp(), even_outside=True, even_hidden=True), at(5.0, Blur(8.0))]),
    "direction": (
        0.1,
        lambda v: [
            at(2.0, Sharp()),
            FocusPoint(AtInfinity((v, v, -1.0)), Blur(9.0), even_outside=True, even_hidden=True),
        ],
    ),
}


@pytest.mark.parametrize("name", MADE)
def test_a_wish_is_differentiated_by(name):
    value, wishes = MADE[name]

    @jax.jit
    def compiled(value):
        return jax.jvp(lambda v: settings(wishes(v)), (value,), (1.0,))

    here, slope = compiled(value)
    np.testing.assert_allclose(here, settings(wishes(value)), rtol=1e-9)
    step = 1e-4 * value
    difference = (compiled(value + step)[0] - compiled(value - step)[0]) / (2 * step)
    # Observed: 4e-8 of the slopes.
    np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-7)
    assert name == "direction" or float(jnp.abs(slope).max()) > 1e-3


def test_where_something_is_shown_is_differentiated_by():
    def shift(x):
        wishes = [at(2.0, ShownAt(x, 240.0)), at(3.0, InFrame(margin=x / 40.0))]
        found = solve(locate(wishes, CAMERA), CAMERA, START, free=("shift",))
        return found.camera.shift

    # The sensor is 36 mm wide for 640 pixels; what stands in the middle goes to the right by that much.
    assert float(jax.jit(jax.grad(shift))(400.0)) == pytest.approx(-0.036 / 640, rel=1e-9)


def test_wishes_about_a_scene_are_differentiated_by():
    """What shows is looked at while the function is compiled."""
    ball = fj.make_object("card", np.array([(-1.0, -1, -2), (1, -1, -2), (0, 1, -2)]), np.array([(0, 1, 2)]))
    scene = fj.make_scene([ball], ambient=1.0)

    def radius(blur):
        wishes = [FocusPoint(fj.OnObject("card"), Sharp()), FocusPoint(AtPixel(2.5, 2.5), Blur(blur))]
        found = solve(fj.find_points(wishes, scene, CAMERA), CAMERA, START, free=("focus", "f_number"))
        return found.lens.aperture_radius

    slope = float(jax.jit(jax.grad(radius))(12.0))
    # The corner is background: blur 2 f E (1/2 - 0) with the card in focus.
    assert slope == pytest.approx(1.0 / (2.0 * float(CAMERA.focal_px) * 0.5), rel=1e-6)


def test_tolerances_may_be_traced():
    met = jax.jit(
        lambda tolerance: (
            solve(
                locate([at(2.0, Sharp(), tolerance=tolerance), at(4.0, Sharp())], CAMERA), CAMERA, START
            ).met
        )
    )
    assert met(100.0).tolist() == [True, False]


def test_what_has_to_be_known_is_reported():
    def place(z):
        return locate([at(z, Sharp())], CAMERA, disparity_map=MAP).disparity

    with pytest.raises(ArgumentError, match=r"'point 1' has a place that is traced .* count even_outside"):
        jax.jit(place)(2.0)
    with pytest.raises(ValueError, match="start is traced by JAX, but has to be known"):
        jax.jit(lambda z: FocusPoint(InDepthRange(z, 2.0 * z), Sharp()) and z)(2.0)
    with pytest.raises(ArgumentError, match=r"camera of locate.* is traced by JAX, but has to be known"):
        jax.jit(lambda camera: locate([at(2.0, Sharp())], camera).xy)(CAMERA)
    with pytest.raises(ValueError, match="expected a number of pixels"):
        jax.jit(lambda px: Blur(px) and px)(jnp.zeros(2))


def test_bad_traced_values_are_refused_when_they_come():
    radius = jax.jit(lambda px: settings([at(2.0, Sharp()), at(5.0, Blur(px))]))
    with pytest.raises(Exception, match="wished blur is out of range"):
        radius(-3.0).block_until_ready()
