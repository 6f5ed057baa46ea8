"""What commands say on the terminal: text as it is, without markup, and warnings and errors in one line."""

import enum
import errno
import os
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer
from rich.console import Console

from focusjax._words import printable

FAILED, BAD_INPUT, MISSED, INTERRUPTED = 1, 2, 3, 130
"""Exit statuses beside 0: failed; bad usage or config; solved, but a wish is missed; interrupted."""


class Talk(enum.Enum):
    """How much a command says."""

    QUIET = enum.auto()
    NORMAL = enum.auto()
    VERBOSE = enum.auto()


def talk_of(quiet: bool, verbose: bool) -> Talk:
    """By the options --quiet and --verbose; ends the program when both are given."""
    if quiet and verbose:
        fail(Console(stderr=True), ValueError("--quiet and --verbose are opposites; give one"), BAD_INPUT)
    return Talk.QUIET if quiet else Talk.VERBOSE if verbose else Talk.NORMAL


_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
"""The system's errors that a disk, or one's share of it, is full."""

_OF_DRAWING = (r"Glyph \d+ .* missing from font", "constrained_layout not applied")
"""Warnings of matplotlib that name its caller, which is us."""


def say(console: Console, text: str) -> None:
    """A line of text as it is: names in it are the user's, so no markup and nothing that a terminal obeys."""
    console.print(printable(text), soft_wrap=True, highlight=False, markup=False)


def fail(console: Console, error: BaseException, status: int, place: Path | None = None) -> NoReturn:
    """The error's first paragraph on one line, and out with the exit status; see `sentence`."""
    say(console, f"focusjax: {sentence(error, place)}")
    raise typer.Exit(status)


def fail_inside(console: Console, error: Exception, talk: Talk = Talk.NORMAL) -> NoReturn:
    """Out with an error that is ours: a sentence, before it where it arose when verbose."""
    if talk is Talk.VERBOSE:
        say(console, "".join(traceback.format_exception(error)))
    hint = "" if talk is Talk.VERBOSE else "; --verbose says where it arose"
    fail(console, RuntimeError(f"internal error, please report it: {error!r}{hint}"), FAILED)


def sentence(error: BaseException, place: Path | None = None) -> str:
    """The first paragraph of an error on one line; of the system's errors what, and about which file.

    Args:
        error: what went wrong.
        place: the folder that was written to, for errors of the system that name no file, as a full disk.
    """
    if isinstance(error, OSError) and error.strerror:
        file = error.filename if error.filename is not None else place
        about = f"{file}: " if file is not None else ""
        remedy = "; make room there, or choose another place" if error.errno in _NO_ROOM else ""
        return f"{about}{error.strerror}{remedy}"
    return " ".join(str(error).split("\n\n")[0].split()) or type(error).__name__


@contextmanager
def warnings_printed(console: Console) -> Iterator[None]:
    """Our own warnings as one line each; those of other libraries say nothing to a user."""

    def show(message: Warning | str, category: type[Warning], *rest: object, **more: object) -> None:
        if category is UserWarning:
            say(console, f"Warning: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("default", category=UserWarning, module="focusjax|__main__")
        for drawing in _OF_DRAWING:
            warnings.filterwarnings("ignore", message=drawing)
        warnings.showwarning = show
        yield


def duration(seconds: float) -> str:
    """Seconds as a photographer would say them: 12.3 ms, 4.5 s."""
    return f"{1000 * seconds:.1f} ms" if seconds < 0.1 else f"{seconds:.1f} s"


def caches() -> Path:
    """Where focusjax keeps what later runs can use."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "focusjax"
