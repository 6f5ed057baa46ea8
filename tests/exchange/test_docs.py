"""What docs/exchange.md shows runs."""

import re
import shlex
from contextlib import chdir
from pathlib import Path

import pytest
from typer.testing import CliRunner

from focusjax.cli import app

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "exchange.md").read_text()
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_run(line, tmp_path):
    words = shlex.split(line)
    assert words[:2] == ["focusjax", "export"]
    out = tmp_path / Path(words[words.index("--out") + 1]).name
    words[words.index("--out") + 1] = str(out)
    small = ["--set", "camera.resolution=[48, 36]"]
    if "--shot" in words:
        # Wishes and keyframes for frames beyond the last are reported, and left.
        small += ["--set", "shot.frames=3"]
    with chdir(ROOT):
        done = CliRunner().invoke(app, [*words[1:], *small])
    assert done.exit_code == 0, done.output
    assert out.exists()


def test_python_runs(tmp_path):
    with chdir(tmp_path):
        for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
            exec(compile(block, "exchange.md", "exec"), {})
    assert (tmp_path / "camera.usda").exists()
    assert (tmp_path / "layers.exr").exists()
