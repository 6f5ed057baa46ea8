"""The reference pages of packages and modules: every public name, from the packages' `__init__` files.

They are written into `docs/reference/generated` before Sphinx reads its sources: a page for each package, on
which autodoc documents each name and links follow to the pages whose code uses it, and a table of the names
of `focusjax` itself, each linked to its entry.
"""

import ast
import importlib
import inspect
import itertools
import re
from pathlib import Path

from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
ROOT = DOCS.parent
_CODE = re.compile(r"^`{3,}\{?(?:python|code-cell)[^\n]*\n(.*?)^`{3,}", re.MULTILINE | re.DOTALL)


def public_names(package: str) -> dict[str, str]:
    """The names that a package exports, by `from module import name as name`, with that module's package.

    Those of a module that is no package are the functions and classes that it defines.
    """
    tree = ast.parse(_source(package).read_text("utf-8"))
    if _source(package).name != "__init__.py":
        defined = (node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef))
        return {name: package for name in defined if not name.startswith("_")}
    return {
        alias.name: ".".join(node.module.split(".")[:2])
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("focusjax.")
        for alias in node.names
        if alias.asname == alias.name
    }


def public_packages() -> list[str]:
    """The packages below `focusjax`, and its modules that are no command and not private."""
    names = [path.parent.name for path in (ROOT / "focusjax").glob("*/__init__.py")]
    names += [path.stem for path in (ROOT / "focusjax").glob("[!_]*.py") if path.stem != "cli"]
    return [f"focusjax.{name}" for name in sorted(names)]


def _source(package: str) -> Path:
    path = ROOT.joinpath(*package.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def uses() -> dict[str, list[tuple[str, str]]]:
    """For every word in Python code of the site the pages it is on, with their titles."""
    found: dict[str, list[tuple[str, str]]] = {}
    for path in sorted(DOCS.rglob("*.md")):
        page = path.relative_to(DOCS).with_suffix("").as_posix()
        if page.startswith(("_", "reference")):
            continue
        text = path.read_text("utf-8")
        title = re.search(r"^# (.+)$", text, re.MULTILINE)
        for word in set(re.findall(r"\w+", "\n".join(_CODE.findall(text)))):
            found.setdefault(word, []).append((page, title[1] if title else page))
    return found


def package_page(package: str, used: dict[str, list[tuple[str, str]]]) -> str:
    """The page of a package, as reStructuredText."""
    module = importlib.import_module(package)
    lines = [f"``{package}``", "=" * (len(package) + 4), "", inspect.getdoc(module) or "", ""]
    lines += [f".. py:module:: {package}", "   :no-index-entry:", ""]
    # What comes from another public package is on the page of that.
    others = set(public_packages()) - {package}
    own = [name for name, home in public_names(package).items() if home not in others]
    for name in sorted(own, key=lambda each: (each.lower(), each)):
        value = getattr(module, name)
        if (kind := _kind(value)) == "data":
            lines += [f".. py:data:: {package}.{name}", "", *_indented(_comment(package, name)), ""]
        else:
            lines += [f".. auto{kind}:: {package}.{name}", ""]
        if pages := used.get(name):
            links = ", ".join(f":doc:`{title.replace('`', '')} </{page}>`" for page, title in pages[:4])
            lines += [f"   *Used on:* {links}.", ""]
    return "\n".join(lines)


def table_of_names() -> str:
    """All names of `focusjax` itself, each with the first sentence of its docstring."""
    title = "Names of ``focusjax``"
    lines = [title, "=" * len(title), "", "What a script needs: ``import focusjax as fj``.", ""]
    lines += [".. list-table::", "   :widths: 30 70", ""]
    for name, package in sorted(public_names("focusjax").items(), key=lambda pair: pair[0].lower()):
        text = inspect.getdoc(getattr(importlib.import_module(package), name)) or ""
        lines += [f"   * - :py:obj:`{name} <{package}.{name}>`", f"     - {text.splitlines()[0]}"]
    return "\n".join([*lines, ""])


def _kind(value: object) -> str:
    if inspect.isclass(value):
        return "exception" if issubclass(value, BaseException) else "class"
    return "function" if callable(value) else "data"


def _comment(package: str, name: str) -> str:
    """The text below a module's constant, where it is defined."""
    source = _source(package)
    for node in ast.walk(ast.parse(source.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and name in {alias.name for alias in node.names}:
            source = ROOT.joinpath(*node.module.split(".")).with_suffix(".py")
    body = ast.parse(source.read_text("utf-8")).body if source.exists() else []
    for node, after in itertools.pairwise(body):
        targets = getattr(node, "targets", None) or [getattr(node, "target", None)]
        names = {
            each.id for part in targets for each in ast.walk(part or ast.Pass()) if isinstance(each, ast.Name)
        }
        if name in names and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            return inspect.cleandoc(str(after.value.value))
    return ""


def _indented(text: str) -> list[str]:
    lines = text.splitlines()
    _plain_signs(None, "", "", None, None, lines)
    return [f"   {line}" for line in lines]


_CODE_OR_SIGN = re.compile(r"`[^`]*`|[|*]")
_SECTION = re.compile(r"(Args|Attributes|Returns|Yields|Raises|Examples?):$")


def _plain_signs(app, what, name, value, options, lines: list[str]) -> None:
    """Indented lines above the first section are formulas; elsewhere bars and asterisks are themselves."""
    del app, what, name, value, options
    found, above, formula = [], True, False
    for number, line in enumerate(lines):
        above = above and not _SECTION.match(line)
        if above and line.startswith("    "):
            if not formula and not lines[number - 1]:
                formula = True
                found += [".. code-block:: text", ""]
        elif line:
            formula = False
        if not formula and not line.lstrip().startswith((">>>", "...")):
            line = _CODE_OR_SIGN.sub(lambda sign: sign[0] if len(sign[0]) > 1 else "\\" + sign[0], line)
        found.append(line)
    lines[:] = found


def write(name: str, text: str) -> None:
    """Write a page of the reference, unless it is as it was."""
    path = DOCS / "reference" / "generated" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text("utf-8") != text:
        path.write_text(text, "utf-8")


def _write_all(app: Sphinx) -> None:
    del app
    used = uses()
    for package in public_packages():
        write(f"packages/{package.removeprefix('focusjax.')}.rst", package_page(package, used))
    write("names.rst", table_of_names())


def setup(app: Sphinx) -> dict[str, bool]:
    """Have the pages written."""
    app.connect("builder-inited", _write_all)
    # Before napoleon reads the sections.
    app.connect("autodoc-process-docstring", _plain_signs, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
