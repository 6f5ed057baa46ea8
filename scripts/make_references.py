"""Render the test suite's second scene with Mitsuba 3: a cow, bars close to the lens, a ball on the border.

Writes tests/data/cow_bars.npz (pictures and the exact geometry) and cow_bars.json (camera, lens, shading).
Needs the `bench` extra and a recent LLVM (DRJIT_LIBLLVM_PATH where the loader does not find it).

    python scripts/make_references.py --meshes configs/meshes --out tests/data
"""

import math
from pathlib import Path

import jax
import numpy as np
import trimesh
from _command_line import make_parser, write_json
from _shapes import squares

from focusjax.baselines import UnlitScene, mitsuba_picture
from focusjax.geometry import make_camera
from focusjax.lens import thin_lens

WIDTH, HEIGHT, FIELD_OF_VIEW = 256, 192, 40.0
EYE, TARGET = (0.25, 0.55, 3.0), (0.0, 0.0, 0.0)
SKY = (0.42, 0.58, 0.86)
VIEWS = (
    # Bars half a metre from the lens: their blur is 47 px across, from bars about 8 px wide.
    {"array": "dof_strong_foreground", "focus_distance_m": 2.9, "aperture_radius_m": 0.04},
    # The ball that the left border cuts is sharp, the bars in front of it and everything behind are not.
    {"array": "dof_ball_on_border", "focus_distance_m": 1.2, "aperture_radius_m": 0.03},
    {"array": "dof_infinity", "focus_distance_m": float("inf"), "aperture_radius_m": 0.02},
)


def camera_pose() -> np.ndarray:
    """world_from_camera [4, 4] of EYE looking at TARGET along -z, +y up."""
    backward = np.subtract(EYE, TARGET) / np.linalg.norm(np.subtract(EYE, TARGET))
    right = np.cross((0.0, 1.0, 0.0), backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(backward, right), backward], axis=1)
    pose[:3, 3] = EYE
    return pose


def build(meshes: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices [v, 3] float32, faces [t, 3] and linear colours [v, 3] uint8 (value / 255)."""
    parts = [
        _cow(meshes / "spot.glb"),
        _bars(meshes / "bars_24layers.ply"),
        _ball(),
        _checker(_wall_point, columns=22, rows=5, dark=(40, 48, 70), light=(226, 214, 190)),
        _checker(_floor_point, columns=14, rows=18, dark=(60, 84, 52), light=(150, 176, 120)),
    ]
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts])
    shifted = [faces + offset for (_, faces, _), offset in zip(parts, offsets, strict=False)]
    return (
        np.concatenate([vertices for vertices, _, _ in parts]).astype(np.float32),
        np.concatenate(shifted).astype(np.int32),
        np.concatenate([colours for _, _, colours in parts]).astype(np.uint8),
    )


def _cow(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spot in procedural patches, turned to show head and flank."""
    mesh = trimesh.load(path, force="mesh")
    vertices = np.asarray(mesh.vertices)
    patches = np.sin(9 * vertices[:, 0]) * np.sin(7 * vertices[:, 1] + 1) * np.sin(8 * vertices[:, 2]) > 0.1
    shade = 0.75 + 0.25 * np.asarray(mesh.vertex_normals)[:, 1:2]
    colours = np.where(patches[:, None], (96, 52, 30), (240, 226, 206)) * shade
    turn = trimesh.transformations.rotation_matrix(np.radians(145), (0, 1, 0))[:3, :3]
    return 0.8 * vertices @ turn.T + (0.15, -0.15, 0.0), np.asarray(mesh.faces), colours


def _bars(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every third bar of the two nearest layers, half as large, before the camera at 0.5 m."""
    mesh = trimesh.load(path, force="mesh", process=False)
    bars = sorted(mesh.split(only_watertight=False), key=lambda bar: tuple(-bar.centroid[::-1]))
    for bar in bars[1:24:3]:  # four times as wide, or the blur would leave nothing to see of them
        bar.vertices = bar.centroid + (bar.vertices - bar.centroid) * np.where(bar.extents < 0.1, 4.0, 1.0)
    chosen = trimesh.util.concatenate(bars[1:24:3])
    pose = camera_pose()
    vertices = 0.5 * np.asarray(chosen.vertices) @ pose[:3, :3].T + pose[:3, 3]
    stripes = (np.floor(np.asarray(chosen.vertices).sum(axis=1) * 5) % 2)[:, None]
    return vertices, np.asarray(chosen.faces), np.where(stripes > 0, (214, 60, 40), (250, 190, 40))


def _ball() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A banded ball 1.2 m from the lens whose middle lies on the picture's left border."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.16)
    pose = camera_pose()
    centre = np.array([-1.2 * np.tan(np.radians(FIELD_OF_VIEW / 2)), -0.08, -1.2])
    bands = np.sin(50 * mesh.vertices[:, 1:2]) > 0
    colours = np.where(bands, (40, 150, 160), (235, 240, 120))
    return mesh.vertices + (pose[:3, :3] @ centre + pose[:3, 3]), mesh.faces, colours


def _wall_point(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A wall that leans and turns, so that its squares lie along no pixel row; the sky shows above it."""
    return np.stack([9 * u - 4.5, 1.7 * v - 1.1 + 0.45 * u, -2.5 - 1.5 * u - 0.4 * v], axis=-1)


def _floor_point(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A floor that runs from the wall to under the camera."""
    return np.stack([8 * u - 4, np.full_like(u, -0.74), 3.4 - 7.5 * v], axis=-1)


def _checker(point, *, columns, rows, dark, light) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squares of one colour each over the surface point(u, v); squares share no vertices."""
    column, row, faces = squares(columns, rows)
    colours = np.where((row + column)[:, :1] % 2 == 0, dark, light)
    return point(column / columns, row / rows).reshape(-1, 3), faces, np.repeat(colours, 4, axis=0)


def compact(picture: np.ndarray) -> np.ndarray:
    """As float16 with a 7-bit mantissa: relative error below 0.4 %, under the noise and small on disk."""
    bits = picture.astype(np.float16).view(np.uint16).astype(np.uint32)
    return ((bits + 4) & 0xFFF8).astype(np.uint16).view(np.float16)


def main() -> None:
    parser = make_parser(__doc__)
    parser.add_argument("--meshes", type=Path, default=Path("configs/meshes"))
    parser.add_argument("--out", type=Path, default=Path("tests/data"))
    parser.add_argument("--samples", type=int, default=4096)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    vertices, faces, colours = build(options.meshes)
    scene = UnlitScene(vertices, faces, colours / 255.0, SKY)
    camera = make_camera(camera_pose(), width=WIDTH, height=HEIGHT, field_of_view=math.radians(FIELD_OF_VIEW))
    # References are independent of how focusjax takes a field of view.
    assert math.isclose(2 * math.atan(WIDTH / 2 / float(camera.focal_px)), math.radians(FIELD_OF_VIEW))
    pictures = {}
    for view in VIEWS:
        lens = thin_lens(focus_distance=view["focus_distance_m"], aperture_radius=view["aperture_radius_m"])
        pictures[view["array"]] = compact(mitsuba_picture(scene, camera, lens, samples=options.samples))
    options.out.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(
        options.out / "cow_bars.npz", vertices=vertices, faces=faces, colors=colours, **pictures
    )
    description = {
        "arrays": "cow_bars.npz",
        "width": WIDTH,
        "height": HEIGHT,
        "camera": {"eye": EYE, "look_at": TARGET, "up": [0, 1, 0], "fov_x_deg": FIELD_OF_VIEW},
        "background": SKY,
        "samples_per_pixel": {"dof": options.samples},
        "shading": "none: interpolated vertex colour colors/255 (linear, unlit, two-sided) at the first hit",
        "pixel_filter": "box, one pixel wide",
        "views": [{**view, "focus_distance_m": str(view["focus_distance_m"])} for view in VIEWS],
        "triangles": len(faces),
        "renderer": "Mitsuba 3 llvm_ad_rgb, thinlens sensor, aov integrator (albedo)",
    }
    write_json(options.out / "cow_bars.json", description)


if __name__ == "__main__":
    main()
