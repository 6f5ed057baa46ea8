"""Every script can be imported, and those that take options say which."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "scripts").glob("*.py"))
OPTIONAL = {"bpy", "mitsuba", "oidn", "optiland", "lensfunpy"}
"""Packages that some scripts need beside those of the tests."""

RUN = """
import contextlib, io, json, runpy, sys
said = {}
for path in sys.argv[1:]:
    options = "parse_args(" in open(path).read()
    sys.argv = [path, "--help"]
    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out):
            runpy.run_path(path, run_name="__main__" if options else "imported")
        said[path] = ["imported", ""]
    except SystemExit as end:
        said[path] = [f"left with {end.code}", out.getvalue()]
    except ModuleNotFoundError as error:
        said[path] = ["missing", error.name.partition(".")[0]]
    except Exception as error:
        said[path] = [f"{type(error).__name__}: {error}", ""]
print(json.dumps(said))
"""


@pytest.fixture(scope="module")
def said():
    """What became of each script, all in one process of their own."""
    done = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, SCRIPTS)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "scripts")])},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_can_be_imported_and_lists_its_options(said, script):
    state, rest = said[str(script)]
    if state == "missing" and rest in OPTIONAL:
        pytest.skip(f"{rest} is not installed")
    if "parse_args(" not in script.read_text():
        assert state == "imported"
        return
    assert state == "left with 0", rest
    assert "usage:" in rest
