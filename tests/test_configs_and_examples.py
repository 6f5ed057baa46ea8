"""Everything README shows and every config shipped runs, at small size."""

import json
import re
import tomllib
from pathlib import Path

import imageio.v3 as iio
import pytest
from typer.testing import CliRunner

from focusjax.cli import app

ROOT = Path(__file__).parents[1]
CONFIGS = sorted((ROOT / "configs").glob("*.toml"))
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_config_runs(path, tmp_path):
    small = ["camera.resolution=[48, 36]", "render.rays=2", "render.supersampling=1"]
    options = [part for override in small for part in ("--set", override)]
    result = CliRunner().invoke(app, ["run", str(path), "--out", str(tmp_path), *options])
    # Blur is wished in pixels, so a wish may be out of reach in so small a picture.
    assert result.exit_code in (0, 3), result.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["solver"]["status"] == "solved"
    assert report["picture"]["layers_complete"]
    assert iio.imread(tmp_path / "image.png").std() > 10


def test_there_are_four_configs_of_full_size():
    assert [path.stem for path in CONFIGS] == ["bars", "focal_surface", "still_life", "town"]
    for path in CONFIGS:
        width, height = tomllib.loads(path.read_text())["camera"]["resolution"]
        assert width >= 640
        assert height >= 480


def test_example_runs_at_small_size(tmp_path, monkeypatch):
    source = (ROOT / "examples" / "spot.py").read_text()
    small = source.replace("width=640, height=480", "width=64, height=48").replace("rays=64", "rays=2")
    small = small.replace("AtPixel(290, 190)", "AtPixel(29, 19)").replace('"configs/', f'"{ROOT}/configs/')
    assert small.count("rays=2") == small.count("width=64") == small.count("AtPixel(29,") == 1
    monkeypatch.chdir(tmp_path)
    exec(compile(small, "spot.py", "exec"), {})
    assert iio.imread("spot.png").shape == (48, 64, 3)


def test_readme_shows_the_example_as_it_is():
    assert (ROOT / "examples" / "spot.py").read_text() in README


def test_readme_shows_the_still_life_as_it_is():
    shown = tomllib.loads(re.search(r"```toml\n(.*?)```", README, re.DOTALL)[1])
    config = tomllib.loads((ROOT / "configs" / "still_life.toml").read_text())
    assert shown["solve"] == config["solve"]
    assert shown["lens"].items() <= config["lens"].items()
    for part, whole in zip(shown["focus"], config["focus"], strict=True):
        assert part.items() <= whole.items()


def test_everything_readme_links_to_is_there():
    links = re.findall(r"\]\(([^)]+)\)", README)
    local = [link for link in links if "://" not in link]
    assert "docs/still_life.png" in local
    assert [link for link in local if not (ROOT / link).exists()] == []
