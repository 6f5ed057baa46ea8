"""The pictures of a shot, one file a frame; frames that are there already are not made again."""

import dataclasses
import hashlib
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.io import UNFINISHED
from focusjax.job import Progress, make_layers
from focusjax.layers import Layers
from focusjax.lens import AbstractLens
from focusjax.many import Ended, Task, Workers, carry_out
from focusjax.shot._frame import MakeFrame, MakeFrameOfFile, camera_while
from focusjax.shot._frame_files import FrameFacts, log_file, read_record
from focusjax.shot._settings import FrameSettings
from focusjax.shot._solve import SolvedShot
from focusjax.trace import plan_rays

_SHOT = ".shot-"
"""Begins the names of files that workers read a shot from; a process that is killed leaves one behind."""
_LOOKS = 5
"""Times within the shutter's interval at which the motion enters the mark of a frame."""


@dataclasses.dataclass(frozen=True)
class RenderedFrames:
    """What rendering left.

    Attributes:
        frames: numbers of the frames, from 1.
        files: the files of each frame.
        kept: how many frames were there already, made from the same scene, camera, lens and settings.
        rays: rays per pixel on the average.
        complete: whether no surface was left out for want of layers.
        left_out: samples of surface for which there were too few layers, in the frame with the most.
        worst_frame: that frame.
        motion_px: farthest way in pixels of anything that moves by itself while the shutter is open; None
            without a shutter.
        step_px: how far what deforms goes at most from one span of the shutter's time to the next; see
            `render_moving`.
        spans: most of them.
    """

    frames: tuple[int, ...]
    files: tuple[tuple[Path, ...], ...]
    kept: int
    rays: int
    complete: bool
    left_out: int = 0
    worst_frame: int = 1
    motion_px: float | None = None
    step_px: float = 0.0
    spans: int = 1


def render_frames(
    solved: SolvedShot,
    folder: Path,
    settings: FrameSettings,
    *,
    formats: Sequence[str] = ("png",),
    frames: Sequence[int] | None = None,
    workers: Workers = 1,
    progress: Progress | None = None,
    on_note: Callable[[str], None] | None = None,
) -> RenderedFrames:
    """Write frame_0001.png, frame_0002.png, ... (and .exr) of a solved shot.

    Each file is complete as soon as it has its name, and a record of each frame, in the folder `.made` beside
    them, says what it was made from, and when: a run that was cut short goes on where it was, by any workers.
    A frame that fails stops no other; it leaves `frame_0001.log`. All frames are peeled `like` the most
    blurred one, so that programs are compiled once.

    Args:
        solved: the shot with its lenses.
        folder: an existing folder, which all workers see.
        settings: how carefully.
        formats: "png", "exr" or both; frames of an mp4 are PNG files.
        frames: numbers of the frames to make, from 1; all when None.
        workers: who makes them; see `focusjax.many.carry_out`. Frames are the same bit for bit, whoever does.
        progress: called with the stage that runs and the share of it that is done.
        on_note: called with a sentence on what a user should know.

    Raises:
        ValueError: a frame that the shot does not have, or as `peel`.
        ManyError: workers that cannot be used, or are lost.
        RuntimeError: frames that failed, after all others were made.
    """
    report: Progress = progress if progress is not None else lambda stage, share: None
    count = solved.shot.count
    wanted = tuple(range(1, count + 1)) if frames is None else tuple(dict.fromkeys(frames))
    for number in wanted:
        if not 1 <= number <= count:
            raise ValueError(f"frame {number} is not in the shot; it has frames 1 to {count}")
    kinds = tuple(kind for kind in ("png", "exr") if kind in formats or (kind == "png" and "mp4" in formats))
    files = {number: tuple(folder / f"{_name(number)}.{kind}" for kind in kinds) for number in wanted}
    facts: dict[int, FrameFacts] = {}
    tasks = []
    for number in wanted:
        mark, record = _mark(solved, number, settings), read_record(folder, _name(number))
        if record.holds(folder, [path.name for path in files[number]], mark):
            facts[number] = record.facts
        else:
            tasks.append(Task(_name(number), (number, mark)))
    kept = len(facts)
    report("render", kept / len(wanted))
    for abandoned in (*folder.glob(f"{_SHOT}*"), *folder.glob(f"{UNFINISHED}*.*")):
        abandoned.unlink(missing_ok=True)
    if tasks:
        make = _make_frame(solved, wanted, folder, settings, kinds)
        failed: list[Ended] = []
        with (
            _for_workers(make, workers) as work,
            closing(carry_out(work, tasks, folder, workers=workers, on_note=on_note)) as ended,
        ):
            for each in ended:
                log = log_file(folder, each.task.name)
                if each.error:
                    failed.append(each)
                    # A disk that is full fails frames, not the run.
                    with suppress(OSError):
                        log.write_text(f"{each.error}\n\n{each.log}")
                else:
                    facts[each.task.argument[0]] = each.value
                    log.unlink(missing_ok=True)
                report("render", (len(facts) + len(failed)) / len(wanted))
        if failed:
            raise RuntimeError(_failures(failed, len(facts)))
    for sentence in dict.fromkeys(text for each in facts.values() for text in each.warnings):
        warnings.warn(sentence, stacklevel=2)
    return _rendered(settings, files, kept, facts)


def _name(number: int) -> str:
    return f"frame_{number:04d}"


def _make_frame(
    solved: SolvedShot, wanted: Sequence[int], folder: Path, settings: FrameSettings, kinds: tuple[str, ...]
) -> MakeFrame:
    """What makes frames, with what all of them have alike."""
    rays, widest = settings.rays, None
    if settings.method == "trace" and (settings.quality is not None or settings.motion is None):
        layers, lens = _widest(solved, wanted, settings)
        widest = layers.extent
        if settings.quality is not None:
            # What moves and is sharp is not smoothed, but layers of one instant do not show what moves.
            smooth = settings.smooth and settings.motion is None
            rays = plan_rays(layers, lens, settings.quality, smooth=smooth, seed=settings.seed).rays
    return MakeFrame(solved, folder.absolute(), settings, kinds, rays, widest)


@contextmanager
def _for_workers(make: MakeFrame, workers: Workers) -> Iterator[MakeFrame | MakeFrameOfFile]:
    """What workers are given: itself in this process, or a file that has it."""
    if workers == 1:
        yield make
        return
    file = make.folder / f"{_SHOT}{uuid.uuid4().hex[:12]}"
    try:
        yield MakeFrameOfFile.written(make, file)
    finally:
        file.unlink(missing_ok=True)


def _failures(failed: Sequence[Ended], made: int) -> str:
    """A sentence on frames that failed."""
    first, others = failed[0], len(failed) - 1
    more = f" (and {others} more {'frame' if others == 1 else 'frames'})" if others else ""
    kept = f"; frames that are there ({made}) are kept the next time" if made else ""
    return f"frame {first.task.argument[0]}: {first.error}{more}{kept}"


def _rendered(
    settings: FrameSettings,
    files: Mapping[int, tuple[Path, ...]],
    kept: int,
    facts: Mapping[int, FrameFacts],
) -> RenderedFrames:
    worst = max(files, key=lambda number: facts[number].left_out)
    lacking, every = facts[worst].left_out, facts.values()
    rays = max(each.rays for each in every)
    rendered = RenderedFrames(tuple(files), tuple(files.values()), kept, rays, lacking == 0, lacking, worst)
    motion = settings.motion
    if motion is None:
        return rendered
    step = max(each.step_px for each in every)
    if step > motion.step_px:
        warnings.warn(
            f"what deforms goes up to {step:.1f} pixels from one span of the shutter's time to the next,"
            f" instead of {motion.step_px:g}; raise shutter.most_spans, or shutter.step_px",
            stacklevel=3,
        )
    way, spans = max(each.motion_px for each in every), max(each.spans for each in every)
    return dataclasses.replace(rendered, motion_px=way, step_px=step, spans=spans)


def _mark(solved: SolvedShot, number: int, settings: FrameSettings) -> str:
    """A short text that changes with anything a frame is made from."""
    times = [float(number)]
    if settings.motion is not None:
        interval = settings.motion.shutter.interval()
        times += [number + settings.motion.fps * float(second) for second in np.linspace(*interval, _LOOKS)]
    path = camera_while(solved, number)
    seen = [(solved.shot.scene.at(time), path(time)) for time in times]
    # Polynomials for a real lens follow from the rest, and take long to fit.
    return fingerprint((seen, solved.seen_with(number, fit=False), solved.depths[number - 1], settings))


def fingerprint(value: Any) -> str:
    """A short text that changes with anything in `value`."""
    digest = hashlib.sha256()

    def add(value: Any) -> None:
        if isinstance(value, np.ndarray | jax.Array):
            array = np.ascontiguousarray(value)
            digest.update(f"{array.dtype}{array.shape}".encode())
            digest.update(array.tobytes())
        elif isinstance(value, Mapping):
            for key, item in value.items():
                digest.update(str(key).encode())
                add(item)
        elif isinstance(value, list | tuple):
            for item in value:
                add(item)
        elif dataclasses.is_dataclass(value):
            digest.update(type(value).__name__.encode())
            for field in dataclasses.fields(value):
                digest.update(field.name.encode())
                add(getattr(value, field.name))
        else:
            digest.update(repr(value).encode())

    add(value)
    return digest.hexdigest()[:32]


def _widest(
    solved: SolvedShot, wanted: Sequence[int], settings: FrameSettings
) -> tuple[Layers, AbstractLens]:
    """Layers of the frame whose rays stray farthest, and its lens."""
    reach = []
    for number in wanted:
        camera, lens = solved.seen_with(number, fit=False)
        reach.append(float(_reach(lens, camera, jnp.asarray(solved.depths[number - 1], dtype=float))))
    number = wanted[int(np.argmax(reach))]
    camera, lens = solved.seen_with(number)
    return make_layers(settings, solved.shot.scene.at(number), camera, lens), lens


@jit
def _reach(lens: AbstractLens, camera: Camera, depths: Float[Array, "2"]) -> Float[Array, ""]:
    return jnp.max(jax.vmap(lambda w: lens.reach(camera, w))(depths))
