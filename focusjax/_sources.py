"""Which sources of focusjax a function is made of: those of its package, and of all packages that it imports.

Imports point one way (CONTRIBUTING.md), so that most packages need few of the others: what is made of them
stays as it is while the others change.
"""

import functools
import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

_ROOT = Path(__file__).parent
_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+focusjax\b(?:\.(\w+)|(.*))", re.MULTILINE)
"""An import at any place of a file: of a package or module of focusjax, or of what follows from focusjax."""


def sources_of(modules: Iterable[str]) -> str:
    """A hash that changes with every file that `modules` are made of, by dotted names; others do not count.

    Files that are no Python belong to the package whose folder they are in.
    """
    parts = sorted(_needed({part for module in modules for part in _parts_of(module)}))
    return hashlib.sha256("".join(f"{part}={_read(part)[1]};" for part in parts).encode()).hexdigest()


def _needed(parts: set[str]) -> set[str]:
    """`parts` and all that they import."""
    found, left = set(parts), list(parts)
    while left:
        new = _read(left.pop())[0] - found
        found |= new
        left += new
    return found


def _parts_of(module: str) -> frozenset[str]:
    """The package or module directly in focusjax that a dotted name belongs to; all of them for focusjax."""
    package, _, rest = module.partition(".")
    if package != _ROOT.name:
        return frozenset()
    return frozenset({rest.split(".")[0]}) if rest else _all_parts()


@functools.cache
def _all_parts() -> frozenset[str]:
    return frozenset(
        path.stem for path in _ROOT.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    )


@functools.cache
def _read(part: str) -> tuple[frozenset[str], str]:
    """What one of `_all_parts` imports, and a hash of its files."""
    single = _ROOT / f"{part}.py"
    files = [single] if single.exists() else sorted((_ROOT / part).rglob("*"))
    contents, imported = hashlib.sha256(), set()
    for path in files:
        if not path.is_file() or path.suffix == ".pyc":
            continue
        content = path.read_bytes()
        contents.update(f"{path.relative_to(_ROOT)}\0{len(content)}\0".encode() + content)
        if path.suffix == ".py":
            imported |= _imported(content.decode())
    return frozenset(imported), contents.hexdigest()


def _imported(source: str) -> set[str]:
    """Of `_all_parts`, those that a source imports, at its beginning or within functions."""
    imported = set()
    for part, names in _IMPORT.findall(source):
        named = {part} if part else set(re.findall(r"\w+", names.partition("import")[2]))
        # Other names of focusjax itself may come from anywhere.
        imported |= named if named and named <= _all_parts() else _all_parts()
    return imported
