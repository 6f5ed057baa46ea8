"""Surfaces that are there in part only: holes hold nothing, and glass hides nothing."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from small_scenes import SQUARE, at_pixels, front_camera, patch, wide_lens

from focusjax.geometry import Camera
from focusjax.layers import Layers, covered, decompose, disparity_map, peel
from focusjax.scene import SceneObject, constant_background, make_object, make_scene
from focusjax.trace import render_pinhole

UV = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], dtype=float)
BOX = (4, 2, 28, 22)


def pane(camera: Camera, disparity: float, **arguments) -> SceneObject:
    """A card over `BOX`."""
    left, top, right, bottom = BOX
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    points = at_pixels(corners, np.full(4, disparity), camera)
    return make_object(f"pane {disparity}", points, SQUARE, **arguments)


def half_there(surface: SceneObject) -> SceneObject:
    materials = tuple(dataclasses.replace(material, opacity=0.5) for material in surface.materials)
    return dataclasses.replace(surface, materials=materials)


def holed(size: int) -> np.ndarray:
    """A picture [size, size, 4] whose middle quarter is not there."""
    picture = np.full((size, size, 4), 0.5, dtype=np.float32)
    picture[..., 3] = 1.0
    picture[size // 4 : -size // 4, size // 4 : -size // 4, 3] = 0.0
    return picture


def layers_of(objects: list[SceneObject], **arguments) -> Layers:
    camera = front_camera()
    return peel(make_scene(objects, unlit=True), camera, wide_lens(camera), supersampling=1, **arguments)


def wall(camera: Camera) -> SceneObject:
    return patch("wall", camera, (-30, -30, 62, 54), 0.2)


def held(layers: Layers, disparity: float) -> np.ndarray:
    """Samples [h, w] of the frame that hold a surface at `disparity` at their centre."""
    here = (np.asarray(layers.triangle) >= 0) & np.isclose(layers.disparity, disparity, rtol=3e-5)
    margin = layers.grid.margin
    return here.any(axis=0)[margin:-margin, margin:-margin]


def test_opaque_scenes_carry_nothing():
    camera = front_camera()
    assert layers_of([wall(camera)]).opacity is None
    # A picture with an alpha channel that is 1 all over is opaque, too.
    picture = np.ones((4, 4, 4), dtype=np.float32)
    solid = pane(camera, 0.5, uv=UV, texture=picture, cutoff=0.5)
    assert layers_of([solid, wall(camera)]).opacity is None


@pytest.mark.parametrize("cutoff", [None, 0.5])
def test_a_hole_holds_nothing_and_shows_what_is_behind(cutoff: float | None):
    camera = front_camera()
    layers = layers_of([pane(camera, 0.5, uv=UV, texture=holed(24), cutoff=cutoff), wall(camera)])
    assert layers.complete
    card, behind = held(layers, 0.5), held(layers, 0.2)
    y, x = np.mgrid[:24, :32] + 0.5
    inside = (x > 10.5) & (x < 21.5) & (y > 7.5) & (y < 16.5)
    solid = (x > 4) & (x < 28) & (y > 2) & (y < 22) & ~((x > 9) & (x < 23) & (y > 6) & (y < 18))
    assert not card[inside].any()
    assert card[solid].all()
    assert behind[inside].all()


def test_no_fringe_reaches_into_a_hole():
    """Triangles cover the hole, but nothing of the card is added there."""
    camera = front_camera()
    layers = layers_of([pane(camera, 0.5, uv=UV, texture=holed(24), cutoff=0.5)])
    margin = layers.grid.margin
    hole = np.asarray(layers.cells)[:, margin + 8 : margin + 16, margin + 11 : margin + 21]
    assert not hole.any()
    # Nor is the card cut off beside the hole: its squares are whole there.
    beside = layers.cells[0, margin + 12, margin + 6]
    assert bool(covered(beside, jnp.asarray(0.49), jnp.asarray(-0.49)))


def test_glass_hides_nothing():
    camera = front_camera()
    objects = [pane(camera, 0.5, opacity=0.4), wall(camera)]
    layers = layers_of(objects)
    y, x = np.mgrid[:24, :32] + 0.5
    inside = (x > 4) & (x < 28) & (y > 2) & (y < 22)
    assert held(layers, 0.2).all()
    np.testing.assert_array_equal(held(layers, 0.5), inside)
    values = np.unique(np.asarray(layers.opacity))
    np.testing.assert_allclose(values, [0, 102 / 255, 1])
    # The same card, opaque, hides the wall but for a border.
    opaque = layers_of([pane(camera, 0.5), wall(camera)])
    assert not held(opaque, 0.2)[8:16, 10:22].any()


def test_what_is_hidden_behind_a_wall_stays_hidden():
    """A pane before a wall opens nothing behind the wall."""
    camera = front_camera()
    far = patch("far", camera, (-30, -30, 62, 54), 0.1)
    front = patch("front", camera, (-40, -40, 72, 64), 0.3)
    layers = layers_of([pane(camera, 0.5, opacity=0.4), front, far])
    # A ring around the pane is kept, as far as the parallax, where the wall changes its layer.
    assert not held(layers, 0.1)[9:15, 11:21].any()


def test_objects_nobody_can_see_are_left_out():
    camera = front_camera()
    layers = layers_of([pane(camera, 0.5, opacity=0.0), wall(camera)])
    assert layers.opacity is None
    assert not held(layers, 0.5).any()


def test_a_cut_outline_keeps_its_area():
    """A picture cut at any size leaves the share of the card that it says, near or far."""
    camera = front_camera()
    n = 512
    y, x = (np.mgrid[:n, :n] + 0.5) / n * 2 - 1
    for texels in (8, 32, 512):
        small = (0.5 + (0.6 - np.hypot(x, y)) * 2).clip(0, 1)
        small = small.reshape(texels, n // texels, texels, n // texels).mean(axis=(1, 3))
        picture = np.ones((texels, texels, 4), dtype=np.float32)
        picture[..., 3] = small
        layers = layers_of([pane(camera, 0.5, uv=UV, texture=picture, cutoff=0.5)])
        area = np.asarray(layers.opacity)[np.asarray(layers.triangle) >= 0].sum()
        place = (np.arange(2000) + 0.5) / 2000 * texels - 0.5
        finely = map_coordinates(small, np.meshgrid(place, place), order=1, mode="grid-wrap")
        # The card is 24 x 20 samples. Observed: within 1 %.
        assert area == pytest.approx((finely >= 0.5).mean() * 24 * 20, rel=0.02)


def test_the_depth_map_sees_through_what_is_less_than_half_there():
    camera = front_camera()
    for opacity, expected in ((0.4, 0.2), (0.6, 0.5)):
        scene = make_scene([pane(camera, 0.5, opacity=opacity), wall(camera)])
        np.testing.assert_allclose(disparity_map(scene, camera)[12, 16], expected, rtol=3e-5)


@pytest.mark.parametrize("order", [("wall", "decal"), ("decal", "wall")])
@pytest.mark.parametrize("gap", [0.0, 5e-6])
def test_a_decal_lies_before_the_wall_it_touches(order: tuple[str, str], gap: float):
    """Whichever comes first in the scene: half of each, and nothing of the sky behind."""
    camera = front_camera()
    whole = (-40, -40, 80, 80)
    wall = patch("wall", camera, whole, 0.5, (1.0, 1.0, 1.0))
    decal = half_there(patch("decal", camera, whole, 0.5 * (1 - gap), (1.0, 0.0, 0.0)))
    objects = {"wall": wall, "decal": decal}
    sky = constant_background(np.array([0.0, 0.0, 5.0]))
    scene = make_scene([objects[name] for name in order], background=sky, unlit=True)
    picture = np.asarray(render_pinhole(peel(scene, camera, wide_lens(camera), supersampling=1)))
    np.testing.assert_allclose(picture, np.broadcast_to([1.0, 0.5, 0.5], picture.shape), atol=3e-3)


@pytest.mark.parametrize("count", [2, 16])
def test_slabs_keep_a_pane_before_a_wall(count: int):
    camera = front_camera()
    wall = patch("wall", camera, (-40, -40, 80, 80), 0.5, (1.0, 1.0, 1.0))
    glass = half_there(patch("glass", camera, (-40, -40, 80, 80), 0.8, (1.0, 0.0, 0.0)))
    layers = decompose(
        make_scene([wall, glass], unlit=True), camera, wide_lens(camera), count=count, supersampling=1
    )
    picture = np.asarray(render_pinhole(layers))
    np.testing.assert_allclose(picture, np.broadcast_to([1.0, 0.5, 0.5], picture.shape), atol=3e-3)
