"""Slabs: what each keeps, the overlap, the umbra, and pictures that approach those of peeled layers."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from glossy import glossy_camera, glossy_lens, glossy_scene
from small_scenes import front_camera, patch, varied_layers, varied_scene, wide_lens

from focusjax.layers import Layers, decompose, peel, spread
from focusjax.lens import ThinLens
from focusjax.scene import Scene, make_object, make_scene
from focusjax.trace import render


def pillars(*columns: tuple[int, tuple[float, ...]]) -> Scene:
    """At each column, strips of the picture one sample wide at the given disparities, behind one another."""
    camera = front_camera()
    strips = [
        patch(f"{column} {w}", camera, (column, 0, column + 1, 24), w)
        for column, disparities in columns
        for w in disparities
    ]
    return make_scene(strips, unlit=True)


def at_column(layers: Layers, column: int) -> list[float]:
    """Disparities that the layers hold at the middle of a column of the picture, nearest first."""
    margin = layers.grid.margin
    values = np.asarray(layers.disparity)[:, margin + 12, margin + column]
    return [round(float(w), 6) for w in values if w > 0]


def slabs(scene: Scene, **options) -> Layers:
    camera = front_camera()
    return decompose(scene, camera, wide_lens(camera), supersampling=1, **options)


@cache
def varied_slabs(count: int) -> Layers:
    camera = front_camera()
    return decompose(varied_scene(), camera, wide_lens(camera), count=count, supersampling=2)


@pytest.mark.parametrize(
    ("count", "kept", "complete"),
    [
        (1, [1.0], False),
        (2, [1.0, 0.5], False),
        (8, [1.0, 0.9, 0.5, 0.4], True),
    ],
)
def test_each_slab_keeps_its_nearest_surface(count: int, kept: list[float], complete: bool):
    layers = slabs(pillars((10, (0.9, 0.4, 1.0, 0.5))), count=count)
    assert at_column(layers, 10) == kept
    assert layers.complete == complete


def test_a_slab_reaches_a_tenth_into_the_next_one():
    """Two slabs meet at 0.6; the first reaches to 0.56 and makes room for another surface in the second."""
    layers = slabs(pillars((4, (1.0, 0.2)), (10, (0.57, 0.5)), (16, (0.55, 0.5))), count=2)
    assert at_column(layers, 10) == [0.57, 0.5]
    assert at_column(layers, 16) == [0.55]
    assert not layers.complete


def test_blur_step_is_the_change_of_the_blur_diameter():
    """From 1.0 to 0.2 per metre the diameter changes by 2 * 12 * 0.8 = 19.2 pixels."""
    scene = pillars((10, (1.0, 0.75, 0.5, 0.2)))
    for step, count in ((19.3, 1), (9.7, 2), (4.9, 4)):
        by_step, by_count = slabs(scene, blur_step=step), slabs(scene, count=count)
        np.testing.assert_array_equal(by_step.disparity, by_count.disparity)
        assert by_step.complete == by_count.complete
    assert slabs(scene, blur_step=4.9).complete


def test_a_surface_through_many_slabs_is_one_surface():
    """A floor from 0.15 to 1.2 per metre: held once at every sample, joined across, the same picture."""
    camera = front_camera()
    lens = wide_lens(camera)
    floor = patch("floor", camera, (-8, 4, 40, 30), (0.15, 0.15, 1.2, 1.2), (0.3, 0.5, 0.2))
    scene = make_scene([floor], unlit=True)
    ours, peeled = decompose(scene, camera, lens, count=9), peel(scene, camera, lens, max_layers=9)
    assert ours.complete
    np.testing.assert_array_equal(ours.cells, peeled.cells)
    for name in ("disparity", "links", "triangle"):
        np.testing.assert_array_equal(getattr(ours.samples, name), getattr(peeled.samples, name))


def test_layers_are_in_order_and_packed_from_the_front():
    layers = varied_slabs(8)
    held, centre = np.asarray(layers.cells) > 0, np.asarray(layers.triangle) >= 0
    disparity = np.asarray(layers.disparity)
    assert layers.filled <= 8
    assert not (held[1:] & ~held[:-1]).any()
    assert not (centre[1:] & ~centre[:-1]).any()
    assert (disparity[1:] < disparity[:-1] * (1 - 5e-6))[centre[1:]].all()
    np.testing.assert_array_equal(np.asarray(layers.ranges.most_layers), held.sum(axis=0).max())
    for array in (layers.disparity, layers.radiance, layers.background):
        assert np.isfinite(array).all()


def test_slabs_keep_surfaces_that_are_there():
    camera = front_camera()
    every = peel(varied_scene(), camera, wide_lens(camera), supersampling=2, max_layers=12, umbra=False)
    ours = varied_slabs(8)
    centre = np.asarray(ours.triangle) >= 0
    found = np.zeros(centre.shape, dtype=bool)
    for disparity in np.asarray(every.disparity):
        found |= np.asarray(ours.disparity) == disparity
    assert found[centre].all()
    assert 0 < ours.samples_kept < every.samples_kept


@pytest.mark.slow
def test_pictures_approach_that_of_peeled_layers():
    peeled = np.asarray(render(varied_layers(), varied_layers().lens, rays=64))
    errors = []
    for count in (2, 4, 8, 16, 64):
        layers = varied_slabs(count)
        errors.append(np.abs(np.asarray(render(layers, layers.lens, rays=64)) - peeled).mean())
    # Observed: 2e-3, 2e-4, 4e-5, 1e-5, 0.
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1e-5
    assert varied_slabs(64).complete
    assert varied_slabs(64).samples_kept == varied_layers().samples_kept


def test_what_the_umbra_hides_takes_no_place():
    """Behind a front that covers the frame, the wall is dropped though a slab has room for it."""
    camera = front_camera()
    front, wall = (patch(name, camera, (-60, -60, 90, 90), w) for name, w in (("front", 0.6), ("wall", 0.35)))
    layers = slabs(make_scene([front, wall], unlit=True), count=2)
    assert layers.complete
    # Only at the border of the grid, where nothing is known to be beyond.
    rim = np.asarray(layers.triangle)[1:] >= 0
    assert not rim[:, 8:-8, 8:-8].any()


@pytest.mark.parametrize("how", [{"count": 5}, {"blur_step": 2.0}])
def test_a_pinhole_sees_one_layer(how: dict):
    camera = front_camera()
    layers = decompose(varied_scene(), camera, ThinLens(jnp.array(0.5), jnp.array(0.0)), **how)
    assert layers.filled == 1
    assert layers.complete


def test_an_empty_view_has_an_empty_layer():
    camera = front_camera()
    behind = make_object("behind", [(0, 0, 1), (1, 0, 1), (0, 1, 1)], [(0, 1, 2)])
    layers = decompose(make_scene([behind]), camera, wide_lens(camera), count=4)
    assert layers.complete
    assert layers.samples_kept == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "count is None and blur_step is None; give exactly one of them"),
        ({"count": 2, "blur_step": 3.0}, "give exactly one of them"),
        ({"blur_step": float("inf")}, "blur_step is inf px; expected a positive number"),
        ({"count": 0}, "count is 0; expected a whole number, at least 1"),
        ({"count": 2000}, "2000 slabs are more than the 1024 there can be; give a lower count"),
        ({"count": 2, "supersampling": 0}, "supersampling is 0; expected a whole number, at least 1"),
        ({"blur_step": 0.0}, r"blur_step is 0\.0 px; expected a positive number"),
        ({"blur_step": float("nan")}, "blur_step is nan px; expected a positive number"),
        ({"blur_step": 1e-3}, r"1024 there can be; make the blur_step of 0\.001 px larger"),
        ({"count": 2, "near": 0.0}, r"near is 0\.0; expected a positive depth"),
    ],
)
def test_bad_values_are_refused(options: dict, message: str):
    camera = front_camera()
    with pytest.raises(ValueError, match=message):
        decompose(varied_scene(), camera, wide_lens(camera), **options)


def test_slabs_of_a_moved_scene_have_the_shapes_they_are_to_be_like():
    camera = front_camera()
    lens = wide_lens(camera)
    first = decompose(varied_scene(), camera, lens, count=6)
    wall = make_scene([patch("wall", camera, (-20, -20, 60, 60), 0.5)], unlit=True)
    then = decompose(wall, camera, lens, count=6, like=first)
    shapes = [[a.shape for a in jax.tree.leaves(layers) if hasattr(a, "shape")] for layers in (first, then)]
    assert shapes[0] == shapes[1]
    with pytest.raises(ValueError, match="the layers to be like are of 32 x 24 pixels"):
        decompose(wall, front_camera(40, 24), lens, count=6, like=first)


def test_slabs_keep_what_gloss_needs():
    layers = decompose(glossy_scene(), glossy_camera(), glossy_lens(), count=8, view_dependent=True)
    peeled = peel(glossy_scene(), glossy_camera(), glossy_lens(), view_dependent=True)
    assert layers.samples.gloss is not None
    # Every highlight is of the surface seen: slabs keep the same of it.
    first, other = (np.asarray(each.triangle)[0] for each in (layers, peeled))
    same = (first >= 0) & (first == other)
    # Observed: all.
    assert same.sum() > 0.99 * (first >= 0).sum()
    for name in ("material", "normal"):
        one, other = (
            np.asarray(spread(each, getattr(each.samples.gloss, name), 0))[0] for each in (layers, peeled)
        )
        assert len(np.unique(one[same])) > 1
        np.testing.assert_array_equal(one[same], other[same])
    one, other = (np.asarray(spread(each, each.samples.radiance[:, 0], 0.0))[0] for each in (layers, peeled))
    np.testing.assert_allclose(one[same], other[same], rtol=1e-12)
