"""Times, memory and pictures of methods, within this process."""

import dataclasses
import importlib.util

import numpy as np
import pytest

from focusjax.baselines import denoised, lens_picture
from focusjax.bench import Reference, resized, speed_error
from focusjax.bench import _run as module
from focusjax.bench._measure import Measured, Timing, measure, peak_memory
from focusjax.bench._methods import Method, method_named
from focusjax.bench._methods import _mitsuba as mitsuba_method
from focusjax.metrics import psnr


def test_set_up_apart_and_every_setting_repeated(case):
    """A method that only counts how often it is called."""
    calls = []

    def prepare(given):
        calls.append("set up")
        return np.zeros((given.camera.height, given.camera.width, 3))

    def render(given, prepared, setting):
        calls.append(setting)
        return prepared + setting

    kept = {}
    counting = Method("counting", "counting", "rays", (1, 5), prepare, render)
    found = measure(counting, case, repeats=3, keep=kept.__setitem__)
    assert calls == ["set up", "set up", 1, 1, 1, 1, 5, 5, 5, 5]
    assert [timing.setting for timing in found.timings] == [1, 5]
    assert all(0 < t.best_seconds <= t.seconds for t in found.timings)
    assert {number: picture.max() for number, picture in kept.items()} == {0: 1.0, 1: 5.0}
    assert 0 < found.start_mib <= found.timings[0].peak_mib <= found.timings[1].peak_mib <= peak_memory()


@pytest.mark.parametrize(
    ("name", "setting", "observed"),
    [  # observed, in dB
        ("raycast", 16, 36.9),
        ("accumulation", 16, 39.6),
        ("gather", 64, 36.1),
        ("scatter", 0.25, 29.3),
        ("scatter-normalised", 0.25, 33.4),
        ("multilayer", 16, 32.5),
        pytest.param(
            "mitsuba-scalar",
            16,
            33.0,
            marks=pytest.mark.skipif(
                importlib.util.find_spec("mitsuba") is None, reason="Mitsuba is not installed (`bench` extra)"
            ),
        ),
    ],
)
def test_methods_see_the_same_picture(case, name, setting, observed):
    method = dataclasses.replace(method_named(name), settings=(setting,))
    kept = {}
    measure(method, case, repeats=1, keep=kept.__setitem__)
    truth = lens_picture(case.scene, case.camera, case.lens, rays=128, seed=7)
    assert psnr(kept[0], truth) > observed - 1.0


def test_a_scene_without_a_reference_leaves_the_others(case, tmp_path, monkeypatch):
    def made(given, **_):
        if given.name == "second":
            raise ValueError("the maker gave up")
        return Reference(np.full((24, 32, 3), 0.5), "raycast", 4, 0, 50.0, kept=True, seconds=1.0)

    timing = Timing(4, 2.0, 1.0, 1.0, 100.0)
    picture, broken = np.full((24, 32, 3), 0.4), np.full((24, 32, 3), np.nan)

    def measured(method, case, *, repeats):
        several = tuple(dataclasses.replace(timing, setting=setting) for setting in (4, 8))
        return Measured(1.0, 1.0, 50.0, several), [picture, broken], None

    monkeypatch.setattr(module, "reference_picture", made)
    monkeypatch.setattr(module, "measured_apart", measured)
    second = dataclasses.replace(case, name="second")
    method = method_named("tracer-1")
    results = speed_error([case, second], [method], cache=tmp_path, maker="raycast")
    assert results.failures == {"second": "second has no reference: the maker gave up"}
    (found,) = results.cases
    # The picture that cannot be scored takes no other with it.
    assert [row.setting for row in found.rows] == [4]
    assert "tracer-1 with 8 rays: " in found.failures["tracer-1"]
    with pytest.raises(ValueError, match="second has no reference: the maker gave up"):
        speed_error([second], [method], cache=tmp_path, maker="raycast")


@pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("mitsuba", "pyoidn")),
    reason="Mitsuba or Open Image Denoise is not installed (`bench` extra)",
)
def test_the_denoised_method_is_the_noisy_one_denoised(case):
    noisy, clean = (
        mitsuba_method("path tracer", "path tracer", (4,), variant="scalar_rgb", denoise=denoise)
        for denoise in (False, True)
    )
    assert (noisy.needs, clean.needs) == (("mitsuba",), ("mitsuba", "pyoidn"))
    larger = dataclasses.replace(case, camera=resized(case.camera, 160, 120))
    kept, pictures = {}, []
    for method in (noisy, clean):
        measure(method, larger, repeats=1, keep=kept.__setitem__)
        pictures.append(kept[0])
    np.testing.assert_allclose(pictures[1], denoised(pictures[0]), atol=1e-5)
    truth = lens_picture(larger.scene, larger.camera, larger.lens, rays=64, seed=7)
    # Observed: 37.5 dB instead of 33.8.
    assert psnr(pictures[1], truth) > psnr(pictures[0], truth) + 2.5
