"""Text files that are never half written."""

import os
from pathlib import Path


def replace_file(path: Path, text: str) -> None:
    """Write `text` to the file `path`, which has all of the old or all of the new text at any time."""
    new = path.with_name(f".{path.name}.new")
    # Line ends are as in the text: CSV has its own.
    new.write_text(text, encoding="utf-8", newline="")
    os.replace(new, path)
