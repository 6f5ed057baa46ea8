"""Pictures of what moves, against closed forms and the mean of many sharp times."""

import dataclasses
import re

import numpy as np
import pytest
from compilations import compilations
from small_scenes import at_pixels, ball, front_camera, patch, wide_lens

from focusjax.layers import _memory, peel
from focusjax.lens import thin_lens
from focusjax.metrics import psnr
from focusjax.scene import constant_background, make_object, make_scene
from focusjax.shot import Motion, MovingScene, VertexSequence, transforms
from focusjax.shutter import make_shutter, render_moving
from focusjax.trace import render

CAMERA = front_camera()
PINHOLE = thin_lens(focus_distance=2.0, aperture_radius=0.0)
SECOND = make_shutter(1.0)
"""Times are in seconds here: a frame a second, around frame 1."""


def peeled(scene, camera, lens, like):
    return peel(scene, camera, lens, supersampling=1, like=like)


def taken(world, camera=CAMERA, lens=PINHOLE, shutter=SECOND, **options):
    return render_moving(world, camera, lens, shutter, fps=1.0, make=peeled, **{"rays": 64, **options})


@pytest.fixture(scope="module")
def card():
    """A white card over columns 8 to 14 in front of black, 2 m away, that moves by 12 px a second."""
    white = patch("card", CAMERA, (8, -30, 14, 60), 0.5)
    scene = make_scene([white], background=constant_background(0.0), unlit=True)
    pixels_per_metre = 0.5 * float(CAMERA.focal_px)
    keys = {0.0: {}, 2.0: {"translate": (24 / pixels_per_metre, 0, 0)}}
    return MovingScene(scene, [white], {"card": Motion(transforms=transforms(keys, between="linear"))})


def swept(left, right, shares):
    """How much of the light columns get of a card between `left` and `right`, whose edges are at `shares`."""
    edges = np.arange(CAMERA.width + 1.0)
    covered = [
        np.clip(np.minimum(edges[1:], right + at) - np.maximum(edges[:-1], left + at), 0, None)
        for at in shares
    ]
    return np.mean(covered, axis=0)


def test_a_moving_card_leaves_the_ramps_that_it_should(card):
    """Half a second before and after frame 1 the card goes from 6 to 18 px from where it was at first."""
    picture = taken(card)
    wanted = swept(8, 14, np.linspace(6, 18, 2001))
    image = np.asarray(picture.image)
    # Observed 0.0065 and, of single pixels, 0.031: noise of 64 rays, of which 5 cross each edge.
    assert np.abs(image.mean(axis=(0, 2)) - wanted).max() < 0.015
    assert np.abs(image - wanted[None, :, None]).max() < 0.15
    assert (picture.spans, picture.peels) == (1, 2)
    assert picture.motion_px == pytest.approx(12.0)
    assert picture.complete
    # Columns 14 to 32 and what is beside them; the others see the background alone.
    assert image[:, :11].max() == 0.0
    assert 0.5 < picture.changing < 0.85


@pytest.mark.slow
def test_what_moves_out_of_focus_takes_few_rays(card):
    """Blurred over 16 px, it is smoothed as what stands still; many rays leave nothing to smooth."""
    lens = wide_lens(CAMERA, pixels_per_dioptre=16.0, focus=1.0)
    many = (taken(card, lens=lens, rays=512, smooth=False, seed=seed).image for seed in (1, 2))
    truth = np.mean([np.asarray(image) for image in many], axis=0)
    rough, smooth = (
        psnr(np.asarray(taken(card, lens=lens, rays=8, smooth=smooth).image), truth)
        for smooth in (False, True)
    )
    # Observed 22.2 and 33.4 dB.
    assert smooth > rough + 6.0


@pytest.mark.parametrize("radiance", [3.0, 0.03])
@pytest.mark.slow
def test_highlights_beside_what_moves_leave_no_seam(radiance):
    """A blurred one lies across the border between pixels with times and those without."""
    lamp = patch("lamp", CAMERA, (14, 9, 18, 13), 0.1, (radiance,) * 3)
    wall = patch("wall", CAMERA, (-40, -40, 80, 80), 0.09, (0.02,) * 3)
    card = patch("card", CAMERA, (1, -30, 4, 60), 0.95, (0.05,) * 3)
    keys = {0.0: {}, 2.0: {"translate": (12 / (0.95 * float(CAMERA.focal_px)), 0, 0)}}
    moves = {"card": Motion(transforms=transforms(keys, between="linear"))}
    world = MovingScene(make_scene([lamp, wall, card], unlit=True), [lamp, wall, card], moves)
    lens = wide_lens(CAMERA, pixels_per_dioptre=10.0, focus=1.0)
    truth = np.asarray(taken(world, lens=lens, rays=2048, smooth=False).image)
    rough, smooth = (taken(world, lens=lens, rays=8, smooth=smooth) for smooth in (False, True))
    # Observed 36.3 and 36.3 dB, for the bright one has rays of its own, and 58.5 and 58.9 dB.
    gain = psnr(smooth.image, truth) - psnr(rough.image, truth)
    assert gain > (0.2 if radiance < 1 else -0.1)
    seam = round(smooth.changing * CAMERA.width)
    assert 0 < seam < CAMERA.width
    more = [np.asarray(taken(world, lens=lens, rays=8, seed=seed).image) for seed in range(4)]
    off = np.abs((np.mean(more, axis=0) - truth).mean(axis=(0, 2)))
    # Observed: 0.10 and 0.06 times.
    assert off[seam - 1 : seam + 1].max() < np.delete(off, [seam - 1, seam]).max()


def test_shutter_curves_and_rolling_shutters_do_what_they_say(card):
    ramped = np.asarray(taken(card, shutter=make_shutter(0.5, ramp=1.0)).image)
    light = make_shutter(0.5, ramp=1.0).quantiles()
    wanted = swept(8, 14, 12 + 12 * 0.5 * (light[1:] + light[:-1]))
    # Observed 0.011.
    assert np.abs(ramped.mean(axis=(0, 2)) - wanted).max() < 0.02
    for direction, sign in (("down", 1.0), ("up", -1.0)):
        shutter = make_shutter(1 / 12, travel_time=1.0, direction=direction)
        rolling = np.asarray(taken(card, shutter=shutter).image)[..., 0]
        for row in (0, 11, 23):
            late = sign * 12.0 * ((row + 0.5) / CAMERA.height - 0.5)
            # Observed 0.032, and 0.048 with four seeds: three of 64 rays, of those through the card's edge.
            np.testing.assert_allclose(
                rolling[row], swept(8, 14, 12 + late + np.linspace(-0.5, 0.5, 99)), atol=0.06
            )


@pytest.fixture(scope="module")
def light():
    """A light 2 px wide, 12 times as bright as white, that goes 26 px in 2 s, from columns 2 and 3 on."""
    lamp = patch("lamp", CAMERA, (2, -30, 4, 60), 0.5, (12.0, 12.0, 12.0))
    scene = make_scene([lamp], background=constant_background(0.0), unlit=True)
    keys = {0.0: {}, 2.0: {"translate": (26 / (0.5 * float(CAMERA.focal_px)), 0, 0)}}
    return MovingScene(scene, [lamp], {"lamp": Motion(transforms=transforms(keys, between="linear"))})


@pytest.mark.parametrize("ramp", [0.0, 0.5, 1.0], ids=["box", "ramp", "triangle"])
def test_a_light_trail_is_as_bright_along_its_way_as_its_shutter_was_open(light, ramp):
    """At 13 px a second a light of width d adds radiance d / (13 T) while the shutter is open.

    The share of the time's light that fell by s, for a shutter that opens and closes in shares `ramp` of its
    time, is s^2 / (2 r), s - r / 2 and 1 - (1 + r - s)^2 / (2 r), for s from 0 to 1 + r.
    """
    shutter = make_shutter(1.4, ramp=ramp) if ramp < 1 else make_shutter(0.9, ramp=ramp)

    def fallen(seconds):
        s = np.clip(seconds / shutter.time + 0.5 * (1 + ramp), 0.0, 1 + ramp)
        if ramp == 0.0:
            return s
        opening, closing = 0.5 * s**2 / ramp, 1 - 0.5 * (1 + ramp - s) ** 2 / ramp
        return np.where(s < ramp, opening, np.where(s > 1, closing, s - 0.5 * ramp))

    # A place is lit from when the light's right edge is there to when its left one is, around the instant 1.
    fine = (np.arange(32 * CAMERA.width) + 0.5) / 32
    share = fallen((fine - 2) / 13 - 1) - fallen((fine - 4) / 13 - 1)
    wanted = 12.0 * share.reshape(CAMERA.width, 32).mean(axis=1)
    picture = taken(light, shutter=shutter, rays=512)
    trail = np.asarray(picture.image).mean(axis=(0, 2))
    where = np.arange(CAMERA.width) + 0.5
    # Observed 0.029 to 0.054, noise of 24 rows of 512 rays; and 5e-4, 0.036 px.
    assert np.abs(trail - wanted).max() < 0.09
    assert trail.sum() == pytest.approx(wanted.sum(), rel=5e-3)
    assert trail @ where / trail.sum() == pytest.approx(wanted @ where / wanted.sum(), abs=0.06)
    # Nothing shines before it starts and after it ends.
    assert trail[wanted == 0.0].max() == 0.0
    if ramp == 0.0:
        # Evenly bright: observed 0.4 % off, and 1.4 % from end to end.
        level = 12.0 * 2.0 / (13.0 * 1.4)
        inside = trail[9:23]
        assert inside.mean() == pytest.approx(level, rel=0.01)
        slope = np.polyfit(where[9:23], inside, 1)[0]
        assert abs(slope) * 14 < 0.05 * level
        metres = 1 / (0.5 * float(CAMERA.focal_px))
        path = lambda time: dataclasses.replace(  # noqa: E731
            CAMERA, world_from_camera=CAMERA.world_from_camera.at[0, 3].set(-13 * (time - 1) * metres)
        )
        other = taken(light.at(1.0), camera=path, shutter=shutter, rays=512)
        # Observed the same, ray for ray.
        np.testing.assert_allclose(np.asarray(other.image), np.asarray(picture.image), atol=0.02)


def test_a_camera_that_moves_the_other_way_sees_the_same(card):
    pixels_per_metre = 0.5 * float(CAMERA.focal_px)
    path = lambda time: dataclasses.replace(  # noqa: E731
        CAMERA, world_from_camera=CAMERA.world_from_camera.at[0, 3].set(-12 * (time - 1) / pixels_per_metre)
    )
    still = card.at(1.0)
    moved, seen = taken(card), taken(still, camera=path)
    assert seen.changing == 1.0
    np.testing.assert_allclose(np.asarray(seen.image), np.asarray(moved.image), atol=0.02)


def test_nothing_that_moves_is_nothing_that_changes(card):
    still = MovingScene(card.at(0.0), [patch("card", CAMERA, (8, -30, 14, 60), 0.5)], {})
    picture = taken(still, rays=8)
    layers = peeled(still.at(1.0), CAMERA, PINHOLE, None)
    np.testing.assert_array_equal(np.asarray(picture.image), np.asarray(render(layers, PINHOLE, rays=8)))
    assert (picture.spans, picture.peels, picture.changing) == (1, 1, 0.0)
    # What only moves before the shutter opens does not move.
    assert taken(card, frame=3.0, shutter=make_shutter(1.0), rays=8).peels == 1


@pytest.fixture(scope="module")
def turning():
    """A coloured ball that moves, turns, and passes through the plane in focus, before bars and a sky."""
    path = {
        0.0: {"translate": (-0.45, 0.0, -1.7), "rotate": (0, -60, 10)},
        2.0: {"translate": (0.35, 0.15, -2.6), "rotate": (0, 60, -10)},
    }
    moving = ball("ball", (-0.45, 0.0, -1.7), 0.35, 0)
    bars = [
        patch(f"bar {k}", CAMERA, (4 * k - 8, -20, 4 * k - 6, 50), 0.2, (0.2 + 0.03 * k, 0.5, 0.1))
        for k in range(12)
    ]
    front = patch("front", CAMERA, (19, -20, 21, 50), 0.8, (0.8, 0.2, 0.1))
    scene = make_scene([moving, *bars, front], background=constant_background(0.4), unlit=True)
    placed = np.eye(4)
    placed[:3, 3] = (-0.45, 0.0, -1.7)
    motion = Motion(placed=placed, transforms=transforms(path, between="linear"))
    return MovingScene(scene, [moving, *bars, front], {"ball": motion})


@pytest.mark.slow
def test_motion_and_defocus_match_the_mean_of_many_times(turning):
    lens = wide_lens(CAMERA)
    picture = taken(turning, lens=lens)
    layers, mean = None, np.zeros((CAMERA.height, CAMERA.width, 3))
    for number in range(32):
        layers = peeled(turning.at(0.5 + (number + 0.5) / 32), CAMERA, lens, layers)
        mean += np.asarray(render(layers, lens, rays=16, even=True, seed=number + 7)) / 32
    # Observed 42.4 dB.
    assert psnr(picture.image, mean) > 41.0
    assert picture.spans > 1
    assert picture.motion_px > 10
    with compilations() as compiled:
        taken(turning, lens=lens, frame=0.9, like=picture.extents)
    assert compiled == []


def test_the_second_picture_of_several_compiles_nothing(card):
    shutter, options = make_shutter(1.0), {"fps": 1.0, "rays": 4}
    first = render_moving(card, CAMERA, PINHOLE, shutter, like={}, **options)
    with compilations() as compiled:
        render_moving(card, CAMERA, PINHOLE, shutter, frame=0.9, like=first.extents, **options)
    assert compiled == []
    alone = render_moving(card, CAMERA, PINHOLE, shutter, **options)
    np.testing.assert_array_equal(alone.image, first.image)
    for name, extent in alone.extents.items():
        assert first.extents[name].count == max(extent.count + 2, 4)


@pytest.mark.parametrize(
    "way",
    [{"translate": (80.0, 0, 0)}, {"translate": (0, 0, 6.0)}],
    ids=["far across the frame", "through the lens"],
)
def test_what_is_faster_than_the_frame_or_passes_the_lens_is_finite(way):
    """A card 2 m ahead goes 40 m to the right, or through the lens and 1 m on, and is white on its way."""
    white = patch("card", CAMERA, (-4, -30, 36, 60), 0.5)
    scene = make_scene([white], background=constant_background(0.0), unlit=True)
    motion = Motion(transforms=transforms({1.0: {}, 3.0: way}, between="linear"))
    picture = taken(MovingScene(scene, [white], {"card": motion}), frame=1.5, most_spans=8)
    image = np.asarray(picture.image)
    assert np.isfinite(image).all()
    if way["translate"][0]:
        # 20 px per metre and 40 m a second: column 16 is left after 20 px, 0.025 s. Observed 0.0016 off.
        assert image[:, 15:17].mean() == pytest.approx(20 / 800, abs=0.01)
    else:
        # It fills the frame until it comes to the lens, after 2 of 3 m. Observed 0.625: what is behind it
        # in the middle of one of 8 spans is left out in all of it.
        assert image.mean() == pytest.approx(2 / 3, abs=0.06)


def test_layers_of_too_many_times_are_refused_before_they_fill_the_memory(monkeypatch):
    """They are large near the lens, which a card goes through here."""
    white = patch("card", CAMERA, (-4, -30, 36, 60), 0.5)
    scene = make_scene([white], background=constant_background(0.0), unlit=True)
    motion = Motion(transforms=transforms({1.0: {}, 3.0: {"translate": (0, 0, 3)}}, between="linear"))
    world = MovingScene(scene, [white], {"card": motion})
    monkeypatch.setattr(_memory, "machine_memory", lambda: 1_000_000)
    with pytest.raises(
        ValueError, match=r"layers of card for \d of 8 spans take .* GB, and .* lower most_spans"
    ):
        taken(world, frame=1.5, most_spans=8)


def test_what_deforms_is_peeled_at_steps_of_a_pixel():
    corners = np.array([(8, -30), (14, -30), (14, 60), (8, 60)], dtype=float)
    points = at_pixels(corners, np.full(4, 0.5), CAMERA)
    card = make_object("card", points, [(0, 1, 2), (0, 2, 3)], colour=(0, 0, 0), emission=1.0)
    scene = make_scene([card], background=constant_background(0.0), unlit=True)
    other = points + np.array([(0.0, 0, 0), (0.4, 0, 0), (0.4, 0, 0), (0.0, 0, 0)])
    wider = VertexSequence(np.stack([points, other]), first_frame=0.0, frames_per_step=2.0)
    world = MovingScene(scene, [card], {"card": Motion(vertices=wider)})
    picture = taken(world, rays=32)
    # The right edge goes by 4 px around the middle of its way of 8.
    wanted = np.mean([swept(8, 14 + at, [0.0]) for at in np.linspace(2, 6, 401)], axis=0)
    assert picture.spans == 4
    assert picture.step_px == pytest.approx(1.0)
    # Observed 0.001.
    np.testing.assert_allclose(np.asarray(picture.image)[12, :, 0], wanted, atol=0.01)
    rough = taken(world, rays=32, most_spans=1)
    assert (rough.spans, rough.step_px) == (1, pytest.approx(4.0))


def test_what_cannot_be_taken_is_refused(card):
    with pytest.raises(ValueError, match="fps is 0; expected a positive number"):
        render_moving(card, CAMERA, PINHOLE, SECOND, fps=0)
    zoomed = lambda time: front_camera(32 if time < 1.2 else 40)  # noqa: E731
    with pytest.raises(
        ValueError, match=re.escape("the camera has 40 x 24 pixels at frame 1.21875 and 32 x 24")
    ):
        render_moving(card, zoomed, PINHOLE, SECOND, fps=1.0)
