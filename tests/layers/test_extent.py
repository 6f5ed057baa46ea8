"""Layers made as large as others hold the same, and leave others the room they have."""

import dataclasses

import numpy as np
from small_scenes import front_camera, varied_layers, varied_scene, wide_lens

from focusjax.layers import _assemble, peel
from focusjax.layers._grid import sizes_like


def test_an_extent_for_others_has_no_margin():
    extent = varied_layers().extent
    others = extent.for_others()
    assert (others.count, others.room, others.grid.margin) == (extent.count, extent.room, 0)
    assert others.for_others() == others


def test_sizes_are_those_of_others_while_they_are_enough():
    like = dataclasses.replace(varied_layers().extent, count=4, room=100_000)
    assert sizes_like(3, 90_000, like, spare=True) == sizes_like(4, 100_000, like, spare=False)
    assert sizes_like(4, 100_000, like, spare=True) == (4, 100_000)
    assert sizes_like(5, 100_000, like, spare=True) == (7, 100_000)
    assert sizes_like(4, 100_001, like, spare=True) == (4, 200_002)
    assert sizes_like(5, 100_001, like, spare=False) == (5, 100_001)
    assert sizes_like(3, 90_000, None, spare=True) == (5, 180_000)


def test_small_things_have_layers_of_one_size():
    """What is far away and comes nearer, and whatever else is small, has programs in common."""
    assert sizes_like(1, 1024, None, spare=True) == sizes_like(2, 16_384, None, spare=True) == (4, 32_768)
    assert sizes_like(1, 1024, None, spare=False) == (1, 1024)


def test_nothing_is_spare_that_does_not_fit_in_memory(monkeypatch):
    """What layers are to be like stays."""
    camera, needed = front_camera(), varied_layers().extent
    monkeypatch.setattr(_assemble, "layers_fit", lambda *sizes: False)

    def extent(like):
        return peel(varied_scene(), camera, wide_lens(camera), supersampling=2, like=like, spare=True).extent

    assert extent(None) == needed
    wider = dataclasses.replace(needed, count=needed.count + 3, room=needed.room - 1)
    assert extent(wider) == dataclasses.replace(wider, room=needed.room)


def test_an_extent_serves_its_own_frame_only():
    camera, extent = front_camera(), varied_layers().extent
    assert extent.serves(camera, extent.grid.supersampling)
    assert not extent.serves(camera, extent.grid.supersampling + 1)
    assert not extent.serves(front_camera(width=16), extent.grid.supersampling)


def test_layers_with_room_hold_the_same():
    layers, camera = varied_layers(), front_camera()
    roomy = peel(varied_scene(), camera, wide_lens(camera), supersampling=2, spare=True)
    wider = roomy.extent
    assert (wider.count, wider.room) == (layers.count + 2, max(2 * layers.extent.room, 32_768))
    assert wider.grid == layers.grid
    again = peel(
        varied_scene(), camera, wide_lens(camera), supersampling=2, like=wider.for_others(), spare=True
    )
    assert again.extent == wider
    np.testing.assert_array_equal(roomy.cells[: layers.count], layers.cells)
    assert not np.any(roomy.cells[layers.count :])
    kept = layers.extent.room
    for name in ("disparity", "radiance", "triangle", "links", "index"):
        mine, theirs = (np.asarray(getattr(each.samples, name)) for each in (roomy, layers))
        np.testing.assert_array_equal(mine[:kept], theirs)
