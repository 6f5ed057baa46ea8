"""The pictures of a shot, one file a frame; frames that are there already are not made again."""

import dataclasses
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.io import save_exr, save_png
from focusjax.job import Development, blur_map, make_layers
from focusjax.layers import Layers, disparity_map
from focusjax.lens import AbstractLens
from focusjax.scene import Scene
from focusjax.shot._solve import Progress, SolvedShot
from focusjax.trace import plan_rays, render

FORMATS = ("png", "exr", "mp4")
"""Kinds of files that a shot can be made to."""

_DONE = "frames.json"


@dataclasses.dataclass(frozen=True)
class FrameSettings:
    """How carefully frames are rendered; names and meanings as in `peel`, `render` and `save_png`.

    Attributes:
        rays: lens rays per pixel on the average.
        quality: decibels or a name instead of `rays`: planned once, for the most blurred frame.
        supersampling: layer samples along a pixel's side.
        max_layers: most layers to peel.
        slabs: how many slabs of depth to cut instead of peeling.
        slab_blur_px: by how much blur may change within a slab, instead of their number.
        pixel_filter: "box", "tent" or "gaussian".
        view_dependent: whether every lens ray sees highlights for itself.
        seed: chooses the rays, the same ones in every frame, so that noise does not flicker.
        exposure: stops, for PNG files.
        bits: 8 or 16, of PNG files.
        development: how PNG files are exposed and developed, instead of by `exposure`.
    """

    rays: int = 64
    quality: str | float | None = None
    supersampling: int = 2
    max_layers: int = 8
    slabs: int | None = None
    slab_blur_px: float | None = None
    pixel_filter: str = "box"
    view_dependent: bool = False
    seed: int = 0
    exposure: float = 0.0
    bits: int = 8
    development: Development | None = None


@dataclasses.dataclass(frozen=True)
class RenderedFrames:
    """What rendering left.

    Attributes:
        frames: numbers of the frames, from 1.
        files: the files of each frame.
        kept: how many frames were there already, made from the same scene, camera, lens and settings.
        rays: rays per pixel on the average; None when all frames were there and a quality was asked for.
        complete: whether no surface was left out for want of layers.
    """

    frames: tuple[int, ...]
    files: tuple[tuple[Path, ...], ...]
    kept: int
    rays: int | None
    complete: bool


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
    shot, wanted = solved.shot, tuple(range(1, solved.shot.count + 1)) if frames is None else tuple(frames)
    for number in wanted:
        if not 1 <= number <= shot.count:
            raise ValueError(f"frame {number} is not in the shot; it has frames 1 to {shot.count}")
    kinds = [kind for kind in ("png", "exr") if kind in formats or (kind == "png" and "mp4" in formats)]
    done = _read_done(folder)
    widest: Layers | None = None
    rays = None if settings.quality is not None else settings.rays
    kept, complete, files = 0, True, []
    for position, number in enumerate(wanted):
        tell("render", position / len(wanted))
        camera, lens = _view(solved, number)
        scene = shot.scene.at(number)
        names = [f"frame_{number:04d}.{kind}" for kind in kinds]
        files.append(tuple(folder / name for name in names))
        mark = fingerprint(scene, camera, lens, settings)
        if done.get(str(number)) == mark and all(path.is_file() for path in files[-1]):
            kept += 1
            continue
        if widest is None:
            widest, rays = _widest(solved, wanted, settings)
        assert rays is not None
        layers = make_layers(settings, scene, camera, lens, widest)
        complete &= layers.complete
        image = np.asarray(render(layers, lens, rays=rays, seed=settings.seed))
        for kind, path in zip(kinds, files[-1], strict=True):
            unfinished = path.with_name(f".{path.name}")
            if kind == "png":
                _save_png(unfinished, image, solved, number, settings)
            else:
                _save_exr(unfinished, image, scene, camera, lens)
            os.replace(unfinished, path)
        done[str(number)] = mark
        _write_done(folder, done)
    tell("render", 1.0)
    return RenderedFrames(wanted, tuple(files), kept, rays, complete)


def fingerprint(scene: Scene, camera: Camera, lens: AbstractLens, settings: FrameSettings) -> str:
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

    add((scene, camera, lens, settings))
    return digest.hexdigest()[:32]


def _view(solved: SolvedShot, number: int) -> tuple[Camera, AbstractLens]:
    """What a frame is taken with."""
    camera, lens = solved.solution.at(number - 1)
    look = solved.shot.look
    return camera, lens if look is None else look(camera, lens)


def _widest(solved: SolvedShot, wanted: Sequence[int], settings: FrameSettings) -> tuple[Layers, int]:
    """Layers of the frame whose rays stray farthest, and the rays per pixel."""
    reach = []
    for number in wanted:
        camera, lens = _view(solved, number)
        reach.append(float(_reach(lens, camera, jnp.asarray(solved.depths[number - 1], dtype=float))))
    number = wanted[int(np.argmax(reach))]
    camera, lens = _view(solved, number)
    layers = make_layers(settings, solved.shot.scene.at(number), camera, lens)
    if settings.quality is None:
        return layers, settings.rays
    return layers, plan_rays(layers, lens, settings.quality, seed=settings.seed).rays


@eqx.filter_jit
def _reach(lens: AbstractLens, camera: Camera, depths: Float[Array, "2"]) -> Float[Array, ""]:
    return jnp.max(jax.vmap(lambda w: lens.reach(camera, w))(depths))


def _save_png(
    path: Path, image: np.ndarray, solved: SolvedShot, number: int, settings: FrameSettings
) -> None:
    development = settings.development
    if development is None:
        save_png(path, image, exposure=settings.exposure, bits=settings.bits)
        return
    camera, lens = solved.solution.at(number - 1)
    shown = development.shown(jnp.asarray(image), camera, development.settings(camera, lens))
    save_png(path, shown, bits=settings.bits)


def _save_exr(path: Path, image: np.ndarray, scene: Scene, camera: Camera, lens: AbstractLens) -> None:
    disparity = disparity_map(scene, camera)
    with np.errstate(divide="ignore"):
        depth = 1.0 / disparity
    save_exr(
        path, image, depth=depth, blur=np.asarray(blur_map(lens, camera, jnp.asarray(disparity, dtype=float)))
    )


def _read_done(folder: Path) -> dict[str, str]:
    try:
        return json.loads((folder / _DONE).read_text())
    except (OSError, ValueError):
        return {}


def _write_done(folder: Path, done: dict[str, str]) -> None:
    unfinished = folder / f".{_DONE}"
    unfinished.write_text(json.dumps(done, indent=1, sort_keys=True) + "\n")
    os.replace(unfinished, folder / _DONE)
