"""Which layers a run is made of, and what it reports of them."""

import json

import numpy as np
import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.job import run

BEHIND = ["--set", "scene.objects.1.translate=[-0.35, 0, -5]", "--set", "lens.f_number=0.4"]
"""The far box partly behind the near one, and a lens that sees some of what is hidden."""


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return write_boxes(tmp_path_factory.mktemp("boxes"))


def test_layers_are_examined_when_that_is_asked_for(boxes, tmp_path):
    options = [*BEHIND, "--set", "render.examine_layers=true", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["render", str(boxes), *options])
    assert result.exit_code == 0, result.output
    assert "The layers miss 0.0000 % of the surfaces that rays meet first, ±" in result.output
    found = json.loads((tmp_path / "report.json").read_text())["picture"]["examined"]
    assert found["missed_share"] == 0.0
    # What is hidden: the backs of both boxes, and what of the far one lies deep behind the near one.
    assert found["layers_without"] >= 4 > found["layers_with_umbra"]
    assert found["samples_saved_share"] > 0.3
    assert "4 layers without the umbra" in (tmp_path / "report.html").read_text()


def test_thin_slabs_make_the_picture_that_peeling_makes(boxes):
    peeled = run(load_config(boxes, []), solving=False).picture
    slabs = run(load_config(boxes, ["render.slab_blur_px=0.5"]), solving=False).picture
    assert slabs.examined is None
    # Observed: equal.
    np.testing.assert_allclose(slabs.image, peeled.image, atol=1e-6)


def test_one_slab_leaves_surfaces_out_and_says_so(boxes, tmp_path):
    options = [*BEHIND, "--set", "render.slabs=1", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["render", str(boxes), *options])
    assert result.exit_code == 0, result.output
    assert "so that light from them is missing; raise render.slabs." in " ".join(result.output.split())


def test_layers_are_made_in_one_way(boxes):
    with pytest.raises(ConfigError, match="has slabs and slab_blur_px, each of which says how thick"):
        load_config(boxes, ["render.slab_blur_px=4", "render.slabs=4"])
    assert load_config(boxes, ["render.max_layers=4", "render.slabs=4"]).render.slabs == 4
