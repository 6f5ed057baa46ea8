"""What is refused of photographs and depth maps."""

from pathlib import Path


class PhotoError(ValueError):
    """A photograph or its depth cannot be used as it is: one sentence with the file and the remedy."""


def check_file(path: Path, what: str) -> None:
    """Raise a `PhotoError` where there is no file at `path`, which should be `what`."""
    if path.is_dir():
        raise PhotoError(f"{path}: this is a folder, not a {what}; name a file in it")
    if not path.is_file():
        raise PhotoError(f"{path}: there is no such {what}; check the path")


def one_line(error: Exception) -> str:
    """What an error of a library says, without its line breaks and full stop, to stand inside a sentence."""
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__
