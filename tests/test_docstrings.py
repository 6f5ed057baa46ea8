"""Examples in docstrings run and print what they say, and every public name has one."""

import ast
import doctest
import importlib
import inspect
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import focusjax as fj

ROOT = Path(fj.__file__).parent
NEEDED = {"focusjax.scene_files._read_camera": "pxr.Usd"}
"""What the examples of a module need and is not always installed."""
SLOW = {"FittedLens", "ImageFit", "autofocus", "fit_focal_surface", "fit_image", "scan_lenses"}
"""Public names whose examples are not run: fits to pictures, which take up to half a minute each, and
the lens that the example of `fitted_lens` makes."""


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def docstrings(node: ast.AST, name: str) -> Iterator[tuple[str, str, int]]:
    """Name, docstring and line of everything below `node` that has examples.

    They are read from the source, since decorators hide functions from `doctest.DocTestFinder`.
    """
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
        text = ast.get_docstring(node)
        if text is not None and ">>>" in text:
            yield name, text, node.body[0].lineno
    for child in ast.iter_child_nodes(node):
        yield from docstrings(child, f"{name}.{child.name}" if hasattr(child, "name") else name)


def with_examples() -> list[Path]:
    return [path for path in sorted(ROOT.rglob("*.py")) if ">>> " in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("path", with_examples(), ids=module_name)
def test_examples_print_what_they_say(path, tmp_path):
    name = module_name(path)
    if name in NEEDED:
        pytest.importorskip(NEEDED[name], reason=f"examples of {name} need it")
    # Files are written to a folder that is thrown away; configs are those of the repository.
    (tmp_path / "configs").symlink_to(ROOT.parent / "configs")
    names = {**vars(importlib.import_module(name)), "fj": fj, "np": np, "jnp": jnp}
    # Told to be quiet, as it would otherwise look for -v among pytest's own options.
    runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    found = list(docstrings(ast.parse(path.read_text(encoding="utf-8")), name))
    assert found
    said: list[str] = []
    for label, text, line in found:
        test = doctest.DocTestParser().get_doctest(text, dict(names), label, str(path), line)
        with chdir(tmp_path):
            runner.run(test, out=said.append)
    assert not said, "".join(said)


def test_every_public_name_has_an_example_that_runs():
    without, skipped = set(), set()
    for name in fj.__all__:
        value = getattr(fj, name)
        if not callable(value):
            continue
        examples = doctest.DocTestParser().get_examples(inspect.getdoc(value) or "")
        if not examples:
            without.add(name)
        elif all(doctest.SKIP in each.options for each in examples):
            skipped.add(name)
    assert not without
    assert skipped == SLOW
