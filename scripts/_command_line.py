"""What scripts share of their command line: options, tables, and files of results."""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table


def make_parser(description: str | None) -> argparse.ArgumentParser:
    """A parser whose help shows the description as it stands."""
    return argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def make_table(title: str, *headings: str, left: int = 1, **style: Any) -> Table:
    """A table whose first `left` columns hold words, and the others numbers."""
    table = Table(title=title, **style)
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number < left else "right")
    return table


def write_json(file: Path | None, content: Any) -> None:
    """Write results to `file` if one is given; its folder is made."""
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(content, indent=1) + "\n")


def kept(file: Path | None, make: Callable[[], np.ndarray]) -> np.ndarray:
    """What `make` returns; kept in `file` if one is given, and read from there if it exists."""
    if file is not None and file.exists():
        return np.load(file)
    made = make()
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, made)
    return made
