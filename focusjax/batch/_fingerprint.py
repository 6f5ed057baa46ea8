"""What an item's result depends on, by which an earlier result that is out of date is recognised."""

import hashlib
import json
from pathlib import Path
from typing import Any

from focusjax.config import Config, texts
from focusjax.io import differing_keys, for_json

_SHOWN = 3


class Fingerprints:
    """Makes fingerprints; each file is read once.

    A fingerprint is the config with everything changed that is to be changed, a hash of every file that it
    names, and whether pictures are made, as values that JSON holds. What a mesh file refers to in its turn
    is not looked at.
    """

    def __init__(self) -> None:
        self._hashes: dict[Path, str] = {}

    def of(self, config: Config, *, solve_only: bool) -> dict[str, Any]:
        """The fingerprint of one item."""
        # Through JSON, so that it compares equal to one that was saved.
        values = json.loads(json.dumps(for_json(config.model_dump(mode="python", by_alias=True))))
        folder = config.source.parent
        files = {text: self._hash(folder / text) for text in sorted(set(texts([values])))}
        return {
            "solve_only": solve_only,
            "config": values,
            "files": {text: digest for text, digest in files.items() if digest},
        }

    def _hash(self, path: Path) -> str:
        """Of the file's bytes; "" where there is no such file."""
        if path not in self._hashes:
            try:
                # Most texts in a config name no file.
                self._hashes[path] = _digest(path) if path.is_file() else ""
            except OSError:
                self._hashes[path] = ""
        return self._hashes[path]


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def changed_since(old: dict[str, Any], new: dict[str, Any]) -> str:
    """What differs between two fingerprints, in words; "" where nothing does."""
    if old == new:
        return ""
    keys = differing_keys(old.get("config"), new["config"])
    keys += [f"the file {text}" for text in differing_keys(old.get("files"), new["files"])]
    if keys:
        more = len(keys) - _SHOWN
        listed = ", ".join(keys[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
        return f"{listed} {'has' if len(keys) == 1 else 'have'} changed"
    if old.get("solve_only") == (not new["solve_only"]):
        return "it had a picture made" if new["solve_only"] else "it was solved without a picture"
    return "nothing is known of how it was done"
