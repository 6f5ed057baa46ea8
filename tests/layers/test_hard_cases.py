"""What real meshes hold: degenerate, duplicate, touching, interpenetrating and huge triangles."""

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from small_scenes import SQUARE, at_pixels, front_camera, patch, wide_lens

from focusjax.geometry import look_at
from focusjax.layers import Layers, disparity_map, peel
from focusjax.lens import ThinLens
from focusjax.scene import (
    SceneObject,
    constant_background,
    directional_light,
    gradient_background,
    make_object,
    make_scene,
)
from focusjax.trace import render, render_pinhole

SKY = np.array([0.0, 0.0, 9.0])


def picture_of(objects: list[SceneObject], **arguments) -> tuple[Layers, np.ndarray]:
    camera = front_camera()
    arguments.setdefault("background", constant_background(SKY))
    lens = wide_lens(camera)
    layers = peel(make_scene(objects, unlit=True, **arguments), camera, lens, supersampling=1)
    return layers, np.asarray(render(layers, lens, rays=16))


def extended(item: SceneObject, points: np.ndarray, faces: np.ndarray) -> SceneObject:
    """`item` with more triangles."""
    return make_object(
        item.name,
        np.concatenate([item.vertices, points]),
        np.concatenate([item.faces, faces + len(item.vertices)]),
        colour=(0, 0, 0),
        emission=item.materials[0].emission,
    )


def test_degenerate_triangles_change_nothing():
    camera = front_camera()
    plain = patch("square", camera, (4, 4, 28, 20), 0.5)
    corner, along = plain.vertices[0], plain.vertices[1] - plain.vertices[0]
    line = np.array([corner, corner + along / 2, corner + along, corner])
    spoilt = extended(plain, line, np.array([(0, 1, 2), (0, 3, 0), (1, 1, 1)]))
    layers, picture = picture_of([spoilt])
    expected_layers, expected = picture_of([plain])
    assert layers.filled == expected_layers.filled
    np.testing.assert_array_equal(picture, expected)


def test_slivers_and_edge_on_triangles_give_finite_pictures():
    camera = front_camera()
    edge_on = at_pixels([(16, 2), (16, 22), (16, 12)], np.array([0.9, 0.9, 0.2]), camera)
    sliver = at_pixels([(2, 12), (30, 12.0001), (2, 12.0002)], np.array([0.5, 0.5, 0.5]), camera)
    for points in (edge_on, sliver):
        item = make_object("thin", points, [(0, 1, 2)], colour=(0, 0, 0), emission=1.0)
        layers, picture = picture_of([item, patch("wall", camera, (-60, -60, 90, 90), 0.15, 0.5)])
        assert np.isfinite(picture).all()
        assert np.isfinite(layers.disparity).all()
        np.testing.assert_allclose(picture, 0.5, atol=0.2)


def test_duplicate_triangles_change_nothing():
    camera = front_camera()
    plain = patch("square", camera, (4, 4, 28, 20), (0.3, 0.6, 0.6, 0.3))
    twice = extended(plain, plain.vertices, np.concatenate([SQUARE, SQUARE[:, ::-1]]))
    layers, picture = picture_of([twice])
    expected_layers, expected = picture_of([plain])
    assert layers.filled == expected_layers.filled
    np.testing.assert_allclose(picture, expected, atol=1e-6)


def test_nothing_shines_through_where_surfaces_touch():
    """Two walls that meet in a corner, and two boxes side by side."""
    camera = front_camera()
    left = patch("left", camera, (-60, -60, 16.3, 90), (0.9, 0.3, 0.3, 0.9))
    right = patch("right", camera, (16.3, -60, 90, 90), (0.3, 0.9, 0.9, 0.3))
    _, picture = picture_of([left, right])
    np.testing.assert_allclose(picture, 1.0, rtol=1e-6)
    boxes = [
        trimesh.creation.box(extents=(4, 12, 1), transform=trimesh.transformations.translation_matrix(place))
        for place in ((-2, 0, -3), (2, 0, -3))
    ]
    objects = [
        make_object(f"box {k}", box.vertices, box.faces, colour=(0, 0, 0), emission=1.0)
        for k, box in enumerate(boxes)
    ]
    _, picture = picture_of(objects)
    np.testing.assert_allclose(picture, 1.0, rtol=1e-6)


def test_surfaces_that_interpenetrate_show_the_nearer_one():
    """Two planes cross along a line on screen: each is in front on its own side."""
    camera = front_camera()
    rising = patch("rising", camera, (0, 0, 32, 24), (0.2, 0.6, 0.6, 0.2), (1, 0, 0))
    falling = patch("falling", camera, (0, 0, 32, 24), (0.6, 0.2, 0.2, 0.6), (0, 1, 0))
    layers, picture = picture_of([rising, falling])
    assert layers.complete
    near = disparity_map(make_scene([rising, falling]), camera)
    x = np.arange(32) + 0.5
    np.testing.assert_allclose(near, np.broadcast_to(0.4 + 0.4 * np.abs(x / 32 - 0.5), near.shape), rtol=1e-6)
    sharp = np.asarray(render_pinhole(layers))
    np.testing.assert_allclose(sharp[:, 17:], np.broadcast_to([1, 0, 0], (24, 15, 3)))
    np.testing.assert_allclose(sharp[:, :15], np.broadcast_to([0, 1, 0], (24, 15, 3)))
    # Both are opaque: no sky between them, whatever part of the lens looks.
    assert picture[6:-6, 8:-8, 2].max() == 0.0


def test_an_object_that_crosses_the_near_plane_is_cut_not_lost():
    """A beam from behind the camera to far ahead of it, below the axis."""
    beam = trimesh.creation.box(extents=(8.0, 0.2, 20.0))
    item = make_object(
        "beam", beam.vertices, beam.faces, translate=(0, -0.6, 0), colour=(0, 0, 0), emission=1.0
    )
    camera = front_camera()
    lens = ThinLens(jnp.array(0.5), jnp.array(0.02))
    scene = make_scene([item], unlit=True, background=constant_background(SKY))
    layers = peel(scene, camera, lens)
    picture = np.asarray(render(layers, lens, rays=16))
    # Its top, 0.5 m below, ends 10 m ahead: 40 px x 0.05 under the middle; all below that is beam.
    np.testing.assert_allclose(picture[15:], 1.0, rtol=1e-6)
    np.testing.assert_allclose(picture[:12], np.broadcast_to(SKY, (12, 32, 3)), rtol=1e-6)
    expected = (np.arange(15, 24) + 0.5 - 12) / 40 / 0.5
    np.testing.assert_allclose(disparity_map(scene, camera)[15:, 16], expected, rtol=1e-5)


def test_a_ground_plane_of_ten_kilometres():
    """From under the feet to the horizon in two triangles: exact depth, no holes, a small margin."""
    size = 5000.0
    corners = np.array([(-size, 0, -size), (size, 0, -size), (size, 0, size), (-size, 0, size)])
    ground = make_object("ground", corners, SQUARE, colour=(0, 0, 0), emission=1.0)
    camera = look_at((0, 1.6, 0), (0, 1.6, -1.0), width=64, height=48, field_of_view=0.8)
    lens = ThinLens(jnp.array(0.2), jnp.array(0.03))
    scene = make_scene([ground], unlit=True, background=constant_background(SKY))
    layers = peel(scene, camera, lens)
    assert layers.filled <= 2
    assert layers.grid.margin <= 32
    below = np.arange(25, 48)
    expected = (below + 0.5 - 24) / float(camera.focal_px) / 1.6
    seen = disparity_map(scene, camera)
    np.testing.assert_allclose(seen[25:], np.broadcast_to(expected[:, None], (23, 64)), rtol=1e-5)
    assert not seen[:23].any()
    picture = np.asarray(render(layers, lens, rays=16))
    # The blur of the horizon is 2.2 px wide.
    np.testing.assert_allclose(picture[28:], 1.0, rtol=1e-6)
    np.testing.assert_allclose(picture[:20], np.broadcast_to(SKY, (20, 64, 3)), rtol=1e-6)


@pytest.mark.parametrize("turned", [False, True])
def test_a_card_has_two_sides(turned: bool):
    """Back faces are not left out, and are lit as what the eye sees of them."""
    camera = front_camera()
    points = at_pixels([(4, 4), (28, 4), (28, 20), (4, 20)], np.full(4, 0.5), camera)
    card = make_object("card", points, SQUARE[:, ::-1] if turned else SQUARE)
    scene = make_scene([card], lights=[directional_light((0, 0, -1), 1.0)])
    lens = wide_lens(camera)
    layers = peel(scene, camera, lens, supersampling=1)
    np.testing.assert_allclose(np.asarray(render(layers, lens, rays=4))[12, 16], 0.8, rtol=1e-6)


def test_the_background_is_at_infinity():
    """Focused there it is as sharp as it is; focused nearby, it is blurred by 2 f E w_f."""
    camera = front_camera()
    background = gradient_background((0, 0, 0), (1, 1, 1), (0, 0, 0))
    mote = patch("mote", camera, (200, 200, 201, 201), 0.5)
    scene = make_scene([mote], unlit=True, background=background)
    pictures = {}
    for focus in (0.0, 0.5):
        lens = wide_lens(camera, pixels_per_dioptre=8.0, focus=focus)
        pictures[focus] = np.asarray(render(peel(scene, camera, lens), lens, rays=64))[:, 16, 0]
    layers = peel(scene, camera, wide_lens(camera, pixels_per_dioptre=8.0))
    sharp = np.asarray(render_pinhole(layers))[:, 16, 0]
    np.testing.assert_allclose(pictures[0.0], sharp, atol=0.003)
    # The gradient is a ridge at the horizon: its mean over a disk of radius r is lower by 4 r / 3 pi slopes.
    slope = sharp[14] - sharp[16]
    drop = sharp[11:13].mean() - pictures[0.5][11:13].mean()
    assert drop == pytest.approx(0.5 * slope * (4 * 4.0 / (3 * np.pi) - 0.5), rel=0.15)
