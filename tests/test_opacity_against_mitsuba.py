"""Cut-out leaves and panes are right by somebody else's word: thin-lens pictures by Mitsuba 3."""

from pathlib import Path

import jax
import numpy as np
import pytest

from focusjax.geometry import look_at
from focusjax.layers import peel
from focusjax.lens import thin_lens
from focusjax.metrics import psnr, ssim
from focusjax.scene import Scene, constant_background, make_object, make_scene
from focusjax.trace import render

DATA = Path(__file__).parent / "data" / "leaf_card.npz"
UV = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float)


def scene_of(arrays: dict[str, np.ndarray]) -> Scene:
    """A cut-out leaf before a pane before a wall, and a leaf that blends in front of all."""
    picture = np.ones((*arrays["alpha"].shape, 4), dtype=np.float32)
    picture[..., 3] = arrays["alpha"]
    kinds = {
        "wall_0": {},
        "wall_1": {},
        "leaf": {"texture": picture, "cutoff": 0.5},
        "pane": {"opacity": 0.4},
        "front": {"texture": picture, "opacity": 0.7},
    }
    objects = []
    for name, kind in kinds.items():
        vertices = arrays[f"vertices_{name}"]
        faces = [4 * k + np.array([(0, 1, 2), (0, 2, 3)]) for k in range(len(vertices) // 4)]
        glow = {"colour": (0, 0, 0), "emission": arrays[f"colour_{name}"]}
        uv = np.tile(UV, (len(vertices) // 4, 1))
        objects.append(make_object(name, vertices, np.concatenate(faces), uv=uv, **glow, **kind))
    return make_scene(objects, unlit=True, background=constant_background(float(arrays["background"])))


# PSNR in dB and SSIM observed with 256 rays (float32). With the wall in focus, the sides of its squares are
# the most of it: colours of one plane change over a sample there.
OBSERVED = {"leaf": (40.7, 0.9951), "wall": (34.9, 0.9892), "front": (41.7, 0.9952)}


@pytest.mark.parametrize("view", OBSERVED)
def test_picture(view: str) -> None:
    with jax.enable_x64(False), np.load(DATA) as stored:
        arrays = dict(stored)
        theirs = arrays[f"picture_{view}"].astype(np.float64)
        height, width = theirs.shape[:2]
        field = float(arrays["field_of_view"])
        camera = look_at(np.zeros(3), np.array([0, 0, -1.0]), width=width, height=height, field_of_view=field)
        distance, radius = arrays[f"lens_{view}"]
        lens = thin_lens(focus_distance=float(distance), aperture_radius=float(radius))
        layers = peel(scene_of(arrays), camera, lens, supersampling=2)
        ours = np.asarray(render(layers, lens, rays=256), dtype=np.float64)
    expected_psnr, expected_ssim = OBSERVED[view]
    assert psnr(ours, theirs) >= expected_psnr - 0.7
    assert ssim(ours, theirs) >= expected_ssim - 0.003
    # Observed: within 0.1 %.
    np.testing.assert_allclose(ours.mean(axis=(0, 1)), theirs.mean(axis=(0, 1)), rtol=3e-3)
