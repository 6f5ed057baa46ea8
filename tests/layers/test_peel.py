"""Peeling: what the extended umbra drops cannot be seen, and what can be seen is kept."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers, varied_scene, wide_lens

from focusjax.layers import Layers, disparity_map, peel
from focusjax.lens import ThinLens
from focusjax.scene import make_object, make_scene
from focusjax.trace import render


@cache
def two_squares(pixels_per_dioptre: float) -> Layers:
    """A square in front of the whole frame but for a rim of 3 pixels, and a wall behind."""
    camera = front_camera()
    front = patch("front", camera, (3, 3, 29, 21), 0.6)
    wall = patch("wall", camera, (-30, -30, 60, 60), 0.35)
    lens = wide_lens(camera, pixels_per_dioptre=pixels_per_dioptre)
    return peel(make_scene([front, wall], unlit=True), camera, lens, supersampling=1)


def test_layers_are_in_order_and_finite():
    layers = varied_layers()
    centre = np.asarray(layers.triangle) >= 0
    disparity = np.asarray(layers.disparity) * centre
    assert layers.complete
    assert layers.filled >= 3
    assert (disparity[1:] < disparity[:-1] * (1 - 5e-6))[disparity[1:] > 0].all()
    assert not ((disparity[1:] > 0) & (disparity[:-1] == 0)).any()
    assert (disparity > 0)[centre].all()
    # Fringe samples fill up from the front, too.
    held = np.asarray(layers.cells) > 0
    np.testing.assert_array_equal(held, np.asarray(layers.disparity) > 0)
    assert not (held[1:] & ~held[:-1]).any()
    assert np.asarray(layers.triangle).max() < len(varied_scene().faces)
    assert layers.samples_kept == (disparity > 0).sum()
    for array in (layers.disparity, layers.radiance, layers.background):
        assert np.isfinite(array).all()
    assert layers.radiance.shape == (*disparity.shape, 3)
    assert disparity.shape[1:] == (layers.grid.rows, layers.grid.columns)
    assert layers.background.shape == (3,)


def test_a_pinhole_sees_one_layer():
    camera = front_camera()
    pinhole = ThinLens(jnp.array(0.5), jnp.array(0.0))
    layers = peel(varied_scene(), camera, pinhole, supersampling=1)
    assert layers.filled == 1
    assert layers.complete
    assert layers.grid.margin == 0
    first = np.asarray(layers.disparity[0]) * (np.asarray(layers.triangle[0]) >= 0)
    np.testing.assert_allclose(first, disparity_map(varied_scene(), camera), rtol=1e-6)


@pytest.mark.parametrize("pixels_per_dioptre", [6.0, 12.0])
def test_a_solid_front_hides_all_but_a_border(pixels_per_dioptre: float):
    """The wall behind shows under the front square for as far as the rim of the lens looks around it."""
    layers = two_squares(pixels_per_dioptre)
    front, second = np.asarray(layers.disparity[0]), np.asarray(layers.disparity[1:]).max(axis=0)
    assert layers.complete
    margin = layers.grid.margin
    inside = front > 0.5
    assert inside.sum() == 26 * 18
    y, x = np.mgrid[: layers.grid.rows, : layers.grid.columns] + 0.5 - margin
    depth = np.minimum.reduce([x - 3, 29 - x, y - 3, 21 - y])
    parallax = pixels_per_dioptre * (0.6 - 0.35)
    kept = second > 0
    assert kept[inside & (depth <= parallax)].all()
    # Windows grow by doubling, so up to twice the parallax may be kept.
    assert not kept[depth > 2 * parallax + 1].any()
    assert (depth > 2 * parallax + 1).any()


def test_a_wider_lens_keeps_more():
    kept = [two_squares(width).samples_kept - two_squares(width).grid.size for width in (6.0, 12.0)]
    assert 0 < kept[0] < kept[1]


def test_nothing_that_can_be_seen_is_dropped():
    """The picture of all surfaces is the picture of those that were kept."""
    layers = varied_layers()
    everything = peel(
        varied_scene(), front_camera(), layers.lens, supersampling=2, max_layers=12, umbra=False
    )
    assert everything.complete
    assert everything.samples_kept > layers.samples_kept
    kept, full = (np.asarray(render(each, each.lens, rays=64)) for each in (layers, everything))
    # Observed: 0.015 at most, 1.1e-4 on average: one ray of 64 at silhouettes.
    assert np.abs(kept - full).max() < 0.03
    assert np.abs(kept - full).mean() < 3e-4


def test_plain_peeling_keeps_every_surface():
    camera = front_camera()
    walls = [patch(str(w), camera, (-60, -60, 90, 90), w) for w in (0.6, 0.5, 0.4)]
    twice = patch("twice", camera, (-60, -60, 90, 90), 0.5)
    scene = make_scene([*walls, twice], unlit=True)
    for lens in (wide_lens(camera), ThinLens(jnp.array(0.5), jnp.array(0.0))):
        layers = peel(scene, camera, lens, supersampling=1, umbra=False)
        assert layers.complete
        assert layers.filled == 3
        np.testing.assert_allclose(
            layers.disparity[:3],
            np.broadcast_to(np.array([0.6, 0.5, 0.4])[:, None, None], (3, *layers.disparity.shape[1:])),
            rtol=1e-6,
        )


def test_too_few_layers_are_owned_up_to():
    camera = front_camera()
    layers = peel(varied_scene(), camera, wide_lens(camera), max_layers=1)
    assert layers.filled == 1
    assert not layers.complete
    everything = peel(varied_scene(), camera, wide_lens(camera))
    # What is left may hide some of itself, so that there are as many samples of it or more.
    assert layers.left_out.count >= everything.samples_kept - layers.samples_kept > 0
    assert everything.left_out.count == 0
    # Of no account to compiled programs.
    assert (layers.left_out, hash(layers.left_out)) == (everything.left_out, hash(everything.left_out))


def test_an_empty_view_has_an_empty_layer():
    camera = front_camera()
    behind = make_object("behind", [(0, 0, 1), (1, 0, 1), (0, 1, 1)], [(0, 1, 2)])
    layers = peel(make_scene([behind]), camera, wide_lens(camera), supersampling=1)
    assert layers.complete
    assert layers.samples_kept == 0
    assert (np.asarray(layers.triangle) == -1).all()
    assert not disparity_map(make_scene([behind]), camera).any()


def test_coincident_surfaces_count_once():
    camera = front_camera()
    twice = [patch(name, camera, (4, 4, 20, 20), 0.5) for name in ("one", "two")]
    layers = peel(make_scene(twice, unlit=True), camera, wide_lens(camera), supersampling=1)
    assert layers.filled == 1
    assert layers.complete


def test_disparity_map_is_zero_where_nothing_is():
    camera = front_camera()
    seen = disparity_map(make_scene([patch("square", camera, (5, 7, 12, 11), 0.4)]), camera)
    expected = np.zeros((24, 32))
    expected[7:11, 5:12] = 0.4
    np.testing.assert_allclose(seen, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"supersampling": 0}, "supersampling is 0; expected a whole number, at least 1"),
        ({"max_layers": 0}, "max_layers is 0; expected a whole number, at least 1"),
        ({"near": 0.0}, r"near is 0\.0; expected a positive depth"),
        ({"near": float("nan")}, "near is nan; expected a positive depth"),
    ],
)
def test_bad_values_are_refused(changes: dict, message: str):
    camera = front_camera()
    with pytest.raises(ValueError, match=message):
        peel(varied_scene(), camera, wide_lens(camera), **changes)


def test_a_surface_on_the_lens_is_refused():
    camera = front_camera()
    scene = make_scene([patch("mote", camera, (-1e6, -1e6, 1e6, 1e6), 250.0)], unlit=True)
    with pytest.raises(ValueError, match=r"by 2997 pixels, more than the layers can hold; move the nearest"):
        peel(scene, camera, wide_lens(camera), supersampling=2, near=1e-3)


def test_a_frame_that_is_too_large_is_refused():
    camera = front_camera(20000, 20000)
    wall = patch("wall", camera, (0, 0, 20000, 20000), 0.35)
    with pytest.raises(ValueError, match="a frame of 20000 x 20000 pixels needs 400 million samples"):
        peel(make_scene([wall], unlit=True), camera, wide_lens(camera))
