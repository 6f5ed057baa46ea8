"""One writer at a time for an output folder."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks.
    fcntl = None


class FolderInUseError(ValueError):
    """Another process, or another run in this one, writes to the folder."""


@contextmanager
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
