"""Configs to begin with, each with a small sharp view of its scene."""

import contextlib
import dataclasses
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path

from focusjax import job
from focusjax.config import Config, ConfigError, build_camera, build_scene, load_config, read_toml
from focusjax.film import to_bytes
from focusjax.post import closed_lens, view_in_layers
from focusjax.studio._kept_pictures import keep_picture, kept_picture, user_cache
from focusjax.studio._overlays import jpeg

_WIDTH = 240
"""Pixels of a thumbnail."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """A config that may be opened.

    Attributes:
        path: its file.
        title: what it is called.
        frames: of its shot; 0 without one.
        problem: why it cannot be used, in one sentence; it may be opened all the same, to be mended.
    """

    path: Path
    title: str
    frames: int = 0
    problem: str = ""


class Gallery:
    """The configs of some folders, and their thumbnails, made in a thread and kept for the next time.

    Attributes:
        entries: in the order of their names.
        folders: where they were looked for.
        version: rises with every thumbnail.
    """

    def __init__(self, folders: Sequence[Path] | None = None, cache: Path | None = None):
        """Look for configs, and begin with the thumbnails.

        Args:
            folders: where to look; by default here, in ./configs, and where focusjax itself has its own.
            cache: keeps the thumbnails; the user's cache folder by default.
        """
        self.folders = tuple(default_folders() if folders is None else folders)
        self.entries = tuple(_entries(self.folders))
        self.version = 0
        self._cache = user_cache() if cache is None else cache
        self._thumbnails: dict[int, bytes] = {}
        self._thread = threading.Thread(target=self._make_all, name="focusjax thumbnails", daemon=True)
        self._stopped = False
        self._thread.start()

    def thumbnail(self, number: int) -> bytes | None:
        """The JPEG of an entry; None where it is not made yet, or cannot be."""
        return self._thumbnails.get(number)

    def wait(self) -> None:
        """Wait until all thumbnails are made."""
        self._thread.join()

    def close(self) -> None:
        """Stop making thumbnails after the one at hand."""
        self._stopped = True

    def _make_all(self) -> None:
        for number, entry in enumerate(self.entries):
            if self._stopped:
                return
            try:
                data = None if entry.problem else self._made_or_kept(entry)
            except (ValueError, RuntimeError, OSError, MemoryError):
                # What is wrong with it is said where it is opened.
                data = None
            if data is not None:
                self._thumbnails[number] = data
                self.version += 1

    def _made_or_kept(self, entry: Entry) -> bytes:
        config = load_config(entry.path)
        data = kept_picture(self._cache, config, "thumbnail")
        if data is None:
            data = thumbnail_of(config)
            # It is shown all the same where it cannot be kept.
            with contextlib.suppress(OSError):
                keep_picture(self._cache, config, "thumbnail", data)
        return data


def default_folders() -> list[Path]:
    """Where configs are looked for: here, in ./configs, and in the checkout that focusjax runs from."""
    own = Path(__file__).parents[2] / "configs"
    return [Path(), Path("configs"), *([own] if own.is_dir() else [])]


def thumbnail_of(config: Config) -> bytes:
    """A small sharp view of a config's scene, as JPEG."""
    width, height = config.camera.resolution
    size = (_WIDTH, max(1, round(_WIDTH * height / width)))
    small = config.model_copy(update={"camera": config.camera.model_copy(update={"resolution": size})})
    scene, camera = build_scene(small), build_camera(small)
    table = config.render.model_copy(update={"view_dependent": False, "slabs": None, "slab_blur_px": None})
    view = view_in_layers(job.make_layers(table, scene, camera, closed_lens()), scene)
    return jpeg(to_bytes(view.image, exposure=config.render.exposure), size)


def _entries(folders: Iterable[Path]) -> Iterable[Entry]:
    seen: set[Path] = set()
    for folder in folders:
        for path in sorted(folder.glob("*.toml")):
            if path.resolve() in seen:
                continue
            seen.add(path.resolve())
            try:
                data = read_toml(path)
            except ConfigError as error:
                yield Entry(path, path.stem, problem=str(error))
                continue
            if not isinstance(data.get("scene"), dict):
                # Some other program's file, such as pyproject.toml.
                continue
            title = data["title"] if isinstance(data.get("title"), str) else path.stem
            try:
                config = load_config(path)
            except ConfigError as error:
                yield Entry(path, title, problem=str(error))
                continue
            yield Entry(path, title, 0 if config.shot is None else config.shot.frames)
