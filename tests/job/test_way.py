"""A quality is reached by post-processing where that does, sooner than tracing, and the report says so."""

import dataclasses
import json

import pytest
from boxes_config import write_boxes
from small_scenes import varied_layers, varied_scene
from typer.testing import CliRunner

from focusjax import post, trace
from focusjax.cli import app
from focusjax.config import RenderTable, load_config
from focusjax.job import Way, run
from focusjax.job._way import choose_way

TABLE = RenderTable(method="auto", quality="30 dB")


def post_plan(**changes) -> post.PostPlan:
    plan = post.PostPlan(16, 32.0, 31.0, reaches=True, seconds=1.0, fewest_seconds=2.0)
    return dataclasses.replace(plan, **changes)


@pytest.mark.parametrize(
    ("changes", "planned", "by_post"),
    [
        ({}, False, True),
        ({"reaches": False}, True, False),
        ({"seconds": 3.0}, True, True),
        ({"seconds": 5.0}, True, False),
    ],
    ids=["even the fewest rays are slower", "not good enough", "so many rays are slower", "slower"],
)
def test_the_quicker_of_what_reaches_the_quality_is_taken(
    monkeypatch, changes: dict, planned: bool, by_post: bool
):
    plan = post_plan(**changes)
    rays = trace.RayPlan(64, 30.5, 4.0)
    monkeypatch.setattr("focusjax.job._way.plan_post", lambda *_, **__: plan)
    monkeypatch.setattr("focusjax.job._way.plan_rays", lambda *_, **__: rays)
    layers = varied_layers()
    way = choose_way(TABLE, post.view_in_layers(layers, varied_scene()), layers, layers.lens)
    assert (way.post, way.by_post) == (plan, by_post)
    assert way.traced == (rays if planned else None)
    assert choose_way(TABLE, None, layers, layers.lens) == Way(rays)


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    """With no number of rays."""
    file = write_boxes(tmp_path_factory.mktemp("boxes"))
    file.write_text(file.read_text().replace("rays = 4", ""))
    return file


def with_seconds(monkeypatch, seconds: float) -> None:
    """What is really expected, but for times, which no test relies on."""

    def plan(*given, **options):
        found = post.plan_post(*given, **options)
        return dataclasses.replace(found, seconds=seconds, fewest_seconds=2.0)

    monkeypatch.setattr("focusjax.job._way.plan_post", plan)


def test_a_draft_by_post_processing_is_reported(boxes, tmp_path, monkeypatch):
    with_seconds(monkeypatch, 1.0)
    options = ["--set", "render.method=auto", "--set", "render.quality='15 dB'", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["render", str(boxes), *options])
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "report.json").read_text())["picture"]
    assert (found["method"], found["rays_per_pixel"]) == ("post", 16)
    quality = found["quality"]
    # Observed: 0.1 dB apart.
    assert quality["reached_db"] == pytest.approx(quality["expected_db"], abs=1.0)
    assert quality["expected_db"] == quality["weighed"]["post"]["expected_db"] > 15
    assert quality["weighed"]["trace"] == {"rays": None, "expected_db": None, "expected_seconds": 2.0}
    said = f"Post-processed for 15 dB: {quality['expected_db']:.1f} dB, and "
    sentence = "post-processing in 1 s; even the fewest rays would take 2 s. Reached: "
    for text in (" ".join(result.output.split()), (tmp_path / "report.html").read_text()):
        assert said in text
        assert sentence in text
    assert "post-process</td>" in (tmp_path / "report.html").read_text()


def test_what_post_processing_does_not_reach_is_traced(boxes, tmp_path):
    options = ["--set", "render.method=auto", "--set", "render.quality=36", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["render", str(boxes), *options])
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "report.json").read_text())["picture"]
    weighed = found["quality"]["weighed"]
    assert found["method"] == weighed["chosen"] == "trace"
    assert weighed["post"]["reaches"] is False
    assert found["rays_per_pixel"] == weighed["trace"]["rays"]
    assert found["quality"]["expected_db"] == weighed["trace"]["expected_db"] >= 36
    assert f"dB of {weighed['trace']['rays']} rays per pixel in" in " ".join(result.output.split())


def test_choosing_makes_the_same_pictures(boxes, monkeypatch):
    with_seconds(monkeypatch, 1.0)
    quality = "render.quality=15"
    chosen = run(load_config(boxes, ["render.method=auto", quality]), solving=False).picture
    asked = ["render.method=post", "render.rays=16", "render.supersampling=1"]
    given = run(load_config(boxes, asked), solving=False).picture
    # Both views are of the same surfaces; observed: equal.
    assert abs(chosen.image - given.image).max() < 1e-5
    assert abs(chosen.pinhole - given.pinhole).max() < 1e-5
