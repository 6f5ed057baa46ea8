"""One picture of a data set, and what is known of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from focusjax.dataset._scenes import GROUND, WALL, draw_camera, draw_scene
from focusjax.dataset._spec import Spec
from focusjax.geometry import Camera
from focusjax.layers import Extent, Grid, Layers, first_surfaces, peel
from focusjax.lens import ThinLens, thin_lens
from focusjax.scene import Scene
from focusjax.trace import render, render_pinhole

_LEAST_MARGIN, _MARGIN_STEP = 8, 32
_SEEN = 16
"""Pixels of an object from which it counts as seen."""
_HALF_MOST = 65504.0
"""The largest finite 16-bit float."""


@dataclass(frozen=True)
class Made:
    """A picture.

    Attributes:
        arrays: what its file holds; see docs/dataset.md.
        layers: that it was traced through.
    """

    arrays: dict[str, np.ndarray]
    layers: Layers


def make_picture(spec: Spec, number: int, files: tuple[Path, ...] = ()) -> Made:
    """Picture `number` of the data set, which depends on the spec and on that number alone.

    Args:
        spec: what is drawn.
        number: from 0 on.
        files: the meshes of the spec, `spec.mesh_files`.

    Raises:
        ValueError: a mesh that cannot be read.
    """
    random = np.random.default_rng([spec.seed, number])
    focal_length = spec.camera.focal_length(spec.camera.length.draw(random))
    camera = draw_camera(spec, focal_length, random)
    f_number = spec.lens.f_number.draw(random)
    ray_seed = int(random.integers(2**31))
    share, distance = random.uniform(size=2), None
    if spec.lens.focus_distance_m is not None:
        distance = spec.lens.focus_distance_m.draw(random)
    scene = draw_scene(spec, camera, files, random)
    disparity, face = first_surfaces(scene, camera)
    if distance is None:
        distance = 1.0 / _focused(scene, disparity, face, share)
    lens = thin_lens(focus_distance=distance, focal_length=focal_length, f_number=f_number)
    layers = peel(
        scene,
        camera,
        lens,
        supersampling=spec.render.supersampling,
        max_layers=spec.render.max_layers,
        like=extent(spec),
    )
    defocused = render(layers, lens, rays=spec.render.rays, seed=ray_seed)
    return Made(
        {
            "defocused": _half(defocused),
            "sharp": _half(render_pinhole(layers)),
            **_truth(camera, lens, disparity),
            "focus_distance_m": np.array(distance),
            "f_number": np.array(f_number),
            "focal_length_m": np.array(focal_length),
            "sensor_width_m": np.array(1e-3 * spec.camera.sensor_width_mm),
            "seed": np.array(spec.seed),
            "number": np.array(number),
        },
        layers,
    )


def extent(spec: Spec) -> Extent:
    """How large the layers of all pictures are, so that programs compiled for one serve the others.

    The margin is the one that the worst blur needs; but at most the frame's width, beyond which a picture
    that needs more has programs of its own.
    """
    width, height = spec.camera.resolution
    table = spec.lens
    focal_px = spec.camera.longest / (1e-3 * spec.camera.sensor_width_mm) * width
    pupil = 0.5 * spec.camera.longest / table.f_number.ends[0]
    focus = (table.focus_distance_m or spec.scene.distance_m).ends[0]
    dioptres = max(1.0 / spec.nearest, 1.0 / focus)
    pixels = int(np.ceil(focal_px * pupil * dioptres)) + 4
    pixels = (
        1 << (pixels - 1).bit_length()
        if pixels <= _MARGIN_STEP
        else -(-pixels // _MARGIN_STEP) * _MARGIN_STEP
    )
    margin = min(max(pixels, _LEAST_MARGIN), max(width, _LEAST_MARGIN))
    times = spec.render.supersampling
    grid = Grid(width, height, times, times * margin)
    # Each sample of the frame is seen through to two surfaces about, with room for the fringes.
    return Extent(grid, spec.render.max_layers, 3 * grid.size)


def _focused(scene: Scene, disparity: np.ndarray, face: np.ndarray, share: np.ndarray) -> float:
    """Disparity in 1/m of a pixel of an object that is seen; of the farthest of all where none is.

    Args:
        scene: what is seen.
        disparity: of each pixel [h, w].
        face: the scene's face of each pixel [h, w].
        share: two numbers [2] from 0 to 1 that choose the object and the pixel.
    """
    seen = []
    for name, faces in scene.objects.items():
        own = disparity[(face >= faces.start) & (face < faces.stop) & (disparity > 0)]
        if name not in (WALL, GROUND) and not name.startswith("light") and len(own) >= _SEEN:
            seen.append(own)
    if not seen:
        return float(disparity[disparity > 0].min())
    own = seen[int(share[0] * len(seen))]
    return float(own[int(share[1] * len(own))])


def _truth(camera: Camera, lens: ThinLens, disparity: np.ndarray) -> dict[str, np.ndarray]:
    """Depth and signed circle of confusion at the pixels' centres."""
    with np.errstate(divide="ignore"):
        depth = 1.0 / disparity
    coc = 2.0 * float(lens.parallax(camera)) * (float(lens.focus_disparity) - disparity)
    return {"depth_m": depth.astype(np.float32), "coc_px": coc.astype(np.float32)}


def _half(image: object) -> np.ndarray:
    return np.minimum(np.asarray(image), _HALF_MOST).astype(np.float16)
