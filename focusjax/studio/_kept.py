"""What was changed and not saved, kept beside a config's file until it is."""

from pathlib import Path

from focusjax._whole_file import replace_file


def kept_file(path: Path) -> Path:
    """Where unsaved changes to the config at `path` are kept."""
    return path.with_name(f".{path.name}.unsaved")


def kept_text(path: Path) -> str | None:
    """The text that was kept for `path`; None where there is none."""
    try:
        return kept_file(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None


def keep_text(path: Path, text: str | None) -> None:
    """Keep a text for `path`; None forgets what was kept.

    Raises:
        OSError: the folder cannot be written to.
    """
    if text is None:
        kept_file(path).unlink(missing_ok=True)
    else:
        replace_file(kept_file(path), text)
