"""The keys of a config on the terminal: tables to read, or lines for other programs."""

import itertools
from collections.abc import Sequence

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from focusjax.config import ConfigKey

_HEADINGS = ("key", "type", "unit", "default", "meaning")


def print_keys(console: Console, keys: Sequence[ConfigKey]) -> None:
    """A table for each table of the config; where output is no terminal, a line for each key with tabs."""
    if not console.is_terminal:
        # Not by rich, which makes spaces of tabs.
        for row in (_HEADINGS, *((key.path, *_cells(key)) for key in keys)):
            typer.echo("\t".join(row))
        return
    for (heading, variant, about), group in itertools.groupby(keys, _table_of):
        console.print()
        console.print(Text(f"{heading} {variant}".strip(), "bold"), Text(_without_heading(about), "dim"))
        table = Table(box=None, header_style="dim", pad_edge=False)
        for name in _HEADINGS:
            table.add_column(name, overflow="fold", ratio=2 if name == "meaning" else None)
        for key in group:
            table.add_row(*(Text(cell) for cell in (key.name, *_cells(key))))
        console.print(table)


def _table_of(key: ConfigKey) -> tuple[str, str, str]:
    return key.heading, key.variant, key.about


def _cells(key: ConfigKey) -> tuple[str, str, str, str]:
    return key.type, key.unit, "required" if key.required else key.default, key.meaning


def _without_heading(about: str) -> str:
    """What a table is for, whose name in backticks has been said already."""
    _, colon, rest = about.partition(": ")
    return rest if colon and about.startswith("`") else about
