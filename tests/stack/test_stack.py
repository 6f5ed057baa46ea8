"""The fewest shots, against trying all; a stack from a config to its merged picture."""

import csv
import itertools
import json

import numpy as np
import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.io import load_exr
from focusjax.stack import fewest_points, merge


def fewest_by_trying(lower, upper):
    """Some best set of points consists of upper ends: each point moves up to the first of them it meets."""
    for count in range(1, len(lower) + 1):
        for points in itertools.combinations(upper, count):
            met = [(lower <= point) & (point <= upper) for point in points]
            if np.logical_or.reduce(met).all():
                return count
    raise AssertionError


def test_no_fewer_shots_would_do():
    random = np.random.default_rng(0)
    counts = []
    for _ in range(200):
        lower = random.uniform(0.0, 4.0, random.integers(1, 10))
        upper = lower + random.uniform(0.0, 1.0, len(lower))
        common, group = fewest_points(lower, upper)
        middle = common.mean(axis=1)[group]
        assert ((lower <= middle) & (middle <= upper)).all()
        counts.append(len(common))
        assert counts[-1] == fewest_by_trying(lower, upper)
    assert len(set(counts)) > 3


def test_a_merged_pixel_is_of_shots_that_are_sharp_there():
    blur = np.abs(np.linspace(-8.0, 8.0, 41))[None, :, None] * np.ones((9, 1, 1))
    near, far = blur[..., 0], np.abs(blur[..., 0] - 8.0)
    pictures = [np.repeat(each[..., None], 3, axis=-1) for each in (near, far)]
    for circle in (1.0, 5.0):
        merged = merge(pictures, [near, far], circle)[..., 0]
        assert (merged <= np.maximum(np.minimum(near, far), circle) + 1e-12).all()
    # Within the circle of confusion of both there is no step.
    assert np.abs(np.diff(merged, axis=1)).max() < 1.0


@pytest.fixture(scope="module")
def stacked(tmp_path_factory):
    """A stack of both boxes, the near one's front and the far one in whole, and what was said."""
    folder = tmp_path_factory.mktemp("stack")
    config = write_boxes(folder)
    config.write_text(config.read_text().replace("blur_px = 3\ntolerance_px = 0.5", "sharp = true"))
    words = [
        "stack",
        str(config),
        "--out",
        str(folder / "out"),
        "--f-number",
        "0.3",
        "--set",
        "render.rays=8",
    ]
    result = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    return folder / "out", config, result


def test_a_stack_meets_every_wish_where_one_shot_does_not(stacked):
    out, _, result = stacked
    assert result.exit_code == 0, result.output
    facts = json.loads((out / "stack.json").read_text())
    assert len(facts["shots"]) == 2
    assert max(facts["worst_px"].values()) <= facts["circle_px"]
    assert [shot["names"] for shot in facts["shots"]] == [["box's front"], ["far box"]]
    with (out / "stack.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[0]["focus_distance_m"]) == pytest.approx(1.75, rel=1e-3)  # observed 1e-15
    gap = 1.0 / float(rows[1]["near_m"]) - 1.0 / float(rows[0]["far_m"])
    assert float(rows[0]["overlap_per_m"]) == pytest.approx(gap)
    assert gap < 0 < float(rows[1]["near_m"]) - float(rows[0]["far_m"])
    assert "2 shots at f/0.3, circle of confusion" in result.output
    # The merged picture is the near shot at the front of the near box, and the far one at the far box.
    merged = load_exr(out / "merged.exr")["R"]
    shots = [load_exr(out / "shots" / name / "image.exr") for name in ("01", "02")]
    best = np.minimum(*(np.abs(shot["blur"]) for shot in shots))
    for shot in shots:
        own = (np.abs(shot["blur"]) == best) & (best < 0.2)
        apart = np.abs(merged - shot["R"])[own]
        assert len(apart) > 5
        assert np.median(apart) < 0.02
    assert (out / "merged.png").exists()
    assert (out / "shots" / "single" / "image.png").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--set", "lens.tilt_deg=3"], "there is lens.tilt_deg, and stacks are planned for a thin lens"),
        (["--f-number", "0"], "--f-number is 0; expected a number such as 8"),
        (
            ["--set", "solve.min_focus_distance_m=3", "--f-number", "0.3"],
            'wish "box\'s front" is 1.75 m away, and the lens focuses',
        ),
    ],
)
def test_what_cannot_be_planned_is_refused(stacked, tmp_path, words, sentence):
    result = CliRunner().invoke(app, ["stack", str(stacked[1]), "--out", str(tmp_path / "new"), *words])
    assert result.exit_code == 2
    assert sentence in " ".join(result.output.split())
    assert not (tmp_path / "new").exists()
