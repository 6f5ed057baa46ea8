"""Sources that functions are made of: all that is imported counts, and nothing else."""

import os
from pathlib import Path

import pytest

from focusjax import _sources
from focusjax._sources import are_as_begun, sources_of

FILES = {
    "__init__.py": "",
    "low.py": "",
    "base/__init__.py": "",
    "base/_base.py": "import focusjax.low",
    "base/table.csv": "1",
    "middle/__init__.py": "from focusjax.middle._middle import thing",
    "middle/_middle.py": "def thing():\n    from focusjax.base import _base",
    "beside.py": "",
    "top.py": "from focusjax import middle as between, beside",
    "any.py": "from focusjax import thing",
}


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A small package of the same name, read anew."""
    package = tmp_path / "focusjax"
    for name, content in FILES.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(content)
    monkeypatch.setattr(_sources, "_ROOT", package)
    forget()
    yield package
    forget()


def forget() -> None:
    """Files are read again."""
    _sources._read.cache_clear()
    _sources._all_parts.cache_clear()


@pytest.mark.parametrize(
    ("module", "made_of"),
    [
        ("focusjax.low", {"low.py"}),
        ("focusjax.base._base", {"low.py", "base/__init__.py", "base/_base.py", "base/table.csv"}),
        ("focusjax.middle", {each for each in FILES if each.startswith(("low", "base", "middle"))}),
        ("focusjax.top", FILES.keys() - {"__init__.py", "any.py"}),
        ("focusjax.any", FILES.keys()),
        ("focusjax", FILES.keys()),
        ("numpy.linalg", set()),
    ],
)
def test_it_changes_with_what_a_module_is_made_of_alone(root: Path, module: str, made_of: set[str]):
    before = sources_of([module])
    assert before == sources_of([module, "numpy", module])
    changed = set()
    for name in FILES:
        content = (root / name).read_text()
        (root / name).write_text(content + "\n#")
        forget()
        if sources_of([module]) != before:
            changed.add(name)
        (root / name).write_text(content)
    assert changed == made_of


def test_a_file_more_and_a_file_less_are_changes(root: Path):
    before = sources_of(["focusjax.base"])
    (root / "base" / "more.py").write_text("")
    forget()
    assert sources_of(["focusjax.base"]) != before
    (root / "base" / "more.py").unlink()
    forget()
    assert sources_of(["focusjax.base"]) == before


def test_a_change_since_the_process_began_is_seen(root: Path, monkeypatch: pytest.MonkeyPatch):
    long_ago = _sources.BEGUN - 1000.0
    monkeypatch.setattr(_sources, "BEGUN", (root / "top.py").stat().st_ctime + 1000.0)
    sources_of(["focusjax.top"])
    assert are_as_begun(["focusjax.top"])
    os.utime(root / "any.py", (long_ago, _sources.BEGUN + 1000.0))
    assert are_as_begun(["focusjax.top"])
    os.utime(root / "base" / "_base.py", (long_ago, _sources.BEGUN + 1000.0))
    assert not are_as_begun(["focusjax.top"])
    assert are_as_begun(["focusjax.beside"])
