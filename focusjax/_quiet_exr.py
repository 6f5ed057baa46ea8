"""OpenEXR files opened without the remarks that the library prints of damaged ones."""

import contextlib
import io
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import OpenEXR

_LOCK = threading.Lock()
"""There is one standard error, which two threads would take from each other and not give back."""


def open_exr(path: str | Path, *, header_only: bool = False) -> OpenEXR.File:
    """The file with each channel by itself; all of it is read here, and nothing is printed.

    A part whose pixels cannot be read is left out; `header_only` lists it.

    Raises:
        Exception: whatever the library has for a file that it cannot open.
    """
    with _LOCK, contextlib.redirect_stdout(io.StringIO()), _no_standard_error():
        return OpenEXR.File(str(path), separate_channels=True, header_only=header_only)


@contextlib.contextmanager
def _no_standard_error() -> Iterator[None]:
    """What is written to file descriptor 2, also from C, goes nowhere meanwhile."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:
        # There is none to be kept quiet.
        yield
        return
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
        finally:
            os.close(nowhere)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
