"""Layers made as large as others hold the same, and leave others the room they have."""

import dataclasses

import numpy as np
from small_scenes import front_camera, varied_layers, varied_scene, wide_lens

from focusjax.layers import peel


def test_an_extent_for_others_is_kept_while_it_is_enough():
    extent = varied_layers().extent
    wider = extent.for_others(None)
    assert (wider.count, wider.room, wider.grid.margin) == (extent.count + 2, 2 * extent.room, 0)
    assert extent.for_others(wider) == wider
    # Layers that were made like it need no more than it.
    assert dataclasses.replace(wider, grid=extent.grid).for_others(wider) == wider
    crowded = dataclasses.replace(extent, room=wider.room + 1)
    assert crowded.for_others(wider) == dataclasses.replace(wider, room=2 * crowded.room)


def test_an_extent_serves_its_own_frame_only():
    camera, extent = front_camera(), varied_layers().extent
    assert extent.serves(camera, extent.grid.supersampling)
    assert not extent.serves(camera, extent.grid.supersampling + 1)
    assert not extent.serves(front_camera(width=16), extent.grid.supersampling)


def test_layers_with_room_hold_the_same():
    layers, camera = varied_layers(), front_camera()
    wider = layers.extent.for_others(None)
    roomy = peel(varied_scene(), camera, wide_lens(camera), supersampling=2, like=wider)
    assert (roomy.count, roomy.extent.room, roomy.grid) == (wider.count, wider.room, layers.grid)
    np.testing.assert_array_equal(roomy.cells[: layers.count], layers.cells)
    assert not np.any(roomy.cells[layers.count :])
    kept = layers.extent.room
    for name in ("disparity", "radiance", "triangle", "links", "index"):
        mine, theirs = (np.asarray(getattr(each.samples, name)) for each in (roomy, layers))
        np.testing.assert_array_equal(mine[:kept], theirs)
