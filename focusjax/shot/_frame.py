"""One frame of a shot: its picture, its files and the record of them, in whichever process."""

import dataclasses
import os
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import ClassVar

import cloudpickle
import numpy as np

from focusjax.geometry import Camera
from focusjax.io import UNFINISHED
from focusjax.job import blurred_view, make_layers, render_open
from focusjax.layers import Extent
from focusjax.lens import AbstractLens
from focusjax.many import Journal, Task, warnings_kept
from focusjax.motion import MovingScene, solved_path
from focusjax.shot._frame_files import (
    FrameFacts,
    Record,
    read_record,
    save_shown,
    save_with_depth,
    write_record,
)
from focusjax.shot._settings import FrameSettings
from focusjax.shot._solve import SolvedShot
from focusjax.trace import render


@dataclasses.dataclass(frozen=True)
class MakeFrame:
    """Makes frames; keeps sizes of layers, so that the next frame in the same process has the same programs.

    Attributes:
        solved: the shot with its lenses.
        folder: where frames go; it exists.
        settings: how carefully.
        kinds: of files, "png" and "exr".
        rays: per pixel.
        widest: sizes of layers that serve every frame; None where those of each are made for it.
    """

    solved: SolvedShot
    folder: Path
    settings: FrameSettings
    kinds: tuple[str, ...]
    rays: int
    widest: Extent | None
    _extents: dict[str, Extent] = dataclasses.field(default_factory=dict, init=False, repr=False)

    def __call__(self, task: Task, journal: Journal) -> FrameFacts:
        """Make a frame, a task's argument being its number and what it is made from, unless it is there."""
        number: int = task.argument[0]
        mark: str = task.argument[1]
        names = [f"{task.name}.{kind}" for kind in self.kinds]
        record = read_record(self.folder, task.name)
        if record.holds(self.folder, names, mark):
            return record.facts
        # A picture that is replaced is of nothing known until the record says of what.
        if any(name in record.marks for name in names):
            record = record.without(names)
            write_record(self.folder, task.name, record)
        with warnings_kept() as said:
            image, facts = self._picture(number)
        facts = dataclasses.replace(facts, warnings=tuple(said))
        sizes = self._save(names, image, number, task.name, record)
        history = journal.finish(task.name, record.journal)
        marks = {**record.marks, **dict.fromkeys(names, mark)}
        write_record(self.folder, task.name, Record(marks, {**record.sizes, **sizes}, facts, history))
        return facts

    def _save(
        self, names: Sequence[str], image: np.ndarray, number: int, frame: str, before: Record
    ) -> dict[str, int]:
        """Write a frame's files; each appears whole. Returns their sizes in bytes.

        Raises:
            RuntimeError: the record is not what it was `before`, since another process made the frame.
        """
        unfinished = {name: self.folder / f"{UNFINISHED}{uuid.uuid4().hex[:8]}-{name}" for name in names}
        try:
            for kind, path in zip(self.kinds, unfinished.values(), strict=True):
                if kind == "png":
                    save_frame(path, image, self.solved, number, self.settings)
                else:
                    camera, lens = self.solved.seen_with(number)
                    save_with_depth(path, image, self.solved.shot.scene.at(number), camera, lens)
            if read_record(self.folder, frame) != before:
                raise RuntimeError("another process made this frame meanwhile; give the command again")
            sizes = {name: path.stat().st_size for name, path in unfinished.items()}
            for name, path in unfinished.items():
                os.replace(path, self.folder / name)
        finally:
            for path in unfinished.values():
                path.unlink(missing_ok=True)
        return sizes

    def _picture(self, number: int) -> tuple[np.ndarray, FrameFacts]:
        settings, facts = self.settings, FrameFacts(self.rays)
        if settings.method == "post":
            image, layers, way = blurred_view(
                settings,
                *self._seen(number),
                settings.motion,
                frame=number,
                taps=self.rays,
                like=self._extents.get(""),
                spare=True,
            )
            self._extents[""] = layers.extent.for_others()
            return image, dataclasses.replace(facts, motion_px=way)
        if settings.motion is None:
            camera, lens = self.solved.seen_with(number)
            layers = make_layers(settings, self.solved.shot.scene.at(number), camera, lens, self.widest)
            seed = settings.seed_of(number)
            image = render(layers, lens, rays=self.rays, smooth=settings.smooth, seed=seed)
            return np.asarray(image), dataclasses.replace(facts, left_out=layers.left_out.count)
        return self._exposed(number)

    def _exposed(self, number: int) -> tuple[np.ndarray, FrameFacts]:
        """A frame's picture while the shutter is open."""
        settings, motion = self.settings, self.settings.motion
        assert motion is not None
        made = render_open(
            settings,
            *self._seen(number),
            motion,
            frame=number,
            rays=self.rays,
            smooth=settings.smooth,
            seed=settings.seed_of(number),
            like=self._extents,
        )
        self._extents.update((name, extent.for_others()) for name, extent in made.extents.items())
        facts = FrameFacts(self.rays, made.left_out, made.motion_px, made.step_px, made.spans)
        return np.asarray(made.image), facts

    def _seen(self, number: int) -> tuple[MovingScene, Callable[[float], Camera], AbstractLens]:
        """Scene, camera and lens of a frame."""
        solved = self.solved
        return solved.shot.scene, camera_while(solved, number), solved.seen_with(number)[1]


@dataclasses.dataclass(frozen=True)
class MakeFrameOfFile:
    """Makes frames in other processes, each of which reads the shot once, from a file that all of them see.

    Attributes:
        file: has a `MakeFrame`; of a name that no other has.
    """

    file: Path
    # Of the process: the last file, and what it has.
    _read: ClassVar[dict[Path, MakeFrame]] = {}

    @classmethod
    def written(cls, work: MakeFrame, file: Path) -> "MakeFrameOfFile":
        """Write the file. A shot made in Python may have functions in it that pickle alone does not take."""
        file.write_bytes(cloudpickle.dumps(work))
        return cls(file)

    def __call__(self, task: Task, journal: Journal) -> FrameFacts:
        """Make a frame; see `MakeFrame`."""
        if self.file not in self._read:
            self._read.clear()
            self._read[self.file] = cloudpickle.loads(self.file.read_bytes())
        return self._read[self.file](task, journal)


def camera_while(solved: SolvedShot, number: int) -> Callable[[float], Camera]:
    """The camera of a frame as it moves on from there."""
    camera = solved.solution.at(number - 1)[0]
    path = solved.shot.camera_at
    if path is None:
        return lambda _: camera
    breathes = solved.shot.options.get("close_focus") == "breathing"
    return solved_path(path, number, camera, breathes=breathes)


def save_frame(
    path: Path, image: np.ndarray, solved: SolvedShot, number: int, settings: FrameSettings
) -> None:
    """A picture to look at, as the camera of a frame takes it."""
    camera, lens = solved.solution.at(number - 1)
    development, stops, bits = settings.development, settings.exposure, settings.bits
    save_shown(path, image, camera, lens, development, exposure=stops, bits=bits)
