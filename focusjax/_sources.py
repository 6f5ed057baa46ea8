"""Which sources of focusjax a function is made of: those of its package, and of all packages that it imports.

Imports point one way (CONTRIBUTING.md), so that most packages need few of the others: what is made of them
stays as it is while the others change.
"""

import functools
import hashlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from focusjax._begun import BEGUN

_ROOT = Path(__file__).parent
_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+focusjax\b(?:\.(\w+)|(.*))", re.MULTILINE)
"""An import at any place of a file: of a package or module of focusjax, or of what follows from focusjax."""


def sources_of(modules: Iterable[str]) -> str:
    """A hash that changes with every file that `modules` are made of, by dotted names; others do not count.

    Files that are no Python belong to the package whose folder they are in.
    """
    contents = "".join(f"{part}={_read(part).contents};" for part in _needed(modules))
    return hashlib.sha256(contents.encode()).hexdigest()


def are_as_begun(modules: Iterable[str]) -> bool:
    """Whether no file that `modules` are made of has changed since the process began.

    Otherwise what was imported and what `sources_of` read may be before and after the change.
    """
    try:
        stats = [path.stat() for part in _needed(modules) for path in _read(part).files]
    except OSError:
        return False
    return all(max(stat.st_mtime, stat.st_ctime) <= BEGUN for stat in stats)


def _needed(modules: Iterable[str]) -> list[str]:
    """Of `_all_parts`, those that `modules` are in, and all that these import."""
    left = [part for module in modules for part in _parts_of(module)]
    found = set(left)
    while left:
        new = _read(left.pop()).imported - found
        found |= new
        left += new
    return sorted(found)


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


class _Part(NamedTuple):
    """One of `_all_parts`.

    Attributes:
        files: that it consists of.
        contents: a hash of them.
        imported: other parts.
    """

    files: tuple[Path, ...]
    contents: str
    imported: frozenset[str]


@functools.cache
def _read(part: str) -> _Part:
    """One of `_all_parts`, as its files are at the first call."""
    single = _ROOT / f"{part}.py"
    listed = [single] if single.exists() else sorted((_ROOT / part).rglob("*"))
    files = tuple(path for path in listed if path.is_file() and path.suffix != ".pyc")
    contents, imported = hashlib.sha256(), set()
    for path in files:
        content = path.read_bytes()
        contents.update(f"{path.relative_to(_ROOT)}\0{len(content)}\0".encode() + content)
        if path.suffix == ".py":
            imported |= _imported(content.decode())
    return _Part(files, contents.hexdigest(), frozenset(imported))


def _imported(source: str) -> set[str]:
    """Of `_all_parts`, those that a source imports, at its beginning or within functions."""
    imported = set()
    for part, names in _IMPORT.findall(source):
        named = {part} if part else set(re.findall(r"(\w+)(?: as \w+)?", names.partition("import")[2]))
        # Other names of focusjax itself may come from anywhere.
        imported |= named if named and named <= _all_parts() else _all_parts()
    return imported
