"""Doing one item: what one run does, into a folder that is there whole or not at all."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from PIL import Image

from focusjax import job
from focusjax.batch._fingerprint import changed_since
from focusjax.batch._folder import ITEM_FILE, done_before
from focusjax.batch._items import Item
from focusjax.config import build_scene
from focusjax.io import json_text
from focusjax.many import Journal, Task, finished_folder, warnings_kept
from focusjax.report import save_outcome

THUMBNAIL = "thumbnail.jpg"
_THUMBNAIL_WIDTH = 320


def task_of(item: Item, fingerprint: dict[str, Any]) -> Task:
    """The task of an item.

    Those of one config share most of their compiled programs, and often their scene.

    Args:
        item: what to do.
        fingerprint: what the result depends on, see `Fingerprints`.
    """
    return Task(item.name, (item, fingerprint), group=str(item.config.source))


@dataclass(frozen=True)
class DoItem:
    """Does items, and keeps what the next one in the same process can use: compiled programs and the scene.

    Pictures whose layers are as large share their programs, so that each item's layers have room for those of
    the items before it. The picture is the same with it.

    Attributes:
        folder: of the batch.
        solve_only: find the settings and make no picture.
    """

    folder: Path
    solve_only: bool
    # Of the process, whichever copy of this object it has got: the last scene by its key, and the extent.
    _kept: ClassVar[dict[str, Any]] = {}

    def __call__(self, task: Task, journal: Journal) -> None:
        """Do one item, unless it is done already."""
        item, fingerprint = task.argument
        before = done_before(self.folder / item.name)
        if before is not None and not changed_since(before.get("fingerprint", {}), fingerprint):
            return
        start = time.perf_counter()
        with finished_folder(journal, item.name, self.folder) as stage, warnings_kept() as warned:
            scene = self._scene_of(item, fingerprint)
            like = self._kept.get("extent")
            outcome = job.run(item.config, rendering=not self.solve_only, scene=scene, like=like, spare=True)
            if outcome.picture is not None:
                self._kept["extent"] = outcome.picture.extent
            save_outcome(stage, outcome)
            _save_thumbnail(stage)
            facts = {
                "name": item.name,
                "changes": dict(item.changes),
                "seconds": time.perf_counter() - start,
                "warnings": warned,
                "fingerprint": fingerprint,
            }
            (stage / ITEM_FILE).write_text(json_text(facts), encoding="utf-8")

    def _scene_of(self, item: Item, fingerprint: dict[str, Any]) -> Any:
        """The item's scene: the one before, if that is of the same table, folder and files."""
        config = item.config
        files = tuple(fingerprint["files"].items())
        # A photograph is prepared for a lens.
        widest = None if config.scene.photo is None else config.widest_f_number
        key = (config.scene, widest, config.source.parent.resolve(), files)
        if self._kept.get("key") != key:
            # Let go of one scene before there are two.
            self._kept.pop("key", None)
            self._kept.pop("scene", None)
            self._kept["scene"] = build_scene(config)
            self._kept["key"] = key
        return self._kept["scene"]


def _save_thumbnail(folder: Path) -> None:
    """A small picture of the item: what was rendered, or else the map of blur."""
    source = folder / "image.png"
    with Image.open(source if source.exists() else folder / "blur.png") as opened:
        picture = opened.convert("RGB")
    picture.thumbnail((_THUMBNAIL_WIDTH, _THUMBNAIL_WIDTH))
    picture.save(folder / THUMBNAIL, quality=88)
