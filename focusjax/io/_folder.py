"""Output folders and files that never hold half of what they should."""

import contextlib
import errno
import itertools
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from focusjax.io._sole_use import sole_use

UNFINISHED = ".unfinished-"
"""How the names of temporary folders start."""


@contextlib.contextmanager
def staged_folder(path: Path | str, *, owned: Sequence[str] = ()) -> Iterator[Path]:
    """A temporary folder whose files move into the folder `path` when the block ends well.

    The temporary folder lies inside `path`, so that each move is one atomic rename; files of the same
    name from an earlier run are replaced. When the block raises, nothing in `path` changes, and the
    folders that were made for it are removed again. Nobody else may write to `path` meanwhile: of two runs
    into one folder the second is refused, so that it holds all of one and nothing of the other.

    Args:
        path: the output folder.
        owned: names of files that belong to a run; those of an earlier one that this one does not
            make again are removed, so that a folder never mixes two runs.

    Raises:
        FolderInUseError: on entry, when another run is writing to `path`.
        ValueError: on entry, when `path` cannot be made or written to.
    """
    path = Path(path)
    made = _missing_folders(path)
    with contextlib.ExitStack() as held:
        try:
            path.mkdir(parents=True, exist_ok=True)
            held.enter_context(sole_use(path))
            stage = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=path))
        except OSError as error:
            _remove_empty(made)
            raise ValueError(
                f"output folder {path} is not writable ({error.strerror}); choose another with --out"
            ) from error
        yield from _moved_when_done(path, stage, owned, made)


def _moved_when_done(path: Path, stage: Path, owned: Sequence[str], made: list[Path]) -> Iterator[Path]:
    made_now: list[str] = []
    try:
        yield stage
        for file in sorted(stage.iterdir()):
            os.replace(file, path / file.name)
            made_now.append(file.name)
        for name in set(owned).difference(made_now):
            (path / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(made)


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder that becomes the folder `path`, all of it at once, when the block ends well.

    It lies beside `path`, in a folder named `.unfinished-...`; a process that is killed leaves at most that
    behind. An older folder `path` is replaced. When the block raises, nothing changes.

    Args:
        path: a folder whose parent exists.
    """
    apart = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=path.parent))
    try:
        # Its own permissions, not those of a temporary folder.
        stage = apart / "new"
        stage.mkdir()
        yield stage
        for attempt in itertools.count():
            if path.exists():
                # Somebody else may take it away first, who makes the same.
                with contextlib.suppress(FileNotFoundError):
                    os.replace(path, apart / f"old{attempt}")
            try:
                os.replace(stage, path)
                return
            except OSError as error:
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
    finally:
        shutil.rmtree(apart, ignore_errors=True)


def _missing_folders(path: Path) -> list[Path]:
    """The folders that have to be made for `path`, innermost first."""
    return [folder for folder in (path, *path.parents) if not folder.exists()]


def _remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        with contextlib.suppress(OSError):
            folder.rmdir()
