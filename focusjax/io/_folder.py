"""Output folders and files that never hold half of what they should, with one writer at a time."""

import contextlib
import errno
import itertools
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks.
    fcntl = None

UNFINISHED = ".unfinished-"
"""How the names of temporary folders start."""
_STAGE = f"{UNFINISHED}run-"
"""Of those that `staged_folder` makes inside a folder that it has for itself."""
_ARRIVING = ".arriving"
"""In an output folder: files that are finished, and are being moved to their places."""
_OLD = ".old"
"""Among these: the names, as JSON, of files of an older run that go."""


class FolderInUseError(ValueError):
    """Another process, or another run in this one, writes to the folder."""


@contextlib.contextmanager
def sole_use(folder: Path) -> Iterator[bool]:
    """Hold a lock on an existing folder, which the system lets go when this process ends, however it ends.

    The lock is on the folder itself, so that no file is left behind. It is advisory: those who do not ask for
    it are not kept out. What is given is whether there is such a lock: Windows has none.

    Raises:
        FolderInUseError: somebody else holds it.
        OSError: the folder cannot be opened, or was removed meanwhile.
    """
    if fcntl is None:
        yield False
        return
    in_use = f"another run is writing to {folder}; wait for it, or choose another with --out"
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FolderInUseError(in_use) from None
        # A run that failed may have removed the folder between the two calls, and a third have made it anew.
        if not os.path.samestat(os.fstat(handle), os.stat(folder)):
            raise FolderInUseError(in_use)
        yield True
    finally:
        os.close(handle)


@contextlib.contextmanager
def staged_folder(path: Path | str, *, owned: Sequence[str] = ()) -> Iterator[Path]:
    """A temporary folder whose files move into the folder `path` when the block ends well.

    Files of the same name from an earlier run are replaced. When the block raises, nothing in `path` changes,
    and the folders that were made for it are removed again. Nobody else may write to `path` meanwhile: of two
    runs into one folder the second is refused, so that it holds all of one and nothing of the other.

    The temporary folder lies inside `path`. When all is written, one rename to `.arriving` makes that final;
    then its files are moved, one rename each. A process that is killed before leaves the old files as they
    were, and a `.unfinished-run-...`, which the next run removes. One that is killed later leaves
    `.arriving`, with the files that are still to be moved: the next run moves them before it begins.

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
            if held.enter_context(sole_use(path)):
                for abandoned in path.glob(f"{_STAGE}*"):
                    shutil.rmtree(abandoned, ignore_errors=True)
            _arrive(path)
            stage = Path(tempfile.mkdtemp(prefix=_STAGE, dir=path))
        except OSError as error:
            _remove_empty(made)
            raise ValueError(
                f"output folder {path} is not writable ({error.strerror}); choose another with --out"
            ) from error
        yield from _moved_when_done(path, stage, owned, made)


def _moved_when_done(path: Path, stage: Path, owned: Sequence[str], made: list[Path]) -> Iterator[Path]:
    try:
        yield stage
        new = {file.name for file in stage.iterdir()}
        for name in new:
            if (path / name).is_dir():
                raise IsADirectoryError(errno.EISDIR, "a folder is where a file goes; move it", path / name)
        (stage / _OLD).write_text(json.dumps(sorted(set(owned) - new)))
        os.replace(stage, path / _ARRIVING)
        _arrive(path)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        _remove_empty(made)


def _arrive(path: Path) -> None:
    """Move what has been finished to its place in `path`, and remove what it leaves of an older run.

    It may be done once more wherever it was cut short: the list of the old files goes last.
    """
    arriving = path / _ARRIVING
    if not arriving.is_dir():
        return
    old = arriving / _OLD
    for file in sorted(arriving.iterdir()):
        if file != old:
            os.replace(file, path / file.name)
    if old.exists():
        for name in json.loads(old.read_text()):
            (path / name).unlink(missing_ok=True)
        old.unlink()
    arriving.rmdir()


@contextlib.contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder that becomes the folder `path`, all of it at once, when the block ends well.

    It lies beside `path`, in a folder named `.unfinished-...`; a process that is killed leaves at most that
    behind. An older folder `path` is replaced: it is moved in there first, so that who is killed between the
    two renames leaves no `path`, and the old one, whole, in there. When the block raises, nothing changes.

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
