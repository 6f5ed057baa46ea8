"""Runs of a config with each model of close focus: what is reported, against the formulas of the papers."""

import json

import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.exchange import export_config
from focusjax.job import run
from focusjax.studio._document import Document

MODELS = ("framing", "breathing")
NEAR = ["--set", "camera.position=[-0.4, 0, -1.55]", "--set", "camera.look_at=[-0.4, 0, -3]"]
"""20 cm before the near box."""


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return write_boxes(tmp_path_factory.mktemp("boxes"))


def done(boxes, folder, *options, command="run"):
    result = CliRunner().invoke(app, [command, str(boxes), *NEAR, *options, "--out", str(folder)])
    assert result.exit_code in (0, 3), result.output
    return " ".join(result.output.split()), json.loads((folder / "report.json").read_text())


@pytest.fixture(scope="module", params=MODELS)
def reported(request, boxes, tmp_path_factory):
    """A run 20 cm before what is to be sharp, at f/4, with exposure."""
    folder = tmp_path_factory.mktemp(request.param)
    sets = (
        f"lens.close_focus={request.param}",
        "lens.f_number=4",
        'solve={free=["focus"]}',
        "exposure.time=1/60",
        "exposure.iso=100",
        "exposure.light_ev=10",
    )
    return request.param, *done(boxes, folder, *(each for key in sets for each in ("--set", key)))


def test_what_is_reported_is_consistent(reported):
    model, output, report = reported
    lens, close, exposure = report["lens"], report["lens"]["close_focus"], report["exposure"]
    distance = 1000 * lens["focus_distance_m"]
    length, image = lens["focal_length_mm"], close["image_distance_mm"]
    assert {"framing": image, "breathing": length}[model] == pytest.approx(50.0, rel=1e-9)
    assert 1 / length == pytest.approx(1 / image + 1 / distance, rel=1e-9)
    assert lens["f_number"] == pytest.approx(4.0, rel=1e-9)
    assert 2 * lens["aperture_radius_mm"] == pytest.approx(length / 4, rel=1e-9)
    assert close["magnification"] == pytest.approx(image / distance, rel=1e-9)
    assert close["working_f_number"] == pytest.approx(4 * (1 + image / distance), rel=1e-9)
    assert lens["movements"]["image_distance_mm"] == pytest.approx(image, rel=1e-9)
    assert (exposure["f_number"], exposure["magnification"], exposure["effective_f_number"]) == pytest.approx(
        (4.0, close["magnification"], close["working_f_number"]), rel=1e-9
    )
    assert "focus 20" in output.lower()
    assert close["sentence"] in output
    assert "f/4.0" in output


def test_wishes_and_depth_of_field_are_by_the_papers_circle(reported):
    _, _, report = reported
    lens = report["lens"]
    distance, length = lens["focus_distance_m"], lens["focal_length_mm"]
    image, per_mm = lens["close_focus"]["image_distance_mm"], 40 / 36

    def circle_px(at):
        of_point = 1 / (1 / length - 1 / (1000 * at))
        return (image - of_point) / of_point * length / 4 * per_mm

    (wish,) = [row for row in report["wishes"] if row["name"] == "far box"]
    assert wish["got_px"] == pytest.approx(circle_px(wish["distance_m"]), rel=1e-6)
    sharp = lens["depth_of_field"]
    assert circle_px(sharp["far_m"]) == pytest.approx(sharp["circle_of_confusion_px"], rel=1e-6)
    assert circle_px(sharp["near_m"]) == pytest.approx(-sharp["circle_of_confusion_px"], rel=1e-6)
    assert distance == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize("model", MODELS)
def test_a_lens_as_given_is_framed_where_it_is_focused(boxes, model):
    sets = [f"lens.close_focus={model}", "lens.focus_distance_m=0.2", "lens.f_number=4"]
    outcome = run(load_config(boxes, [*NEAR[1::2], *sets]), solving=False, rendering=False)
    expected = {"framing": 0.05, "breathing": 0.05 * 0.2 / 0.15}[model]
    assert float(outcome.camera.focal_length) == pytest.approx(expected, rel=1e-9)
    assert float(outcome.settings.f_number) == pytest.approx(4.0, rel=1e-9)


def test_both_models_draw_the_same_picture_of_one_optical_state(boxes):
    """50 mm at 20 cm by breathing is 66.7 mm by framing, with the focal length and f-number it then has."""
    sets = ["lens.focus_distance_m=0.2", "lens.f_number=4", "render.rays=2"]
    breathing = run(load_config(boxes, [*NEAR[1::2], *sets, "lens.close_focus=breathing"]), solving=False)
    image = 1000 * float(breathing.camera.focal_length)
    sets += [f"camera.focal_length_mm={image!r}", "lens.close_focus=framing"]
    framing = run(load_config(boxes, [*NEAR[1::2], *sets]), solving=False)
    assert float(framing.settings.focal_length) == pytest.approx(0.05, rel=1e-9)
    assert breathing.picture is not None
    assert framing.picture is not None
    assert float(abs(breathing.picture.image - framing.picture.image).max()) < 1e-9


def test_ignored_reports_what_it_did(boxes, tmp_path):
    output, report = done(boxes, tmp_path, "--set", "lens.f_number=4", "--set", 'solve={free=["focus"]}',
                          command="solve")  # fmt: skip
    assert report["lens"]["close_focus"] is None
    assert "magnification" not in output
    assert (report["lens"]["f_number"], report["lens"]["focal_length_mm"]) == pytest.approx((4.0, 50.0))


@pytest.mark.parametrize(
    ("sets", "match"),
    [
        (['lens.close_focus="near"'], "lens.close_focus is \"near\"; expected 'ignored', 'framing' or"),
        (["lens.prescription=cooke_triplet_50mm_f4"], "a prescription, whose glass says"),
        (
            ["lens.height_field={file='a', width_mm=9, scale_mm=1, thickness_mm=3, glass={name='N-BK7'}}"],
            "a height_field, whose glass says",
        ),
        (["lens.tilt_deg=3"], "tilt_deg, with which the image distance"),
        (["solve.free=[\"focus\", \"shift\"]"], "'shift' in solve.free, where only focus and f_number may"),
        (["solve.prior.focus={distance_m=2, sigma_per_m=1}"], "solve.prior.focus, which is in dioptres"),
        (["lens.seidel={w040_um=1, f_number=2}"], "Seidel coefficients of a wavefront"),
        (["lens.colour.glass={name=\"N-BK7\"}"], "colour.glass, which is for one focal length"),
        (
            ["exposure.light_ev=10", "exposure.priority=focus", "exposure.iso=100"],
            "exposure.priority, which weighs f-numbers without it",
        ),
    ],
)  # fmt: skip
def test_configs_it_is_not_for_are_refused(boxes, sets, match):
    with pytest.raises(ConfigError, match=match):
        load_config(boxes, ["lens.close_focus=framing", *sets])


def test_a_focus_within_the_focal_length_is_refused(boxes):
    near = load_config(boxes, ["lens.close_focus=breathing", "lens.focus_distance_m=0.04"])
    with pytest.raises(ConfigError, match=r"0.04 m is within the focal length 0.05 m, where no lens"):
        run(near, solving=False, rendering=False)


def test_wishes_for_places_are_refused_where_the_picture_grows(boxes):
    shown = load_config(boxes, ["lens.close_focus=breathing", 'focus.1={object="far box", in_frame_px=2}'])
    with pytest.raises(ConfigError, match=r"boxes.toml: lens.close_focus: close_focus is 'breathing', where"):
        run(shown, rendering=False)


def test_commands_without_it_refuse_it(boxes, tmp_path):
    config = load_config(boxes, ["lens.close_focus=framing"])
    with pytest.raises(ConfigError, match="which an exported camera does not have; leave it out"):
        export_config(config, tmp_path / "camera.gltf", to="gltf")
    document = Document(boxes, text=boxes.read_text().replace("[lens]", '[lens]\nclose_focus = "framing"'))
    assert document.config is None
    assert "lens.close_focus is 'framing', which the studio does not have" in document.problem
    for command in (["stack"], ["bench", "speed-error"]):
        result = CliRunner().invoke(app, [*command, str(_with_framing(boxes)), "--out", str(tmp_path / "x")])
        assert result.exit_code == 2, result.output
        assert "lens.close_focus is 'framing'" in " ".join(result.output.split())


def _with_framing(boxes):
    file = boxes.with_name("framing.toml")
    file.write_text(boxes.read_text().replace("[lens]", '[lens]\nclose_focus = "framing"'))
    return file
