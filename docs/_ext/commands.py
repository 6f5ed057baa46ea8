"""The reference of the command line, from its own help: `docs/reference/generated/commands.rst`."""

from typing import Any

import typer
from public_names import write
from sphinx.application import Sphinx

from focusjax.cli import app as program


def page() -> str:
    """Every command with its arguments and options."""
    lines = ["Commands", "========", ""]
    lines += _group("focusjax", typer.main.get_command(program))
    return "\n".join(lines)


def _group(name: str, command: Any) -> list[str]:
    lines = _command(name, command)
    for each in getattr(command, "commands", {}).values():
        lines += _group(f"{name} {each.name}", each)
    return lines


def _command(name: str, command: Any) -> list[str]:
    lines = [f"``{name}``", "-" * (len(name) + 4), "", _plain(command.help), ""]
    for each in command.params:
        if getattr(each, "hidden", False):
            continue
        words = ", ".join(each.opts) if each.param_type_name == "option" else (each.name or "").upper()
        help_text = _plain(getattr(each, "help", "") or "")
        lines += [f"``{words}``", f"    {help_text or '…'}", ""]
    return lines


def _plain(text: str | None) -> str:
    r"""Help as one paragraph, with nothing that reStructuredText would take for its own."""
    joined = " ".join((text or "").replace("\\[", "[").split())
    return joined.replace("*", r"\*").replace("`", "").replace("|", r"\|").replace("_ ", r"\_ ")


def setup(app: Sphinx) -> dict[str, bool]:
    """Have the page written."""
    app.connect("builder-inited", lambda _: write("commands.rst", page()))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
