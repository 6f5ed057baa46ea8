"""Ratios at equal error, and the files made of them, from made-up measurements."""

import json
import math

import numpy as np
import pytest

from focusjax.bench import METHODS, CaseResults, Reference, Results, Row, save_results


def row(method, setting, seconds, psnr, setup):
    return Row(
        scene="ball_and_wall",
        method=method,
        knob="rays",
        setting=setting,
        seconds=seconds,
        best_seconds=seconds,
        compile_seconds=1.0,
        setup_seconds=setup,
        setup_compile_seconds=0.0,
        peak_mib=100.0,
        psnr=psnr,
        ssim=None,
        silhouette_psnr=None,
    )


@pytest.fixture
def found(case):
    rows = [
        row("tracer", 4, 1.0, 35.0, 2.0),
        row("tracer", 16, 4.0, 45.0, 2.0),
        row("mitsuba", 16, 3.0, 34.0, 0.5),
        row("mitsuba", 64, 12.0, 40.0, 0.5),
        row("gather", 16, 0.1, 30.0, 1.0),
        row("multilayer", 4, 0.5, math.inf, 1.0),
    ]
    picture = np.full((24, 32, 3), 0.5)
    reference = Reference(picture, "mitsuba", 2048, 3, 55.0, kept=True, seconds=1.0)
    pictures = {"tracer": (16, picture), "mitsuba": (64, picture + 0.01)}
    return CaseResults(case, reference, 0.3, rows, pictures, {})


def test_ratios_are_taken_at_the_anchors_error(found):
    anchor = found.anchor()
    assert (anchor.method, anchor.setting) == ("mitsuba", 64)
    lines = {line.method: line for line in found.equal_error()}
    tracer = lines["tracer"]
    # Half-way from 35 to 45 dB: the geometric mean of 1 and 4 s, and of 3 and 6 s with the set-up.
    assert tracer.render.seconds == pytest.approx(2.0)
    assert tracer.ratio == pytest.approx(6.0)
    assert tracer.total.seconds == pytest.approx(math.sqrt(18.0))
    assert tracer.total_ratio == pytest.approx(12.0 / math.sqrt(18.0))
    # The anchor's own set-up is never counted.
    assert (lines["mitsuba"].ratio, lines["mitsuba"].total_ratio) == (1.0, 1.0)
    assert (lines["gather"].render.seconds, lines["gather"].ratio) == (math.inf, 0.0)
    assert lines["multilayer"].render.at_most


def test_without_an_anchor_there_are_no_ratios(found):
    found.rows[:] = [row("mitsuba", 16, 3.0, 34.0, 0.5)]
    assert found.anchor() is None
    assert found.equal_error() == []


def test_the_files_tell_them(found, tmp_path):
    methods = tuple(m for m in METHODS if m.name in ("tracer", "mitsuba", "gather", "multilayer"))
    machine = {"processor": "two & two", "cores": 2, "device": "cpu", "load_before": 0.5}
    save_results(tmp_path, Results(machine, 3, methods, [found]))
    page = (tmp_path / "report.html").read_text()
    for text in (
        "To 40.00 dB",
        "2.00 s",
        "6.00",
        "not reached",
        "≤ 0.50 s",
        "≥ 24.00",
        "two &amp; two",
        "∞",
        "3 of its samples were",
    ):
        assert text in page
    facts = json.loads((tmp_path / "results.json").read_text())
    assert facts["scenes"][0]["anchor"]["psnr"] == 40.0
    lines = {line["method"]: line for line in facts["scenes"][0]["equal_error"]}
    assert facts["scenes"][0]["reference"]["dropped_samples"] == 3
    assert lines["gather"]["render"]["seconds"] == "inf"
    assert lines["tracer"]["ratio"] == pytest.approx(6.0)
