"""The pictures of a shot, one file a frame; frames that are there already are not made again."""

import dataclasses
import hashlib
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.job import Development, blurred_view, make_layers
from focusjax.layers import Extent, Layers
from focusjax.lens import AbstractLens
from focusjax.motion import solved_path
from focusjax.scene import Scene
from focusjax.shot._frame_files import read_done, save_shown, save_with_depth, write_done
from focusjax.shot._solve import Progress, SolvedShot
from focusjax.shutter import MovingPicture, Shutter, render_moving
from focusjax.trace import plan_rays, render

FORMATS = ("png", "exr", "mp4")
"""Kinds of files that a shot can be made to."""

_LOOKS = 5
"""Times of the shutter's interval by which frames with other motion are told apart."""


@dataclasses.dataclass(frozen=True)
class MotionSettings:
    """The shutter, and how carefully what moves is followed; see `focusjax.shutter.render_moving`.

    Attributes:
        shutter: when it is open.
        fps: frames per second.
        turn: radians.
        step_px: pixels.
        most_spans: a number.
    """

    shutter: Shutter
    fps: float
    turn: float = 0.2
    step_px: float = 1.0
    most_spans: int = 64


@dataclasses.dataclass(frozen=True)
class FrameSettings:
    """How carefully frames are rendered; names and meanings as in `peel`, `render` and `save_png`.

    Attributes:
        method: "trace", or "post" to blur a sharp view of each frame (`focusjax.post`).
        rays: lens rays per pixel on the average; places to look at by post-processing.
        smooth: whether the noise of what is blurred by defocus is taken out.
        quality: decibels or a name instead of `rays`: planned once, for the most blurred frame.
        supersampling: layer samples along a pixel's side.
        max_layers: most layers to peel.
        slabs: how many slabs of depth to cut instead of peeling.
        slab_blur_px: by how much blur may change within a slab, instead of their number.
        pixel_filter: "box", "tent" or "gaussian".
        view_dependent: whether every lens ray sees highlights for itself.
        seed: chooses the rays, the same ones in every frame, so that noise does not flicker.
        own_rays: whether every frame has rays of its own instead, so that noise evens out over them.
        exposure: stops, for PNG files.
        bits: 8 or 16, of PNG files.
        development: how PNG files are exposed and developed, instead of by `exposure`.
        motion: what moves while the shutter is open; None for frames of one instant.
    """

    method: Literal["trace", "post"] = "trace"
    rays: int = 64
    smooth: bool = True
    quality: str | float | None = None
    supersampling: int = 1
    max_layers: int = 8
    slabs: int | None = None
    slab_blur_px: float | None = None
    pixel_filter: str = "box"
    view_dependent: bool = False
    seed: int = 0
    own_rays: bool = False
    exposure: float = 0.0
    bits: int = 8
    development: Development | None = None
    motion: MotionSettings | None = None

    def seed_of(self, frame: int) -> int:
        """What chooses the rays of a frame."""
        return (self.seed + frame) % 2**31 if self.own_rays else self.seed


@dataclasses.dataclass(frozen=True)
class RenderedFrames:
    """What rendering left.

    Attributes:
        frames: numbers of the frames, from 1.
        files: the files of each frame.
        kept: how many frames were there already, made from the same scene, camera, lens and settings.
        rays: rays per pixel on the average; None when all frames were there and a quality was asked for.
        complete: whether no surface was left out for want of layers.
        left_out: samples of surface for which there were too few layers, in the frame with the most.
        worst_frame: that frame.
        motion_px: farthest way in pixels of anything that moves by itself while the shutter is open, over the
            frames that were made; None without a shutter.
        step_px: how far what deforms goes at most from one span of the shutter's time to the next; see
            `render_moving`.
        spans: most of them.
    """

    frames: tuple[int, ...]
    files: tuple[tuple[Path, ...], ...]
    kept: int
    rays: int | None
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
    progress: Progress | None = None,
) -> RenderedFrames:
    """Write frame_0001.png, frame_0002.png, ... (and .exr) of a solved shot.

    Each file is complete as soon as it has its name, and `frames.json` beside them says what each was made
    from: a run that was cut short goes on where it was. All frames are peeled `like` the most blurred one, so
    that programs are compiled once.

    Args:
        solved: the shot with its lenses.
        folder: an existing folder.
        settings: how carefully.
        formats: "png", "exr" or both; frames of an mp4 are PNG files.
        frames: numbers of the frames to make, from 1; all when None.
        progress: told how far it is.

    Raises:
        ValueError: a frame that the shot does not have, or as `peel` and `render`.
    """
    tell: Progress = progress if progress is not None else lambda stage, share: None
    shot = solved.shot
    wanted = tuple(range(1, shot.count + 1)) if frames is None else tuple(dict.fromkeys(frames))
    for number in wanted:
        if not 1 <= number <= shot.count:
            raise ValueError(f"frame {number} is not in the shot; it has frames 1 to {shot.count}")
    kinds = [kind for kind in ("png", "exr") if kind in formats or (kind == "png" and "mp4" in formats)]
    done = read_done(folder)
    widest: Layers | None = None
    rays = None if settings.quality is not None else settings.rays
    kept, files = 0, []
    left_out: dict[int, int] = {}
    moved: list[MovingPicture] = []
    view: Layers | None = None
    ways = [0.0]
    for position, number in enumerate(wanted):
        tell("render", position / len(wanted))
        camera, lens = solved.seen_with(number)
        scene = shot.scene.at(number)
        names = [f"frame_{number:04d}.{kind}" for kind in kinds]
        files.append(tuple(folder / name for name in names))
        mark = fingerprint(_seen(solved, number, settings), camera, lens, settings)
        if all(done.get(path.name) == mark and path.is_file() for path in files[-1]):
            kept += 1
            continue
        # A picture that is replaced is of nothing known until the list says of what.
        known = {name: old for name, old in done.items() if name not in names}
        if len(known) < len(done):
            done = known
            write_done(folder, done)
        traced = settings.method == "trace"
        if traced and widest is None and (rays is None or settings.motion is None):
            widest, rays = _widest(solved, wanted, settings)
        assert rays is not None
        if not traced:
            image, view, way = _post_processed(solved, number, settings, view)
            ways.append(way)
        elif settings.motion is not None:
            moved.append(_exposed(solved, number, settings, rays, moved[-1].extents if moved else {}))
            left_out[number] = moved[-1].left_out
            image = np.asarray(moved[-1].image)
        else:
            layers = make_layers(settings, scene, camera, lens, widest)
            left_out[number] = layers.left_out.count
            seed = settings.seed_of(number)
            image = np.asarray(render(layers, lens, rays=rays, smooth=settings.smooth, seed=seed))
        for kind, path in zip(kinds, files[-1], strict=True):
            unfinished = path.with_name(f".{path.name}")
            if kind == "png":
                save_frame(unfinished, image, solved, number, settings)
            else:
                save_with_depth(unfinished, image, scene, camera, lens)
            os.replace(unfinished, path)
            done[path.name] = mark
        write_done(folder, done)
    tell("render", 1.0)
    worst = max(left_out, key=lambda frame: left_out[frame], default=1)
    lacking = left_out.get(worst, 0)
    complete = lacking == 0
    if settings.motion is None:
        return RenderedFrames(wanted, tuple(files), kept, rays, complete, lacking, worst)
    step = max((each.step_px for each in moved), default=0.0)
    if step > settings.motion.step_px:
        warnings.warn(
            f"what deforms goes up to {step:.1f} pixels from one span of the shutter's time to the next,"
            f" instead of {settings.motion.step_px:g}; raise shutter.most_spans, or shutter.step_px",
            stacklevel=2,
        )
    way = max([*ways, *(each.motion_px for each in moved)])
    spans = max((each.spans for each in moved), default=1)
    return RenderedFrames(wanted, tuple(files), kept, rays, complete, lacking, worst, way, step, spans)


def save_frame(
    path: Path, image: np.ndarray, solved: SolvedShot, number: int, settings: FrameSettings
) -> None:
    """A picture to look at, as the camera of a frame takes it."""
    camera, lens = solved.solution.at(number - 1)
    development, stops, bits = settings.development, settings.exposure, settings.bits
    save_shown(path, image, camera, lens, development, exposure=stops, bits=bits)


def _camera_at(solved: SolvedShot, number: int) -> Callable[[float], Camera]:
    """The camera of a frame as it moves on from there."""
    camera = solved.solution.at(number - 1)[0]
    path = solved.shot.camera_at
    return (lambda _: camera) if path is None else solved_path(path, number, camera)


def _exposed(
    solved: SolvedShot, number: int, settings: FrameSettings, rays: int, like: Mapping[str, Extent]
) -> MovingPicture:
    """A frame's picture while the shutter is open."""
    motion = settings.motion
    assert motion is not None

    def layers(scene: Scene, camera: Camera, lens: AbstractLens, like: Extent | None) -> Layers:
        return make_layers(settings, scene, camera, lens, like)

    return render_moving(
        solved.shot.scene,
        _camera_at(solved, number),
        solved.seen_with(number)[1],
        motion.shutter,
        frame=number,
        fps=motion.fps,
        rays=rays,
        smooth=settings.smooth,
        seed=settings.seed_of(number),
        turn=motion.turn,
        step_px=motion.step_px,
        most_spans=motion.most_spans,
        make=layers,
        like=like,
    )


def _post_processed(
    solved: SolvedShot, number: int, settings: FrameSettings, like: Layers | None
) -> tuple[np.ndarray, Layers, float]:
    """A frame blurred from one sharp view, the layers of that view, and the farthest way in it, in pixels."""
    motion = settings.motion
    return blurred_view(
        settings,
        solved.shot.scene,
        _camera_at(solved, number),
        solved.seen_with(number)[1],
        None if motion is None else motion.shutter,
        frame=number,
        fps=1.0 if motion is None else motion.fps,
        taps=settings.rays,
        like=like,
    )


def _seen(solved: SolvedShot, number: int, settings: FrameSettings) -> tuple[tuple[Scene, Camera], ...]:
    """The scene and the camera at some times while the shutter is open, that of the frame among them."""
    times = [float(number)]
    if settings.motion is not None:
        interval = settings.motion.shutter.interval()
        times += [number + settings.motion.fps * float(second) for second in np.linspace(*interval, _LOOKS)]
    path = _camera_at(solved, number)
    return tuple((solved.shot.scene.at(time), path(time)) for time in times)


def fingerprint(
    seen: Sequence[tuple[Scene, Camera]], camera: Camera, lens: AbstractLens, settings: FrameSettings
) -> str:
    """A short text that changes with anything a picture is made from."""
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

    add((seen, camera, lens, settings))
    return digest.hexdigest()[:32]


def _widest(solved: SolvedShot, wanted: Sequence[int], settings: FrameSettings) -> tuple[Layers, int]:
    """Layers of the frame whose rays stray farthest, and the rays per pixel."""
    reach = []
    for number in wanted:
        camera, lens = solved.seen_with(number, fit=False)
        reach.append(float(_reach(lens, camera, jnp.asarray(solved.depths[number - 1], dtype=float))))
    number = wanted[int(np.argmax(reach))]
    camera, lens = solved.seen_with(number)
    layers = make_layers(settings, solved.shot.scene.at(number), camera, lens)
    if settings.quality is None:
        return layers, settings.rays
    # What moves and is sharp is not smoothed, which layers of one instant do not tell.
    smooth = settings.smooth and settings.motion is None
    return layers, plan_rays(layers, lens, settings.quality, smooth=smooth, seed=settings.seed).rays


@eqx.filter_jit
def _reach(lens: AbstractLens, camera: Camera, depths: Float[Array, "2"]) -> Float[Array, ""]:
    return jnp.max(jax.vmap(lambda w: lens.reach(camera, w))(depths))
