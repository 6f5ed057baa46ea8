"""The folder of a batch: who may write to it, and what in it is done already."""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

from focusjax.batch._errors import BatchError
from focusjax.io import UNFINISHED, FolderInUseError, load_json, sole_use
from focusjax.many import Journal

Existing = Literal["refuse", "resume", "overwrite"]
"""What to do about results that are there already."""

ITEM_FILE = "item.json"
"""In every item's folder: what the item was, and how it went."""
LOG_FILE = "failed.log"
"""In the folder of an item that failed: why, in full."""
SUMMARY_FILES = ("summary.csv", "summary.json", "summary.html")


@contextmanager
def batch_folder(folder: Path, names: Sequence[str], existing: Existing) -> Iterator[None]:
    """The folder made, looked over, and ours alone within the block.

    Args:
        folder: where the items' folders go.
        names: of the items.
        existing: "refuse" a folder that holds anything; "resume" keeps what is there; "overwrite" removes
            what batches left there, and nothing else.

    Raises:
        BatchError: the folder cannot be written to, is refused, is used by another run, or has a folder
            of an item's name that is from no batch.
    """
    with ExitStack() as held:
        try:
            # A folder that is refused is not left behind.
            found = _files_in(folder) if folder.exists() else []
            if existing == "refuse" and found:
                raise BatchError(
                    f"folder {folder} already holds {found[0]!r}; use --resume to do what is missing there,"
                    " --overwrite to start anew, or choose another with --out"
                )
            folder.mkdir(parents=True, exist_ok=True)
            held.enter_context(sole_use(folder))
            for name in names:
                if (folder / name).exists() and not _is_ours(folder / name):
                    raise BatchError(f"{folder / name} is from no batch; move it, or choose another --out")
            _remove_unfinished(folder)
            if existing == "overwrite":
                _remove_results(folder)
        except FolderInUseError as error:
            raise BatchError(str(error)) from None
        except OSError as error:
            raise BatchError(
                f"folder {folder} cannot be used ({error.strerror}); choose another with --out"
            ) from error
        # A process that was ended leaves what it was at.
        held.callback(_remove_unfinished, folder)
        yield


def _is_ours(folder: Path) -> bool:
    return (folder / ITEM_FILE).exists() or (folder / LOG_FILE).exists()


def done_before(folder: Path) -> dict[str, Any] | None:
    """What a finished item says of itself in its `folder`; None where there is none."""
    facts = load_json(folder / ITEM_FILE)
    return facts if isinstance(facts, dict) and (folder / "report.json").exists() else None


def _files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _remove_results(folder: Path) -> None:
    """What batches left in the folder; nothing else in it is touched."""
    for path in list(folder.iterdir()):
        if _is_ours(path):
            shutil.rmtree(path)
        elif path.name in SUMMARY_FILES:
            path.unlink()


def _remove_unfinished(folder: Path) -> None:
    for path in folder.glob(f"{UNFINISHED}*"):
        shutil.rmtree(path, ignore_errors=True)
    Journal(folder, "").clear()
