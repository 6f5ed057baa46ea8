"""Converged pictures to score against, computed once and kept in a file."""

import hashlib
from pathlib import Path

import numpy as np
from _mitsuba import UnlitScene, render_thin_lens

from focusjax.baselines import lens_picture
from focusjax.geometry import Camera
from focusjax.lens import ThinLens
from focusjax.scene import ConstantBackground, Scene


def unlit_scene(scene: Scene) -> UnlitScene:
    """The triangles, vertex colours and constant background of `scene`."""
    assert isinstance(scene.background, ConstantBackground)
    background = tuple(float(value) for value in np.asarray(scene.background.colour))
    return UnlitScene(scene.vertices, scene.faces, scene.colours, background)


def mitsuba_picture(
    scene: UnlitScene, camera: Camera, lens: ThinLens, samples: int, seed: int = 0
) -> np.ndarray:
    """What Mitsuba sees through the same lens (a disk)."""
    return render_thin_lens(
        scene,
        np.asarray(camera.world_from_camera),
        camera.width,
        camera.height,
        2 * np.degrees(np.arctan(camera.width / 2 / float(camera.focal_px))),
        float(lens.aperture_radius),
        float(lens.focus_distance()),
        samples,
        seed,
    )


def truth(
    file: Path | None, scene: Scene, camera: Camera, lens: ThinLens, samples: int
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
    try:
        picture = mitsuba_picture(unlit_scene(scene), camera, lens, samples, seed=1000)
        maker = f"Mitsuba, {samples} samples per pixel"
    except ImportError:
        picture = lens_picture(scene, camera, lens, rays=samples)
        maker = f"ray cast, {samples} rays per pixel"
    if file is not None:
        np.savez_compressed(file, picture=picture.astype(np.float32), key=key, maker=maker)
    return picture, maker
