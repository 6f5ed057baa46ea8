"""Doing one item: what one run does, into a folder that is there whole or not at all."""

import dataclasses
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from focusjax import job
from focusjax._freed import return_programs
from focusjax.batch._errors import sentence
from focusjax.batch._folder import ITEM_FILE
from focusjax.batch._items import Item
from focusjax.config import build_scene
from focusjax.io import json_text, whole_folder
from focusjax.report import save_outcome

THUMBNAIL = "thumbnail.jpg"
_THUMBNAIL_WIDTH = 320


@dataclasses.dataclass(frozen=True)
class Task:
    """An item to be done.

    Attributes:
        item: what to do.
        fingerprint: what the result depends on, see `Fingerprints`.
    """

    item: Item
    fingerprint: dict[str, Any]

    @property
    def group(self) -> str:
        """Tasks of the same group share most of their compiled programs, and often their scene."""
        return str(self.item.config.source)


class Worker:
    """Does items one after another, and keeps what the next can use: compiled programs and the scene.

    Pictures whose layers are as large share their programs, so that each item's layers have room for those of
    the items before it. The picture is the same with it.

    Args:
        folder: of the batch.
        solve_only: find the settings and make no picture.
    """

    def __init__(self, folder: Path, *, solve_only: bool):
        self._folder = folder
        self._solve_only = solve_only
        self._key: object = None
        self._scene: Any = None
        self._extent: Any = None

    def attempt(self, task: Task) -> str:
        """Do one item; what went wrong as a sentence, or "" when nothing did."""
        try:
            self._do(task)
        except Exception as error:
            return sentence(error)
        finally:
            return_programs()
        return ""

    def _do(self, task: Task) -> None:
        item = task.item
        start = time.perf_counter()
        with whole_folder(self._folder / item.name) as stage, _warnings_kept() as told:
            scene = self._scene_of(task)
            outcome = job.run(item.config, rendering=not self._solve_only, scene=scene, like=self._extent)
            if outcome.picture is not None:
                self._extent = outcome.picture.extent
            save_outcome(stage, outcome)
            _save_thumbnail(stage)
            facts = {
                "name": item.name,
                "changes": dict(item.changes),
                "seconds": time.perf_counter() - start,
                "warnings": told,
                "fingerprint": task.fingerprint,
            }
            (stage / ITEM_FILE).write_text(json_text(facts), encoding="utf-8")

    def _scene_of(self, task: Task) -> Any:
        """The item's scene: the one before, if that is of the same table, folder and files."""
        config = task.item.config
        files = tuple(task.fingerprint["files"].items())
        # A photograph is prepared for a lens.
        widest = None if config.scene.photo is None else config.widest_f_number
        key = (config.scene, widest, config.source.parent.resolve(), files)
        if key != self._key:
            # Let go of one scene before there are two.
            self._key = self._scene = None
            self._scene = build_scene(config)
            self._key = key
        return self._scene


def _save_thumbnail(folder: Path) -> None:
    """A small picture of the item: what was rendered, or else the map of blur."""
    source = folder / "image.png"
    with Image.open(source if source.exists() else folder / "blur.png") as opened:
        picture = opened.convert("RGB")
    picture.thumbnail((_THUMBNAIL_WIDTH, _THUMBNAIL_WIDTH))
    picture.save(folder / THUMBNAIL, quality=88)


@contextmanager
def _warnings_kept() -> Iterator[list[str]]:
    """Our own warnings as texts; those of other libraries say nothing to a user."""
    told: list[str] = []

    def keep(message: Warning | str, category: type[Warning], *rest: object, **more: object) -> None:
        if category is UserWarning and str(message) not in told:
            told.append(str(message))

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("always", category=UserWarning, module="focusjax|__main__")
        warnings.showwarning = keep
        yield told
