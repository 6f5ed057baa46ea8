"""More layers than memory holds are refused before the work starts, with what would fit."""

import math

import numpy as np
import pytest
from small_scenes import SQUARE, at_pixels, front_camera, varied_scene, wide_lens

from focusjax.geometry import Camera
from focusjax.layers import _memory, decompose, disparity_map, peel
from focusjax.layers._grid import Grid
from focusjax.scene import Scene, make_object, make_scene


def panes(camera: Camera, sheets: int = 1) -> Scene:
    """Four panes of glass behind one another, of so many sheets, each of them all over the picture."""
    corners = np.array([(-300, -300), (300, -300), (300, 300), (-300, 300)])
    objects = [
        make_object(
            f"pane {w}", at_pixels(corners, np.full(4, w), camera), np.tile(SQUARE, (sheets, 1)), opacity=0.5
        )
        for w in (0.6, 0.5, 0.4, 0.3)
    ]
    return make_scene(objects, unlit=True)


def memory_for(monkeypatch: pytest.MonkeyPatch, grid: Grid, layers: float) -> None:
    """A machine with room for so many full layers."""
    monkeypatch.setattr(_memory, "machine_memory", lambda: layers * 208 * grid.size / 0.9)


def test_the_message_names_the_number_that_would_fit(monkeypatch: pytest.MonkeyPatch):
    camera = front_camera()
    lens = wide_lens(camera)
    layers = peel(panes(camera), camera, lens)
    assert layers.filled == 4
    memory_for(monkeypatch, layers.grid, 2.5)
    monkeypatch.setattr("focusjax.layers._build.assemble", None)
    monkeypatch.setattr("focusjax.layers._slabs.assemble", None)
    expected = r"4 layers that hold \d+ samples need about 0\.\d+ GB and this machine has .* lower {} to 2,"
    with pytest.raises(ValueError, match=expected.format("max_layers")):
        peel(panes(camera), camera, lens)
    with pytest.raises(ValueError, match=expected.format("count")):
        decompose(panes(camera), camera, lens, count=16)
    monkeypatch.undo()
    memory_for(monkeypatch, layers.grid, 2.5)
    assert peel(panes(camera), camera, lens, max_layers=2).count == 2


def test_layers_that_are_not_there_cost_nothing(monkeypatch: pytest.MonkeyPatch):
    """`max_layers` is a bound, not a wish."""
    camera = front_camera()
    lens = wide_lens(camera)
    memory_for(monkeypatch, peel(panes(camera), camera, lens).grid, 4.1)
    assert peel(panes(camera), camera, lens, max_layers=10**6).count == 4


def test_too_large_a_picture_for_any_layer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_memory, "machine_memory", lambda: 10**6)
    with pytest.raises(ValueError, match=r"a layer of 200 x 200 samples needs .* lower the supersampling"):
        _memory.check_frame(Grid(100, 100, 2, 0))


def test_surfaces_that_cover_all_many_times_over(monkeypatch: pytest.MonkeyPatch):
    """Refused before any work on them, with how often would fit: panes times their share of the grid, 1."""
    camera = front_camera()
    grid = peel(panes(camera), camera, wide_lens(camera)).grid
    monkeypatch.setattr("focusjax.layers._picture.dice", None)
    monkeypatch.setattr("focusjax.layers._picture.check_frame", lambda grid: None)
    monkeypatch.setattr(_memory, "machine_memory", lambda: int(3.5 * 48 * grid.size / 0.9))
    # The square root of 3.5 / 4 is 0.935.
    expected = r"samples about 4 times over, which .* enough for 3.5 times; .* width and height to 93 %"
    with pytest.raises(ValueError, match=expected):
        peel(panes(camera), camera, wide_lens(camera))
    monkeypatch.setattr(_memory, "machine_memory", lambda: int(350 * 48 * grid.size / 0.9))
    with pytest.raises(ValueError, match=r"about 4000 times over, .* enough for 350 times; .* to 29 %"):
        peel(panes(camera, sheets=1000), camera, wide_lens(camera))


def test_layers_fit_up_to_what_they_may_take(monkeypatch: pytest.MonkeyPatch):
    """Bytes of samples, of places without one and of the grid, of nine tenths of the memory."""
    grid, needed = Grid(100, 50, 1, 0), 200 * 70_000 + 40 * 30_000 + 8 * 3 * 5000
    monkeypatch.setattr(_memory, "machine_memory", lambda: math.ceil(needed / 0.9))
    assert _memory.layers_fit(grid, 3, 70_000, 100_000)
    assert not _memory.layers_fit(grid, 4, 70_000, 100_000)
    assert not _memory.layers_fit(grid, 3, 70_001, 100_000)
    assert not _memory.layers_fit(grid, 3, 70_000, 100_001)


def test_a_system_that_does_not_tell_is_trusted(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("os.sysconf", lambda name: int("not told"))
    assert _memory.machine_memory() is None
    _memory.check_frame(Grid(10000, 10000, 1, 0))
    assert _memory.layers_fit(Grid(10000, 10000, 1, 0), 1000, 1, 1 << 60)


def test_this_machine_says_how_much_it_has():
    found = _memory.machine_memory()
    assert found is None or found > 1 << 28
    camera = front_camera()
    assert disparity_map(varied_scene(), camera).shape == (camera.height, camera.width)


@pytest.mark.parametrize(("text", "expected"), [("4096\n", 4096), ("max\n", None), (None, None)])
def test_a_container_has_the_memory_that_it_is_allowed(tmp_path, monkeypatch, text, expected):
    file = tmp_path / "memory.max"
    if text is not None:
        file.write_text(text)
    monkeypatch.setattr(_memory, "_CONTAINER_LIMITS", (tmp_path / "none",))
    without = _memory.machine_memory()
    monkeypatch.setattr(_memory, "_CONTAINER_LIMITS", (file,))
    assert _memory.machine_memory() == (without if expected is None else expected)


def test_full_layers_take_no_more_than_they_need():
    camera = front_camera()
    layers = peel(panes(camera), camera, wide_lens(camera), supersampling=1)
    # 32 bytes of surface, 4 of outline, and what finds them. Observed: 63.1, as numbers are
    # doubles here, and 41.7 in single precision.
    assert layers.nbytes / (4 * layers.grid.size) < 66.0
