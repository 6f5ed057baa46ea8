"""Pictures of scenes that are kept in a folder for the next time."""

import hashlib
import os
from pathlib import Path

from focusjax._console import caches
from focusjax.config import Config
from focusjax.studio._files_named import texts_in

_MOST = 300
"""Pictures in a folder; the oldest ones go."""


def user_cache() -> Path:
    """The user's own folder for them."""
    return caches() / "thumbnails"


def kept_picture(folder: Path, config: Config, kind: str) -> bytes | None:
    """What was kept of a config's scene as it is now, such as its "thumbnail"; None where nothing was."""
    try:
        return _file(folder, config, kind).read_bytes()
    except OSError:
        return None


def keep_picture(folder: Path, config: Config, kind: str, data: bytes) -> None:
    """Keep a picture in place of the last one of its kind; the folder is made.

    Raises:
        OSError: it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = _file(folder, config, kind)
    unfinished = kept.with_suffix(f".{os.getpid()}.new")
    unfinished.write_bytes(data)
    os.replace(unfinished, kept)
    oldest_first = sorted(folder.glob("*.jpg"), key=lambda file: file.stat().st_mtime)
    for file in oldest_first[:-_MOST]:
        file.unlink(missing_ok=True)


def _file(folder: Path, config: Config, kind: str) -> Path:
    """Its name changes with the scene and the camera, and with the files that the scene names."""
    digest = hashlib.sha256(repr((config.scene, config.camera, config.render.exposure)).encode())
    for name in texts_in(config.scene.model_dump()):
        file = config.source.parent / name
        if file.is_file():
            state = file.stat()
            digest.update(f"{file.resolve()}{state.st_size}{state.st_mtime_ns}".encode())
    return folder / f"{digest.hexdigest()[:24]}-{kind}.jpg"
