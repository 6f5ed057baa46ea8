"""Small lights that move while the shutter is open: smeared discs against closed forms and many rays."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch

from focusjax.geometry import look_at
from focusjax.layers import peel
from focusjax.lens import ThinLens
from focusjax.metrics import psnr
from focusjax.scene import constant_background, make_scene
from focusjax.shot import Motion, MovingScene, transforms
from focusjax.shutter import make_shutter, render_moving
from focusjax.trace import _moving
from focusjax.trace._body_motion import BodyMotion

CAMERA = front_camera(48, 36)
DISC = 6.0
"""Radius in pixels of the discs of lamps at the disparity 0.2."""
LENS = ThinLens(jnp.array(1.0), jnp.array(DISC / 0.8 / float(CAMERA.focal_px)))
LAMP = patch("lamp", CAMERA, (15.0, 16.0, 17.0, 18.0), 0.2, 80.0)
EVEN = 80.0 * 4.0 / (np.pi * DISC**2)
"""Radiance within its disc where it stands still."""
SECOND = make_shutter(1.0)
"""Times are in seconds here: a frame a second, around frame 1."""


def to_the_right(pixels: float, disparity: float) -> Motion:
    """By so many pixels a second, from frame 0.5 on."""
    metres = pixels / (disparity * float(CAMERA.focal_px))
    keys = {0.5: {}, 1.5: {"translate": (metres, 0.0, 0.0)}}
    return Motion(transforms=transforms(keys, between="linear"))


def moving(*objects, background=0.0, **motions) -> MovingScene:
    scene = make_scene(list(objects), background=constant_background(background), unlit=True)
    return MovingScene(scene, list(objects), motions)


def peeled(scene, camera, lens, like):
    return peel(scene, camera, lens, supersampling=2, like=like)


def taken(world, camera=CAMERA, shutter=SECOND, **options) -> np.ndarray:
    options = {"rays": 32, "smooth": False, **options}
    return np.asarray(render_moving(world, camera, LENS, shutter, fps=1.0, make=peeled, **options).image)


def smeared_disc(way: float) -> np.ndarray:
    """Radiance of pixels while the lamp goes `way` px to the right: by how long it is within `DISC` of them.

    The mean over the places of the lamp and of film points in the pixel.
    """
    fine = (np.arange(24) + 0.5) / 24 - 0.5
    lamp, film = 2.0 * fine[:, None], fine[None]
    away, weight = np.unique((film - lamp).round(6), return_counts=True)
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width] + 0.5
    mean = np.zeros(rows.shape)
    for down, of_down in zip(away, weight, strict=True):
        half = np.sqrt(np.maximum(DISC**2 - (rows + down - 17.0) ** 2, 0.0))
        for right, of_right in zip(away, weight, strict=True):
            middle = columns + right - 16.0
            time = np.minimum(middle + half, way) - np.maximum(middle - half, 0.0)
            mean += of_down * of_right * np.clip(time, 0.0, None)
    return EVEN * mean / (way * weight.sum() ** 2)


def test_a_smeared_disc_is_as_bright_as_the_time_that_it_covers_a_pixel():
    picture = taken(moving(LAMP, lamp=to_the_right(12.0, 0.2)), rays=256)[..., 0]
    off = picture - smeared_disc(12.0)
    # Observed 0.0085 and 0.0008; 0.057 and 0.0041 with 32 rays.
    assert np.abs(off).max() < 0.015 * EVEN
    assert np.sqrt((off**2).mean()) < 0.0015 * EVEN
    assert picture.sum() == pytest.approx(80.0 * 4.0, rel=2e-3)


def test_a_camera_that_moves_the_other_way_sees_the_same():
    metres = 12.0 / (0.2 * float(CAMERA.focal_px))
    path = lambda time: dataclasses.replace(  # noqa: E731
        CAMERA, world_from_camera=CAMERA.world_from_camera.at[0, 3].set(-metres * (time - 0.5))
    )
    off = taken(moving(LAMP).at(1.0), camera=path, rays=256)[..., 0] - smeared_disc(12.0)
    assert np.abs(off).max() < 0.015 * EVEN


def test_rolling_shutters_see_lights_at_the_time_of_each_row():
    shutter = make_shutter(1 / 50, travel_time=1.0, direction="down")
    picture = taken(moving(LAMP, lamp=to_the_right(12.0, 0.2)), shutter=shutter)[..., 0]
    columns = np.arange(CAMERA.width) + 0.5
    for row in (13, 17, 20):
        wanted = 16.0 + 12.0 * (row + 0.5) / CAMERA.height
        assert picture[row] @ columns / picture[row].sum() == pytest.approx(wanted, abs=0.1)


@pytest.mark.slow
def test_what_passes_before_lights_hides_them_at_its_time(monkeypatch):
    """A card that goes over a lamp while the camera moves, against many rays that meet the lamp by chance."""
    wall = patch("wall", CAMERA, (-60, -60, 120, 120), 0.1, (0.2, 0.3, 0.25))
    card = patch("card", CAMERA, (2.0, -30.0, 16.0, 60.0), 0.6, (0.1, 0.05, 0.02))
    world = moving(LAMP, wall, card, card=to_the_right(14.0, 0.6))

    def path(time):
        pose = CAMERA.world_from_camera.at[:2, 3].add((time - 1) * jnp.array([-0.3, 0.1]))
        return dataclasses.replace(CAMERA, world_from_camera=pose)

    few = taken(world, path, rays=16)
    monkeypatch.setattr(_moving, "may_emit", lambda layers: False)
    truth = taken(world, path, rays=2048)
    # Observed 27.9 dB; as few rays that meet it by chance give 5.6 dB.
    assert psnr(few, truth) > 25.0

    def blocks(picture: np.ndarray) -> np.ndarray:
        return picture.reshape(6, 6, 8, 6, 3).mean(axis=(1, 3))

    np.testing.assert_allclose(blocks(few), blocks(truth), atol=0.03)
    assert few.mean() == pytest.approx(truth.mean(), rel=0.01)


def test_places_of_a_body_are_where_its_rays_go():
    """A place moved into the picture of a turned camera is where the trace of its point is, and back."""
    key = look_at((0.4, 0.2, 0.1), (0.0, 0.1, -3.0), width=48, height=36, focal_length=0.05)
    other = look_at((-0.3, 0.1, 0.3), (0.1, 0.0, -2.0), width=48, height=36, focal_length=0.05)
    matrix = np.linalg.inv(np.asarray(key.world_from_camera)) @ np.asarray(other.world_from_camera)
    motion = BodyMotion(other, key, jnp.asarray(matrix)[None, :3], jnp.array(0.0), jnp.array(0.0))
    point = np.array([0.13, -0.07, -2.4])
    seen, disparity = key.project(jnp.asarray(point))
    place, now, ahead = motion.place(seen, disparity, motion.matrices[0])
    wanted, depth = other.project(jnp.asarray(point))
    np.testing.assert_allclose(np.asarray(place), np.asarray(wanted), rtol=1e-10)
    assert float(now) == pytest.approx(float(depth), rel=1e-10)
    assert float(ahead) > 0
