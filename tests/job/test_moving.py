"""A still with its shutter open: what moves meanwhile, against the mean of many stills of one instant."""

import json
import re

import numpy as np
import pytest
from cards_config import CONFIG, write_cards
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.job import run

STILL = ["lens.focus_distance_m=1.5", "render.rays=64", "render.smooth=false", "focus=[]"]
MOVES = "shutter={time='1/50', objects=[{name='near', keys=[{at=0}, {at=1, translate=[0.12, 0, 0]}]}]}"


@pytest.fixture(scope="module")
def config_file(tmp_path_factory):
    path = write_cards(tmp_path_factory.mktemp("still"))
    path.write_text(CONFIG[: CONFIG.index("[shot]")])
    return path


def picture(path, *changes):
    return np.asarray(run(load_config(path, [*STILL, *changes]), solving=False).picture.image)


def test_a_still_with_an_open_shutter_is_the_mean_of_its_instants(config_file):
    blurred = picture(config_file, MOVES)
    shifts = 0.12 * (np.arange(8) + 0.5) / 8
    instants = [picture(config_file, f"scene.objects.0.translate=[{shift}, 0, 0]") for shift in shifts]
    mean, middle = np.mean(instants, axis=0), instants[4]
    off = np.sqrt(np.mean((blurred - mean) ** 2))
    # Observed: 0.0045, of the rays; 0.057 between one instant and the mean.
    assert off < 0.008
    assert np.sqrt(np.mean((middle - mean) ** 2)) > 2 * off


def test_glass_with_an_open_shutter_is_the_mean_of_its_instants(config_file):
    glass = [
        "lens={prescription='cooke_triplet_50mm_f4', f_number=4, focus_distance_m=1.5}",
        "render.rays=32",
    ]
    blurred = picture(config_file, *glass, MOVES)
    shifts = 0.12 * (np.arange(8) + 0.5) / 8
    moved = [[*glass, f"scene.objects.0.translate=[{shift}, 0, 0]"] for shift in shifts]
    instants = [picture(config_file, *each) for each in moved]
    off = np.sqrt(np.mean((blurred - np.mean(instants, axis=0)) ** 2))
    # Observed: 0.0071; 0.052 between one instant and the mean.
    assert off < 0.01


@pytest.mark.parametrize("model", ["framing", "breathing"])
def test_close_focus_with_an_open_shutter(config_file, model):
    """The picture is framed as without the shutter, whether the focus is given or solved for."""
    near = [f"lens={{close_focus='{model}', f_number=8, focus_distance_m=0.2}}", MOVES]
    wish = "focus=[{name='near', point=[-0.2, 0, -1], sharp=true}]"
    stays = MOVES.replace("0.12, 0, 0", "0, 0, 0")
    for solving, change in ((False, "render.rays=8"), (True, wish)):
        moving = run(load_config(config_file, [*STILL[1:], *near, stays, change]), solving=solving)
        still = run(load_config(config_file, [*STILL[1:], near[0], change]), solving=solving)
        assert float(moving.camera.focal_length) == pytest.approx(float(still.camera.focal_length), rel=1e-6)
        np.testing.assert_array_equal(moving.picture.image, still.picture.image)


def test_a_moving_camera_and_the_report(config_file, tmp_path):
    """The camera slides, and wishes are about the instant of the picture, in the middle of its time."""
    slides = "shutter={time=0.5, camera=[{at=0, position=[0, 0, 0]}, {at=1, position=[0.05, 0, 0.1]}]}"
    few = "render.max_layers=1"
    options = [part for change in ("render.rays=4", few, slides) for part in ("--set", change)]
    result = CliRunner().invoke(app, ["run", str(config_file), "--out", str(tmp_path), *options])
    assert result.exit_code in (0, 3), result.output
    report = json.loads((tmp_path / "report.json").read_text())
    # The focal length is 45.3 px: 0.05 m go past 1 m away. The camera moves, and nothing by itself.
    assert report["picture"]["shutter_spans"] >= 1
    near = next(wish for wish in report["wishes"] if wish["name"] == "near card")
    assert near["distance_m"] == pytest.approx(1.05, abs=0.01)
    missing = report["picture"]["layers_left_out"]
    assert "found no place in 1 layer, so that light from them is missing; raise render.max_layers" in missing
    assert missing in " ".join(result.output.split())
    assert report["picture"]["largest_motion_px"] == 0.0
    assert "moves by itself" not in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["shutter.time=1/50"], "has a [shutter] and nothing that moves; give [[shutter.camera]] or"),
        ([MOVES, "shutter.time=inf"], "shutter.time is Infinity; expected a finite number"),
        (["shutter={angle_deg=180, camera=[{at=0}]}"], "has shutter.angle_deg, a share of a frame, and no"),
        ([MOVES, "shutter.objects.0.keys.1.at=0"], "has a keyframe of 'near' at 0 after one at 0; put them"),
        ([MOVES, "shutter.objects.0.keys.1.at=2"], "at is 2; expected a number of at most 1"),
        ([MOVES, "shutter.objects.0.name=nera"], "shutter: objects: the scene has no 'nera'; it has 'near'"),
        ([MOVES, "render={method='auto', quality='draft'}"], "render.method = 'auto', which is for what"),
        ([MOVES, "shot={frames=2}"], "has a [shot], whose keyframes say what moves, and shutter.objects"),
    ],
)
def test_what_a_still_shutter_gets_wrong_is_refused(config_file, overrides, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        run(load_config(config_file, [*STILL, *overrides]), solving=False, rendering=False)
