"""Post-processing: against the tracer where both are right, and each pass by a closed form."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch

from focusjax.geometry import Camera
from focusjax.layers import peel
from focusjax.lens import (
    AberratedLens,
    DarkenedLens,
    Disk,
    ThinLens,
    chromatic_lens,
    cosine_falloff,
    height_curve,
    tabulated_aberrations,
)
from focusjax.post import PinholeView, motion_blur, post_process, view_in_layers
from focusjax.scene import Scene, constant_background, make_scene
from focusjax.trace import render

RADIUS = 0.1


@cache
def camera() -> Camera:
    return front_camera(48, 32)


def lens_of(radius: float = RADIUS, focus: float = 0.75) -> ThinLens:
    return ThinLens(jnp.array(focus), jnp.array(radius), Disk())


@cache
def scene() -> Scene:
    """A grey patch in focus before a wall, and all of it dimmer than white."""
    near = patch("near", camera(), (12, 8, 30, 24), 0.75, 0.8)
    wall = patch("wall", camera(), (-20, -20, 70, 50), 0.5, 0.25)
    return make_scene([near, wall], background=constant_background(0.1), unlit=True)


@cache
def view() -> PinholeView:
    return view_in_layers(peel(scene(), camera(), lens_of(0.0), supersampling=1), scene())


def test_the_view_is_what_a_pinhole_sees():
    np.testing.assert_allclose(view().disparity[16, 20], 0.75, atol=1e-6)
    np.testing.assert_allclose(view().disparity[2, 2], 0.5, atol=1e-6)
    np.testing.assert_allclose(view().image[16, 20], 0.8, atol=1e-6)
    closed = post_process(view(), camera(), lens_of(0.0))
    np.testing.assert_array_equal(closed, view().image)


def test_what_is_in_focus_before_a_blurred_wall_is_as_traced():
    """The one case that gathering has right but for noise: a sharp thing in front."""
    lens = lens_of()
    found = np.asarray(post_process(view(), camera(), lens, taps=64))
    traced = np.asarray(render(peel(scene(), camera(), lens, supersampling=1), lens, rays=64))
    inside = np.s_[4:-4, 4:-4]
    assert np.sqrt(np.mean((found - traced)[inside] ** 2)) < 0.01
    assert abs(float(found.mean() - traced.mean())) < 0.002


def barrel(share: float) -> AberratedLens:
    """A constant distortion: another size."""
    reach = 0.5 * np.hypot(48, 32) * float(camera().sensor_width) / 48
    return AberratedLens(
        lens_of(0.0), tabulated_aberrations({"distortion": height_curve([0.0, reach], [share, share])}, 0.1)
    )


def test_distortion_and_lateral_colour_move_edges_where_rays_have_them():
    ramp = np.broadcast_to((np.arange(48) + 0.5)[None, :, None] / 48, (32, 48, 3))
    flat = PinholeView(jnp.asarray(ramp), jnp.full((32, 48), 0.5))
    shown = np.asarray(post_process(flat, camera(), barrel(-0.1)))
    # Keys's cubics are exact on straight lines.
    wanted = (24 + (np.arange(48) + 0.5 - 24) / 0.9) / 48
    inside = np.s_[:, 6:-6]
    np.testing.assert_allclose(shown[inside][..., 1], np.broadcast_to(wanted[6:-6], (32, 36)), atol=1e-9)
    fringed = np.asarray(
        post_process(flat, camera(), chromatic_lens(lens_of(0.0), magnification=(1.1, 1.0, 0.9)))
    )
    for number, size in enumerate((1.1, 1.0, 0.9)):
        at = (24 + (np.arange(6, 42) + 0.5 - 24) / size) / 48
        np.testing.assert_allclose(fringed[:, 6:-6, number], np.broadcast_to(at, (32, 36)), atol=1e-9)


def test_vignetting_is_the_lenss_own():
    white = PinholeView(jnp.ones((32, 48, 3)), jnp.full((32, 48), 0.5))
    shown = np.asarray(post_process(white, camera(), DarkenedLens(lens_of(0.0), cosine_falloff())))
    y, x = np.mgrid[0.5:32, 0.5:48]
    tangent = np.hypot(x - 24, y - 16) / float(camera().focal_px)
    # Observed: 5e-6, by a cubic spline between few places.
    np.testing.assert_allclose(shown[..., 0], np.cos(np.arctan(tangent)) ** 4, atol=2e-5)


def test_motion_blurs_along_the_velocity_and_keeps_what_stands():
    still, moving = np.zeros((32, 48, 3)), np.zeros((32, 48, 2))
    still[:, 20:28], moving[:, 20:28, 0] = 1.0, 8.0
    disparity = np.where(moving[..., 0] > 0, 1.0, 0.5)
    found = np.asarray(motion_blur(jnp.asarray(still), jnp.asarray(disparity), jnp.asarray(moving), taps=64))[
        16, :, 0
    ]
    # A box 8 px wide that moves 8 px is a triangle 16 px wide at its foot.
    truth = np.clip(1 - np.abs(np.arange(48) + 0.5 - 24) / 8, 0, 1)
    np.testing.assert_allclose(found, truth, atol=0.02)
    none = motion_blur(jnp.asarray(still), jnp.asarray(disparity), jnp.zeros((32, 48, 2)))
    np.testing.assert_array_equal(none, still)


@pytest.mark.parametrize("way", [40.0, 80.0, 300.0])
def test_what_moves_fast_is_not_lost(way):
    """A white box 20 px wide, of whose way the picture holds the middle."""
    still, moving = np.zeros((32, 96, 3)), np.zeros((32, 96, 2))
    still[:, 38:58], moving[:, 38:58, 0] = 1.0, way
    disparity = np.where(moving[..., 0] > 0, 1.0, 0.5)
    found = np.asarray(motion_blur(jnp.asarray(still), jnp.asarray(disparity), jnp.asarray(moving), taps=64))
    away = np.abs(np.arange(96) + 0.5 - 48)
    truth = np.clip(np.minimum(10.0, 0.5 * way - away) + np.minimum(10.0, 0.5 * way + away), 0, 20) / way
    # Observed: 0.013, as edges fall between the 64 moments.
    np.testing.assert_allclose(found[..., 0], np.broadcast_to(truth, (32, 96)), atol=0.03)
    assert found.sum() == pytest.approx(3 * 32 * truth.sum(), rel=0.01)


def test_wrong_views_are_refused():
    with pytest.raises(ValueError, match="the velocity has values that are not finite"):
        motion_blur(view().image, view().disparity, jnp.full((32, 48, 2), jnp.nan))
    with pytest.raises(ValueError, match=r"expected \[h, w, 3\], \[h, w\] and \[h, w, 2\]"):
        motion_blur(view().image, view().disparity, jnp.zeros((32, 40, 2)))
    small = PinholeView(jnp.zeros((8, 8, 3)), jnp.zeros((8, 8)))
    with pytest.raises(ValueError, match="give both the same size"):
        post_process(small, camera(), lens_of())


def test_what_stands_still_is_not_smeared_over_what_moves_behind_it():
    """A red card before a wall that slides by 12 px: the wall beside it stays free of red."""
    image = np.full((32, 48, 3), 0.3)
    image[8:24, 18:30] = (1.0, 0.0, 0.0)
    disparity, velocity = np.full((32, 48), 0.2), np.zeros((32, 48, 2))
    disparity[8:24, 18:30] = 1.0
    velocity[..., 0] = np.where(disparity < 0.5, 12.0, 0.0)
    found = np.asarray(motion_blur(*(jnp.asarray(a) for a in (image, disparity, velocity))))
    np.testing.assert_allclose(found, image, atol=1e-12)
