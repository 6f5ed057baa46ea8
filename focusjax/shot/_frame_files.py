"""The files of a shot's frames, and the record of what each was made from."""

import dataclasses
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from focusjax._device import device_array
from focusjax.film import LongExposure, start_exposure
from focusjax.geometry import Camera
from focusjax.io import json_text, load_exr, replace_file, save_exr, save_png
from focusjax.job import Development, blur_map, in_the_middle
from focusjax.layers import disparity_map
from focusjax.lens import AbstractLens, FocalSurfaceLens, ThinLens, TiltShiftLens
from focusjax.scene import Scene

_RECORDS = ".made"
"""The folder of the records, within that of the frames."""


@dataclasses.dataclass(frozen=True)
class FrameFacts:
    """What there is to know of a frame beside its files.

    Attributes:
        rays: per pixel on the average.
        left_out: samples of surface for which there were too few layers.
        motion_px: farthest way of anything that moves by itself while the shutter is open, in pixels.
        step_px: see `render_moving`.
        spans: of the shutter's time.
        warnings: sentences that were said while it was made.
    """

    rays: int = 0
    left_out: int = 0
    motion_px: float = 0.0
    step_px: float = 0.0
    spans: int = 1
    warnings: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Record:
    """What is known of a frame's files.

    Attributes:
        marks: what each file was made from (`fingerprint`), by its name.
        sizes: of each file in bytes: one that is of another is damaged.
        facts: of the picture.
        journal: when it was begun and finished, and by which process: lines of JSON.
    """

    marks: Mapping[str, str] = dataclasses.field(default_factory=dict)
    sizes: Mapping[str, int] = dataclasses.field(default_factory=dict)
    facts: FrameFacts = FrameFacts()
    journal: str = ""

    def holds(self, folder: Path, names: Collection[str], mark: str) -> bool:
        """Whether all these files are there and whole, made from that."""
        return all(
            self.marks.get(name) == mark and _size(folder / name) == self.sizes.get(name) for name in names
        )

    def without(self, names: Collection[str]) -> "Record":
        """What is known when these files are not."""
        marks = {name: mark for name, mark in self.marks.items() if name not in names}
        return dataclasses.replace(self, marks=marks)


def _size(path: Path) -> int:
    """Of a file in bytes; -1 where there is none."""
    try:
        return path.stat().st_size
    except OSError:
        return -1


def record_file(folder: Path, name: str) -> Path:
    """Where the record of a frame is, such as frame_0001."""
    return folder / _RECORDS / f"{name}.json"


def log_file(folder: Path, name: str) -> Path:
    """Where a frame that failed says why."""
    return folder / f"{name}.log"


def read_record(folder: Path, name: str) -> Record:
    """The record of a frame; an empty one where there is none that can be read."""
    try:
        read = json.loads(record_file(folder, name).read_text(encoding="utf-8"))
        facts = read["facts"] | {"warnings": tuple(read["facts"]["warnings"])}
        return Record(dict(read["marks"]), dict(read["sizes"]), FrameFacts(**facts), str(read["journal"]))
    except (OSError, ValueError, KeyError, TypeError):
        return Record()


def write_record(folder: Path, name: str, record: Record) -> None:
    """Replace the record of a frame."""
    path = record_file(folder, name)
    path.parent.mkdir(exist_ok=True)
    replace_file(path, json_text(dataclasses.asdict(record)))


def save_shown(
    path: Path,
    image: np.ndarray,
    camera: Camera,
    lens: ThinLens | TiltShiftLens | FocalSurfaceLens,
    development: Development | None,
    *,
    exposure: float,
    bits: int,
) -> None:
    """A picture to look at: developed, or else brightened by `exposure` stops."""
    if development is None:
        save_png(path, image, exposure=exposure, bits=bits)
        return
    settings = development.settings(camera, in_the_middle(lens, camera))
    shown = development.shown(jnp.asarray(image), camera, settings)
    save_png(path, shown, bits=bits)


def save_with_depth(path: Path, image: np.ndarray, scene: Scene, camera: Camera, lens: AbstractLens) -> None:
    """A linear picture with depth and blur."""
    disparity = disparity_map(scene, camera)
    with np.errstate(divide="ignore"):
        depth = 1.0 / disparity
    save_exr(
        path, image, depth=depth, blur=np.asarray(blur_map(lens, camera, jnp.asarray(disparity, dtype=float)))
    )


def exposed_together(frames: Sequence[Path]) -> LongExposure:
    """The long exposure of linear pictures of one size, read one at a time."""
    exposure = None
    for path in frames:
        channels = load_exr(path)
        frame = device_array(np.stack([channels[name] for name in "RGB"], axis=-1))
        if exposure is None:
            exposure = start_exposure(frame.shape[1], frame.shape[0], dtype=frame.dtype)
        exposure = exposure.add(frame)
    assert exposure is not None
    return exposure
