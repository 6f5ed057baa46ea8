"""Which files a config may name: those below a folder, and those that the command line names itself."""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any


@dataclasses.dataclass(frozen=True)
class Reach:
    """Where a config's files may lie.

    Attributes:
        source: the config's file, at whose folder relative paths start.
        root: the folder below which files must lie; None for the config's own.
        named: texts of the command line, which may name files anywhere.
    """

    source: Path = Path()
    root: Path | None = None
    named: frozenset[str] = frozenset()

    def file(self, name: str, key: str) -> Path:
        """The path of a file that the config names: relative to the config, and within the root.

        Args:
            name: as the config has it.
            key: where, for the message.

        Raises:
            ValueError: a path that leads out of the root, and that the command line does not name.
        """
        path, root = self.source.parent / name, self._folder().resolve()
        if name not in self.named and not path.resolve().is_relative_to(root):
            raise ValueError(
                f"{key} is {name!r}, outside the folder {root}, below which a config may name files; move it"
                " there, or allow more with --root DIR"
            )
        return path

    def folders(self, name: str) -> tuple[Path, ...]:
        """The folders from which what a file of the config names in its turn may be read."""
        own = self._folder()
        return (own, (self.source.parent / name).parent) if name in self.named else (own,)

    def _folder(self) -> Path:
        return self.source.parent if self.root is None else self.root


def texts(values: Sequence[Any]) -> Iterator[str]:
    """Every text within values."""
    for value in values:
        if isinstance(value, str):
            yield value
        elif isinstance(value, dict | list):
            yield from texts(list(value.values()) if isinstance(value, dict) else value)
