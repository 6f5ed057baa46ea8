"""What is imported when: a command or a name imports what it needs, and nothing else."""

import ast
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import focusjax
from focusjax._later import Later
from focusjax.cli import LATER, LATER_OF_BENCH

ROOT = Path(__file__).parents[1]

# For a solve, a file or a report only.
HEAVY = {
    "jaxopt", "jinja2", "matplotlib", "networkx", "optimistix", "rich", "scipy.interpolate",
    "scipy.ndimage", "scipy.optimize", "scipy.sparse", "scipy.spatial", "scipy.special", "scipy.stats",
    "skimage", "trimesh", "typer",
}  # fmt: skip


_BEFORE = "import json, sys\nbefore = set(sys.modules)"
_AFTER = "print(json.dumps(list(set(sys.modules) - before)))"


def modules_after(code):
    """Every module that a new process imports for `code`, those of Python apart."""
    done = subprocess.run(
        [sys.executable, "-c", f"{_BEFORE}\n{code}\n{_AFTER}"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    names = json.loads(done.stdout.splitlines()[-1])
    return {name for name in names if name.partition(".")[0] not in sys.stdlib_module_names}


def test_the_package_alone_imports_nothing():
    assert modules_after("import focusjax") == {"focusjax", "focusjax._begun"}


def test_public_names_import_neither_solvers_nor_readers_of_files():
    """Fits are classes of Optimistix's solvers, and import it."""
    code = "import focusjax\nfor name in set(focusjax.__all__) - set(focusjax._NAMES['inverse']):"
    imported = modules_after(f"{code}\n    getattr(focusjax, name)")
    assert {"jax", "equinox", "focusjax.focus", "focusjax.trace"} <= imported
    assert imported & HEAVY == set()


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["run", "--help"], ["bench", "--help"]])
def test_help_imports_no_numbers(words):
    code = f"import sys\nsys.argv = ['focusjax', *{words}]\nfrom focusjax.cli import main"
    imported = modules_after(f"{code}\ntry:\n    main()\nexcept SystemExit as end:\n    assert not end.code")
    assert "typer" in imported
    assert {name.partition(".")[0] for name in imported} & {"jax", "numpy", "scipy"} == set()
    assert {name for name in imported if name.startswith("focusjax.")} <= {
        "focusjax._begun", "focusjax._console", "focusjax._later", "focusjax._options", "focusjax._words",
        "focusjax.cli",
    }  # fmt: skip


def test_type_checkers_know_every_public_name():
    """A new name needs a row in `_NAMES` and an import for type checkers, both in focusjax/__init__.py."""
    tree = ast.parse((ROOT / "focusjax" / "__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {}
    assert ast.unparse(block.body[0]) == "__version__: str"
    for node in block.body[1:]:
        assert isinstance(node, ast.ImportFrom)
        assert [alias.asname for alias in node.names] == [alias.name for alias in node.names]
        seen.setdefault(node.module.removeprefix("focusjax."), []).extend(alias.name for alias in node.names)
    assert {package: tuple(names) for package, names in seen.items()} == focusjax._NAMES


def test_names_and_packages_are_found_and_listed():
    for name in focusjax.__all__:
        assert getattr(focusjax, name) is not None
        assert name in dir(focusjax)
    assert focusjax.lens.thin_lens is focusjax.thin_lens
    assert "lens" in dir(focusjax)
    with pytest.raises(AttributeError, match="module 'focusjax' has no attribute 'lense'"):
        _ = focusjax.lense


@pytest.mark.parametrize("name", [*LATER, *LATER_OF_BENCH])
def test_commands_of_packages_have_the_help_that_is_listed(name):
    later = (LATER | LATER_OF_BENCH)[name]
    assert isinstance(later, Later)
    said = importlib.import_module(later.module).command.__doc__
    assert " ".join(said.split("\n\n")[0].split()) == later.summary
