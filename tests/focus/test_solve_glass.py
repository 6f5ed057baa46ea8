"""Wishes through glass: what is reported is what the picture has, at the best settings, with derivatives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import patch

import focusjax as fj
from focusjax.focus import ArgumentError, ImagePoints

CAMERA = fj.look_at((0, 0, 0), (0, 0, -1), width=240, height=160, focal_length=0.05)
NEAR, FAR = (0.06, 0.03, -0.8), (-0.1488, 0.048, -1.6)


@pytest.fixture(scope="module")
def glass():
    return fj.prescription_lens(fj.lens_preset("gauss_jp62087922_f1.8_1987"), CAMERA, focus_distance=2.0)


def start(f_number=2.0):
    return fj.thin_lens(focus_distance=2.0, f_number=f_number, focal_length=0.05)


def wished(*wishes) -> ImagePoints:
    named = [
        fj.FocusPoint(fj.AtPoint(place), wish, name=name)
        for (place, wish), name in zip(wishes, "abc", strict=False)
    ]
    return fj.locate(named, CAMERA)


def spread(lens) -> float:
    """Mean square distance in px^2, from its middle, of what a picture has of a square about FAR."""
    (x, y), disparity = fj.locate([fj.FocusPoint(fj.AtPoint(FAR), fj.Sharp())], CAMERA).xy[0], -1 / FAR[2]
    square = patch("square", CAMERA, [float(at) for at in (x - 2, y - 2, x + 2, y + 2)], disparity)
    layers = fj.peel(fj.make_scene([square], unlit=True), CAMERA, lens)
    # Denoising would spread it farther.
    image = np.asarray(fj.render(layers, lens, rays=64, smooth=False))[..., 0]
    places = np.stack(np.meshgrid(np.arange(240), np.arange(160)), axis=-1)
    share = image / image.sum()
    middle = np.tensordot(share, places, 2)
    return float((share * ((places - middle) ** 2).sum(axis=-1)).sum())


def test_what_is_reported_is_what_the_picture_has(glass):
    """What a lens in focus has of the square is the square's own, its samples' and the pixels'."""
    solution = fj.solve(wished((NEAR, fj.Sharp()), (FAR, fj.Blur(7.0))), CAMERA, start(), through=glass)
    reported = np.asarray(solution.blur)
    # The one focus does not meet both.
    assert reported[0] > 0.5
    thin = fj.thin_lens(focus_distance=0.74, f_number=2.0, focal_length=0.05)
    sharp = spread(dataclasses.replace(thin, focus_disparity=jnp.array(-1 / FAR[2])))
    seen, known = (np.sqrt(8.0 * (spread(lens) - sharp)) for lens in (solution.glass, thin))
    # Of an ideal lens the diameter of the circle of confusion, 8.33 px per dioptre.
    assert known == pytest.approx(25 / 3 * (1 / 0.74 - 0.625), abs=0.2)
    assert reported[1] == pytest.approx(seen, abs=0.2)
    assert float(solution.glass.focus_distance()) == pytest.approx(float(solution.lens.focus_distance()))


def test_no_focus_beside_it_is_better(glass):
    points = wished((NEAR, fj.Sharp()), (FAR, fj.Blur(7.0)))
    solution = fj.solve(points, CAMERA, start(), through=glass)
    focus = float(solution.lens.focus_disparity)
    costs = []
    for step in (-0.01, 0.01):
        limits = {
            "min_focus_distance": 1 / (focus + step + 1e-9),
            "max_focus_distance": 1 / (focus + step - 1e-9),
        }
        held = fj.solve(points, CAMERA, start(), through=glass, **limits)
        costs.append(float(held.cost))
    assert min(costs) > float(solution.cost)


def test_focus_and_f_number_meet_two_wishes_and_stopped_down_glass_is_nearly_ideal(glass):
    points = wished((NEAR, fj.Sharp()), (FAR, fj.Blur(1.0)))
    free = ("focus", "f_number")
    found = fj.solve(points, CAMERA, start(), through=glass, free=free)
    thin = fj.solve(points, CAMERA, start(), free=free)
    assert all(row.met for row in found.table())
    assert found.glass.f_number(CAMERA) == pytest.approx(float(found.lens.f_number(CAMERA)))
    # Both stop down to about f/13. Observed: 3 % and 0.6 % apart.
    assert float(found.lens.f_number(CAMERA)) == pytest.approx(float(thin.lens.f_number(CAMERA)), rel=0.06)
    assert float(found.lens.focus_disparity) == pytest.approx(float(thin.lens.focus_disparity), rel=0.02)


def test_the_glass_opens_no_farther_than_it_goes(glass):
    points = wished((NEAR, fj.Sharp()), (FAR, fj.Blur(40.0)))
    found = fj.solve(points, CAMERA, start(), through=glass, free=("focus", "f_number"))
    assert found.active_bounds == ("min_f_number",)
    assert float(found.lens.f_number(CAMERA)) == pytest.approx(float(glass.f_number(CAMERA)), rel=1e-6)
    assert any("widest aperture" in sentence for sentence in fj.diagnose(found).sentences)


def test_limits_and_equal_blurs(glass):
    points = wished((NEAR, fj.SameBlur("b")), (FAR, fj.AtMost(6.0)))
    found = fj.solve(points, CAMERA, start(), through=glass)
    near, far = np.abs(np.asarray(found.blur))
    assert near == pytest.approx(far, abs=1e-3)
    assert far < 6.0
    assert np.abs(np.asarray(found.error)).max() < 1e-3


def test_derivatives_are_those_of_solving_again(glass):
    points = wished((NEAR, fj.Sharp()), (FAR, fj.Blur(7.0)))

    def focus(disparity):
        moved = dataclasses.replace(points, disparity=points.disparity.at[0].set(disparity))
        return fj.solve(moved, CAMERA, start(), through=glass).lens.focus_disparity

    at, step = points.disparity[0], 1e-4
    _, slope = jax.jvp(focus, (at,), (jnp.ones_like(at),))
    apart = (float(focus(at + step)) - float(focus(at - step))) / (2 * step)
    # Observed: 0.5067 and 0.4987, 1.6 % apart.
    assert float(slope) == pytest.approx(apart, rel=0.03)


@pytest.mark.parametrize(
    ("lens", "options", "message"),
    [
        (start(1.4), {}, "the starting f-number is 1.4, and the glass is open to f/1.84"),
        (start(), {"free": ("focus", "shift")}, "free has 'shift', which is not solved for through glass"),
    ],
)
def test_what_glass_cannot_do_is_refused(glass, lens, options, message):
    points = wished((NEAR, fj.Sharp()))
    with pytest.raises(ArgumentError) as caught:
        fj.solve(points, CAMERA, lens, **{"through": glass} | options)
    assert message in str(caught.value)


def test_glass_focuses_no_nearer_than_its_front_focal_point():
    glass = fj.prescription_lens(fj.lens_preset("cooke_triplet_50mm_f4"), CAMERA, focus_distance=2.0)
    with pytest.raises(ArgumentError) as caught:
        fj.solve(wished((NEAR, fj.Sharp())), CAMERA, start(4.0), through=glass, min_focus_distance=0.051)
    # 15.01 mm to the entrance pupil and 36.91 mm to the focal point of 49.875 mm, scaled to 50 mm.
    expected = "the glass focuses no nearer than 0.0521 m from its entrance pupil; raise it"
    assert expected in str(caught.value)
