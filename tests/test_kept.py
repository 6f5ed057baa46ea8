"""What is made of an object is made once, and goes with it."""

import gc

import numpy as np
import pytest
from small_scenes import varied_scene

from focusjax import _kept


class Owner:
    pass


def test_it_is_made_once_and_goes_with_its_owner():
    owner, made = Owner(), []
    for _ in range(2):
        assert _kept.kept(owner, "a", lambda: made.append(1) or "made") == "made"
    assert made == [1]
    assert _kept.kept(owner, "b", lambda: "other") == "other"
    assert _kept.kept(Owner(), "a", lambda: "another's") == "another's"
    place = id(owner)
    del owner
    gc.collect()
    assert not any(where == place for where, _ in _kept._KEPT)


def test_shaders_of_a_scene_share_their_tables():
    scene = varied_scene()
    here, there = scene.shader((0.0, 0.0, 0.0)), scene.shader((0.0, 1.0, 0.0))
    assert here.positions[0] is there.positions[0]
    assert np.asarray(there.eye) == pytest.approx([0.0, 1.0, 0.0])
