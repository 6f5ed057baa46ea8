"""More layers than memory holds are refused before the work starts, with what would fit."""

import pytest
from small_scenes import front_camera, varied_scene, wide_lens

from focusjax.layers import _memory, disparity_map, peel
from focusjax.layers._grid import Grid


def test_the_message_names_the_number_that_would_fit(monkeypatch: pytest.MonkeyPatch):
    camera = front_camera()
    grid = peel(varied_scene(), camera, wide_lens(camera)).grid
    monkeypatch.setattr(_memory, "machine_memory", lambda: 5.5 * 200 * grid.size / 0.9)
    expected = (
        rf"6 layers of {grid.columns} x {grid.rows} samples need about 0\.\d+ GB and this machine has"
        r" 0\.\d+ GB; lower max_layers to 5, or the supersampling or the picture's size"
    )
    monkeypatch.setattr("focusjax.layers._picture.rasterised", None)
    with pytest.raises(ValueError, match=expected):
        peel(varied_scene(), camera, wide_lens(camera), max_layers=6)
    monkeypatch.undo()
    monkeypatch.setattr(_memory, "machine_memory", lambda: 5.5 * 200 * grid.size / 0.9)
    assert peel(varied_scene(), camera, wide_lens(camera), max_layers=5).count <= 5


def test_too_large_a_picture_for_any_layer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_memory, "machine_memory", lambda: 10**6)
    with pytest.raises(ValueError, match="not even one fits: lower the supersampling"):
        _memory.check_memory(Grid(100, 100, 2, 0), 1)


def test_a_system_that_does_not_tell_is_trusted(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("os.sysconf", lambda name: int("not told"))
    assert _memory.machine_memory() is None
    _memory.check_memory(Grid(10000, 10000, 1, 0), 1000)


def test_this_machine_tells():
    told = _memory.machine_memory()
    assert told is None or told > 1 << 28
    camera = front_camera()
    assert disparity_map(varied_scene(), camera).shape == (camera.height, camera.width)
