"""Converged pictures to score against, computed once and kept in a file."""

import hashlib
import importlib.util
from pathlib import Path

import numpy as np

from focusjax.baselines import lens_picture, mitsuba_picture, unlit_scene
from focusjax.geometry import Camera
from focusjax.lens import ThinLens
from focusjax.scene import Scene


def truth(
    file: Path | None,
    scene: Scene,
    camera: Camera,
    lens: ThinLens,
    samples: int,
) -> tuple[np.ndarray, str]:
    """A converged picture [h, w, 3] and who made it, from `file` if it is there, else made and kept there.

    Made by Mitsuba where it is installed, by our own ray cast otherwise.

    Raises:
        ValueError: the file holds the picture of something else.
    """
    parts = [scene.vertices, scene.faces, scene.colours, camera.world_from_camera, camera.focal_px]
    parts += [lens.focus_disparity, lens.aperture_radius]
    digest = hashlib.sha256()
    for part in parts:
        digest.update(np.asarray(part, dtype=np.float32).tobytes())
    key = f"{digest.hexdigest()[:16]} {camera.width} x {camera.height}"
    if file is not None and file.exists():
        with np.load(file) as kept:
            if str(kept["key"]) != key:
                raise ValueError(
                    f"{file} is of another scene, camera or lens; name another file or remove it"
                )
            return kept["picture"].astype(np.float64), str(kept["maker"])
    if importlib.util.find_spec("mitsuba") is not None:
        picture = mitsuba_picture(unlit_scene(scene), camera, lens, samples=samples, seed=1000)
        maker = f"Mitsuba, {samples} samples per pixel"
    else:
        picture = lens_picture(scene, camera, lens, rays=samples)
        maker = f"ray cast, {samples} rays per pixel"
    if file is not None:
        np.savez_compressed(file, picture=picture.astype(np.float32), key=key, maker=maker)
    return picture, maker
