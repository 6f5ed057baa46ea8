"""The files of a shot's frames, and the list of what each was made from."""

import json
import os
from collections.abc import Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from focusjax.film import LongExposure, start_exposure
from focusjax.geometry import Camera
from focusjax.io import load_exr, save_exr, save_png
from focusjax.job import Development, blur_map
from focusjax.layers import disparity_map
from focusjax.lens import AbstractLens, FocalSurfaceLens, ThinLens, TiltShiftLens
from focusjax.scene import Scene

_DONE = "frames.json"


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
    if isinstance(lens, FocalSurfaceLens):
        lens = lens.thin_lens_at(camera, camera.principal_point)
    shown = development.shown(jnp.asarray(image), camera, development.settings(camera, lens))
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
        frame = jnp.asarray(np.stack([channels[name] for name in "RGB"], axis=-1))
        if exposure is None:
            exposure = start_exposure(frame.shape[1], frame.shape[0], dtype=frame.dtype)
        exposure = exposure.add(frame)
    assert exposure is not None
    return exposure


def read_done(folder: Path) -> dict[str, str]:
    """What each file of a folder was made from, by its name; nothing where that is not known."""
    try:
        return json.loads((folder / _DONE).read_text())
    except (OSError, ValueError):
        return {}


def write_done(folder: Path, done: dict[str, str]) -> None:
    """Replace the list of a folder."""
    unfinished = folder / f".{_DONE}"
    unfinished.write_text(json.dumps(done, indent=1, sort_keys=True) + "\n")
    os.replace(unfinished, folder / _DONE)
