"""Imports point one way, from the command line down to geometry."""

import ast
from pathlib import Path

import pytest

from focusjax import _sources

ROOT = Path(__file__).parents[1] / "focusjax"

# What each part of the package may import, besides itself. The order is the pipeline's.
ALLOWED = {
    "optics": {"_arguments", "_device", "_programs"},
    "geometry": {"_arguments", "_device"},
    "lens": {
        "geometry",
        "optics",
        "_arguments",
        "_counts",
        "_device",
        "_few",
        "_monotone_cubic",
        "_parallel",
        "_whole_file",
        "_words",
        "_programs",
    },
    "scene": {"geometry", "_arguments", "_device", "_kept", "_parallel", "_quiet_exr", "_words"},
    "photo": {"geometry", "scene", "_arguments"},
    "solvers": set(),
    "focus": {
        "geometry",
        "lens",
        "solvers",
        "_programs",
        "_arguments",
        "_counts",
        "_device",
        "_entries",
        "_settings",
        "_words",
    },
    "layers": {
        "geometry",
        "lens",
        "scene",
        "_arguments",
        "_at_once",
        "_counts",
        "_device",
        "_freed",
        "_parallel",
        "_quiet_exr",
        "_whole",
        "_words",
        "_zeros",
        "_programs",
    },
    "trace": {
        "geometry",
        "lens",
        "scene",
        "layers",
        "_arguments",
        "_at_once",
        "_counts",
        "_device",
        "_few",
        "_freed",
        "_parallel",
        "_whole",
        "_zeros",
        "_programs",
    },
    "shutter": {"geometry", "lens", "scene", "layers", "trace", "_arguments", "_counts", "_programs"},
    "motion": {"geometry", "scene", "shutter"},
    "film": {"geometry", "lens", "_arguments", "_device", "_monotone_cubic", "_words", "_programs"},
    "inverse": {"geometry", "lens", "layers", "trace", "_arguments", "_counts", "_programs"},
    "metrics": set(),
    # Slow or simple twins share no code with what they are compared with.
    "baselines": {"geometry", "lens", "scene", "_checked_view", "_counts", "_parallel", "_programs"},
    "post": {"geometry", "lens", "scene", "layers", "trace", "_checked_view", "_counts", "_programs"},
    "io": {"film", "_quiet_exr", "_whole_file"},
    "scene_files": {"scene", "_words"},
    "config": {
        "geometry",
        "lens",
        "scene",
        "photo",
        "scene_files",
        "_kept",
        "focus",
        "solvers",
        "trace",
        "film",
        "optics",
        "_words",
    },
    "_arguments": {"_words"},
    "_console": {"_words"},
    "_counts": {"_arguments"},
    "_device": set(),
    "_entries": set(),
    "_freed": {"_programs"},
    "_kept": set(),
    "_monotone_cubic": set(),
    "_quiet_exr": set(),
    "_whole_file": set(),
    "_words": set(),
    "_parallel": set(),
    "_begun": set(),
    "_program_files": set(),
    "_programs": {"_program_files", "_sources"},
    "_sources": {"_begun"},
    "_at_once": set(),
    "_few": set(),
    "_whole": set(),
    "_zeros": set(),
    "_settings": set(),
    "_checked_view": {"geometry"},
    "_stopwatch": set(),
    "job": {
        "geometry",
        "lens",
        "scene",
        "photo",
        "focus",
        "layers",
        "trace",
        "shutter",
        "motion",
        "film",
        "post",
        "config",
        "_arguments",
        "_device",
        "_freed",
        "_settings",
        "_stopwatch",
        "_programs",
    },
    "report": {"geometry", "lens", "focus", "io", "config", "job", "_settings", "_templates"},
    "bench": {
        "geometry",
        "lens",
        "scene",
        "layers",
        "trace",
        "film",
        "metrics",
        "baselines",
        "post",
        "io",
        "config",
        "job",
        "_console",
        "_options",
        "_progress",
        "_templates",
        "_words",
        "_programs",
    },
    "hard_cases": {
        "geometry",
        "optics",
        "lens",
        "scene",
        "focus",
        "layers",
        "trace",
        "baselines",
        "io",
        "_console",
        "_freed",
        "_templates",
        "_programs",
    },
    "starter": {"config", "io"},
    "many": {"io", "_console", "_freed", "_parallel"},
    "stack": {"geometry", "focus", "io", "config", "job", "report", "many", "_console", "_options"},
    "dataset": {
        "geometry",
        "lens",
        "scene",
        "layers",
        "trace",
        "io",
        "config",
        "many",
        "__version__",
        "_console",
        "_options",
    },
    "batch": {"io", "config", "job", "report", "many", "_console", "_options", "_templates"},
    "shot": {
        "many",
        "geometry",
        "lens",
        "scene",
        "focus",
        "layers",
        "trace",
        "shutter",
        "motion",
        "film",
        "io",
        "config",
        "job",
        "report",
        "_device",
        "_stopwatch",
        "_templates",
        "_words",
        "_programs",
    },
    "charts": {"geometry", "optics", "lens", "io", "_console", "_programs"},
    "exchange": {
        "geometry",
        "optics",
        "lens",
        "io",
        "config",
        "job",
        "shot",
        "_arguments",
        "_console",
        "_options",
        "_progress",
        "_words",
        "_programs",
    },
    "studio": {
        "geometry",
        "lens",
        "scene",
        "focus",
        "layers",
        "trace",
        "film",
        "post",
        "inverse",
        "io",
        "config",
        "exchange",
        "job",
        "report",
        "shot",
        "_console",
        "_freed",
        "_options",
        "_photo_options",
        "_refocus",
        "_settings",
        "_whole_file",
        "_programs",
    },
    "_show": {"focus", "lens", "layers", "scene", "trace", "film", "_arguments", "_settings"},
    "_print_keys": {"config"},
    "_summary": {"focus", "lens", "job", "report", "shot", "_console", "_words"},
    "_photo_options": set(),
    "_refocus": {"config", "photo"},
    "_later": set(),
    "_options": set(),
    "_progress": {"job", "_console"},
    "_templates": set(),
    "_carry_out": {
        "io",
        "config",
        "job",
        "many",
        "report",
        "shot",
        "_console",
        "_program_files",
        "_progress",
        "_summary",
    },
    # Commands import what they need when they run; those of packages are in its table.
    "__main__": {"cli"},
    "cli": {
        "__version__",
        "config",
        "io",
        "starter",
        "_carry_out",
        "_console",
        "_later",
        "_options",
        "_photo_options",
        "_refocus",
        "_print_keys",
    },
}
# The public face re-exports from everywhere below the command line.
ALLOWED["__init__"] = {
    "_begun",
    "_show",
    "exchange",
    "film",
    "focus",
    "geometry",
    "inverse",
    "io",
    "job",
    "layers",
    "lens",
    "optics",
    "photo",
    "scene",
    "scene_files",
    "trace",
}


def part_of(path: Path) -> str:
    """The subpackage, or the module directly under focusjax, that a file belongs to."""
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def imported_parts(path: Path) -> set[str]:
    """The parts of focusjax that a file imports, wherever in the file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} uses a relative import; name the package"
            names = [node.module or ""]
            if node.module == "focusjax":
                names = [f"focusjax.{alias.name}" for alias in node.names]
        else:
            continue
        found |= {name.split(".")[1] for name in names if name.startswith("focusjax.")}
    return found


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path):
    part = part_of(path)
    assert part in ALLOWED, f"say in this test what focusjax.{part} may import"
    assert imported_parts(path) <= ALLOWED[part] | {part}


def test_programs_go_by_the_imports_that_python_finds():
    """`_sources` looks for lines, which is quicker; where it cannot say which, it says all."""
    everything = _sources._all_parts()
    for path in ROOT.rglob("*.py"):
        parts = imported_parts(path)
        assert _sources._imported(path.read_text()) == (parts if parts <= everything else everything), path


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda path: str(path.relative_to(ROOT)))
def test_private_modules_are_imported_within_their_own_package_only(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("focusjax."):
            parts = (node.module or "").split(".")[1:]
            private = [number for number, step in enumerate(parts) if step.startswith("_")]
            if private and private[0] > 0:
                assert path.relative_to(ROOT).parts[: private[0]] == tuple(parts[: private[0]])
