"""Code blocks of README and of the pages run as they stand, and the pages lead to what is there.

The notebooks below docs/tutorials run whenever the site is built; CONTRIBUTING's examples are run by
`test_contributing.py`.
"""

import re
import tomllib
from contextlib import chdir
from pathlib import Path

import imageio.v3 as iio
import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(page for page in DOCS.rglob("*.md") if "_build" not in page.parts)]
NOT_RUN = {
    "docs/studio.md": "the session of the studio is run by tests/studio",
    "docs/howto/focus_from_a_picture.md": "this is examples/fit_photo.py, which is run likewise",
    "docs/howto/python.md": "this is examples/spot.py, which is run by tests/test_configs_and_examples.py",
}
SMALLER = [
    ("width=640, height=480", "width=64, height=48"),
    ("width=160, height=120", "width=64, height=48"),
    ("width=96, height=72", "width=64, height=48"),
    ("rays=16", "rays=2"),
    ("rays=64", "rays=2"),
]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


WITH_PYTHON = [page for page in PAGES if blocks(page, "python") and name_of(page) not in NOT_RUN]


@pytest.mark.parametrize("page", WITH_PYTHON, ids=name_of)
def test_python_on_a_page_runs(page, tmp_path):
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    with chdir(tmp_path):
        for code in blocks(page, "python"):
            for large, small in SMALLER:
                code = code.replace(large, small)
            exec(compile(code, name_of(page), "exec"), {"__name__": name_of(page)})
    for picture in tmp_path.glob("*.png"):
        assert iio.imread(picture).mean() > 5


def test_what_is_not_run_is_there():
    """A page that has no code any more is no exception any more."""
    assert [name for name in NOT_RUN if not blocks(ROOT / name, "python")] == []


def test_the_page_on_python_is_an_example():
    (code,) = blocks(DOCS / "howto" / "python.md", "python")
    assert code == (ROOT / "examples" / "spot.py").read_text("utf-8")


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_configs_on_a_page_are_toml(page):
    for text in blocks(page, "toml"):
        tomllib.loads(text)


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= 150


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_page_leads_to_what_is_there(page):
    """Relative links, as they are followed where the files are read as they are."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link and link[0] != "#"]
    assert [link for link in links if not (page.parent / link.partition("#")[0]).exists()] == []
