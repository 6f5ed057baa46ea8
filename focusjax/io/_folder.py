"""An output folder that never holds half a run."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def staged_folder(path: Path | str) -> Iterator[Path]:
    """A temporary folder whose files move into the folder `path` when the block ends well.

    The temporary folder lies inside `path`, so that each move is one atomic rename; files of the same
    name from an earlier run are replaced. When the block raises, nothing in `path` changes, and the
    folders that were made for it are removed again.

    Raises:
        ValueError: on entry, when `path` cannot be made or written to.
    """
    path = Path(path)
    made = _missing_folders(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        stage = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=path))
    except OSError as error:
        _remove_empty(made)
        raise ValueError(
            f"output folder {path} is not writable ({error.strerror}); choose another with --out"
        ) from error
    try:
        yield stage
        for file in sorted(stage.iterdir()):
            os.replace(file, path / file.name)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(made)


def _missing_folders(path: Path) -> list[Path]:
    """The folders that have to be made for `path`, innermost first."""
    return [folder for folder in (path, *path.parents) if not folder.exists()]


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()
