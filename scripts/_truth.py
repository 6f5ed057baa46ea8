"""Converged pictures to score against, computed once and kept in a file."""

from pathlib import Path

import numpy as np

from focusjax.baselines import without_gaps
from focusjax.bench import Case
from focusjax.bench._makers import best_maker, maker_named
from focusjax.geometry import Camera
from focusjax.lens import ThinLens
from focusjax.scene import Scene


def truth(
    file: Path | None, scene: Scene, camera: Camera, lens: ThinLens, samples: int
) -> tuple[np.ndarray, str]:
    """A converged picture [h, w, 3] and who made it, from `file` if it is there, else made and kept there.

    Made by Mitsuba where it is installed, by our own ray cast otherwise.

    Raises:
        ValueError: the file holds the picture of something else.
    """
    case = Case("truth", "truth", scene, camera, lens, max_layers=1)
    if file is not None and file.exists():
        with np.load(file) as kept:
            if str(kept["key"]) != case.digest():
                raise ValueError(
                    f"{file} is of another scene, camera, lens or version; name another file or remove it"
                )
            return kept["picture"].astype(np.float64), str(kept["maker"])
    name = best_maker()
    picture = without_gaps(maker_named(name)(case, samples, 1000)[0])
    maker = f"{name}, {samples} samples per pixel"
    if file is not None:
        np.savez_compressed(file, picture=picture.astype(np.float32), key=case.digest(), maker=maker)
    return picture, maker
