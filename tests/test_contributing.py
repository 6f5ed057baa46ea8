"""The worked examples of CONTRIBUTING.md run as they stand there, and each is short."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
SECTIONS = {
    section.partition("\n")[0]: re.findall(r"^```(python|diff)\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    for section in re.split(r"^## ", TEXT, flags=re.MULTILINE)
}
EXAMPLES = {title: blocks for title, blocks in SECTIONS.items() if blocks}
IN_PROCESS = [title for title, blocks in EXAMPLES.items() if all(kind == "python" for kind, _ in blocks)]
PATCHES = [title for title in EXAMPLES if title not in IN_PROCESS]


def test_there_is_an_example_for_each_common_addition():
    assert list(EXAMPLES) == [
        "Add an aberration", "Add a kind of wish", "Add a config key", "Solve for a parameter of your own",
        "Add a film",
    ]  # fmt: skip
    assert PATCHES == ["Add a kind of wish", "Add a config key"]


@pytest.mark.parametrize("title", EXAMPLES)
def test_an_example_is_short(title):
    assert sum(code.count("\n") for _, code in EXAMPLES[title]) < 60


@pytest.mark.parametrize("title", IN_PROCESS)
def test_an_example_runs(title, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _, code in EXAMPLES[title]:
        exec(compile(code, title, "exec"), {"__name__": title})


def test_the_patches_apply_and_do_what_they_say(tmp_path):
    """To a copy of the package, one after the other, and their code runs with it."""
    patch = shutil.which("patch")
    assert patch, "the examples are patches; install the program patch"
    shutil.copytree(ROOT / "focusjax", tmp_path / "focusjax", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    code = []
    for title in PATCHES:
        for kind, text in EXAMPLES[title]:
            if kind == "python":
                code.append(text)
                continue
            command = [patch, "-p1", "--no-backup-if-mismatch"]
            done = subprocess.run(
                command, input=text, text=True, cwd=tmp_path, capture_output=True, check=False
            )
            assert done.returncode == 0, f"{title}: {done.stdout}"
    (tmp_path / "check.py").write_text("\n".join(code), "utf-8")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "check.py"],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_citation_is_complete():
    """What CFF 1.2 demands; without a version, which tags have."""
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    for key in ("cff-version: 1.2.0", "message: ", "title: ", "authors:", "license: Apache-2.0"):
        assert re.search(rf"^{re.escape(key)}", text, re.MULTILINE), key
