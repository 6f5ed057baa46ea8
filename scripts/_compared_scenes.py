"""The scenes on which focusjax is compared with a denoised path tracer, made by rule.

Two kinds, each in two variants. `scan`: a scanned object of about a million triangles, several to a pixel,
whose colours differ from vertex to vertex, before a checkered wall that is blurred over some 30 pixels.
`leaves`: leafy trees before a town, in focus on a tree, 121,000 and 141,000 triangles. The first variants are
for tuning; the second ones are for reporting only, so nothing is ever tuned on them.

All is unlit: colours of vertices are radiance.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from _shapes import squares

from focusjax.bench import baked
from focusjax.geometry import Camera, look_at
from focusjax.lens import ThinLens, thin_lens
from focusjax.scene import (
    Scene,
    SceneObject,
    constant_background,
    load_mesh,
    make_object,
    make_scene,
)

Compared = tuple[Scene, Camera, ThinLens]
Colour = tuple[float, float, float]
SIZE = {"width": 800, "height": 600}
_MESHES = Path(__file__).parent.parent / "configs" / "meshes"
_SKY = (0.45, 0.56, 0.72)
_ROOM = (0.12, 0.13, 0.15)


def scan(variant: int) -> Compared:
    """A scanned object before a checkered wall: 1, a lumpy head for tuning, or 2, a knotted rope."""
    if variant == 1:
        camera = look_at((0, 0, 0), (0, 0, -1), **SIZE, field_of_view=np.radians(34))
        thing = _painted("head", _lumpy_head(seed=11), seed=12, hue=(0.62, 0.46, 0.34))
        wall = _checkered_wall(2.6, 0.11, (0.08, 0.1, 0.16), (0.86, 0.8, 0.62), turn=4.0)
        lens = _blurring(camera, focus=0.78, depth=2.6, pixels=30.0)
    else:
        camera = look_at((0.5, 0.62, 1.1), (0, 0, 0), **SIZE, field_of_view=np.radians(40))
        thing = _painted("rope", _knotted_rope(seed=21), seed=22, hue=(0.3, 0.5, 0.58))
        wall = _facing(
            camera, _checkered_wall(3.4, 0.17, (0.7, 0.16, 0.1), (0.92, 0.9, 0.84), turn=-11.0, lean=14.0)
        )
        lens = _blurring(camera, focus=1.16, depth=3.4, pixels=30.0)
    return make_scene([thing, wall], background=constant_background(_ROOM), unlit=True), camera, lens


def leaves(variant: int) -> Compared:
    """Leafy trees before a town, in focus on one of them: 1 for tuning, or 2, others from another place."""
    if variant == 1:
        eye, target, field = (46.0, 16.0, 34.0), (-32.9, 3.0, -27.5), 38.0
        trees = (
            ((32.5, 6.2, 22.6), 20.0, 1.15),
            ((20.0, 3.5, 20.0), 140.0, 1.6),
            ((17.98, 2.28, 11.39), 250.0, 1.7),
            ((8.0, 2.2, -6.0), 75.0, 1.9),
        )
        in_focus, pixels = 0, 16.0
    else:
        eye, target, field = (-52.0, 13.0, -40.0), (30.0, 3.0, 22.0), 46.0
        trees = (
            ((-46.0, 7.2, -36.5), 300.0, 0.6),
            ((-36.0, 2.2, -26.5), 35.0, 1.3),
            ((-30.0, 2.2, -29.0), 110.0, 1.3),
            ((-14.0, 2.3, -9.0), 190.0, 1.8),
            ((-2.0, 2.3, -6.0), 5.0, 1.7),
        )
        in_focus, pixels = 1, 22.0
    camera = look_at(eye, target, **SIZE, field_of_view=np.radians(field))
    ashes = [
        load_mesh(
            _MESHES / "tree_ash.ply", name=f"ash {k}", translate=place, rotate=(0, turn, 0), scale=scale
        )
        for k, (place, turn, scale) in enumerate(trees)
    ]
    town = load_mesh(_MESHES / "town_denhaag.ply", name="town")
    lit = [_in_daylight(thing, seed=30 + 10 * variant + k) for k, thing in enumerate([town, *ashes])]
    plain = baked(make_scene(lit, unlit=True))
    scene = make_scene(
        [make_object("all", plain.vertices, plain.faces, vertex_colours=plain.colours)],
        background=constant_background(_SKY),
        unlit=True,
    )
    lens = _blurring(camera, focus=_depth(camera, ashes[in_focus]), depth=np.inf, pixels=pixels)
    return scene, camera, lens


SCENES: dict[str, Callable[[], Compared]] = {
    "scan-1": lambda: scan(1),
    "scan-2": lambda: scan(2),
    "leaves-1": lambda: leaves(1),
    "leaves-2": lambda: leaves(2),
}
"""All of them by name at 800 x 600."""


def _blurring(camera: Camera, *, focus: float, depth: float, pixels: float) -> ThinLens:
    """Focused at `focus` metres, with a blur diameter of `pixels` at `depth` metres."""
    radius = pixels / (2 * float(camera.focal_px) * abs(1 / focus - 1 / depth))
    return thin_lens(focus_distance=focus, aperture_radius=radius)


def _depth(camera: Camera, thing: SceneObject) -> float:
    """Metres along the view axis to the middle of the near half of an object."""
    pose = np.asarray(camera.world_from_camera)
    depths = (pose[:3, 3] - thing.vertices) @ pose[:3, 2]
    return float(np.quantile(depths, 0.25))


def _lumpy_head(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A cube of 280 x 280 squares a side blown up to a ball with lumps, ridges and pores, 0.9 m away."""
    random, count = np.random.default_rng(seed), 280
    steps = np.tan(np.linspace(-np.pi / 4, np.pi / 4, count + 1))
    u, v = np.meshgrid(steps, steps)
    one = np.ones_like(u)
    sides = [(u, v, one), (-u, v, -one), (one, v, -u), (-one, v, u), (u, one, -v), (u, -one, v)]
    points = np.concatenate([np.stack(side, axis=-1).reshape(-1, 3) for side in sides])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    radius = np.full(len(points), 0.175)
    for scale, amount, number in ((2.0, 0.011, 5), (9.0, 0.0035, 8), (45.0, 0.001, 8)):
        waves = random.normal(scale=scale, size=(number, 3))
        radius += amount * np.sin(points @ waves.T + random.uniform(0, 2 * np.pi, number)).sum(axis=1)
    radius += 0.006 * np.abs(np.sin(11 * points[:, 1] + 3 * np.sin(4 * points[:, 0])))
    faces = np.concatenate([_grid_faces(count, count) + k * (count + 1) ** 2 for k in range(len(sides))])
    return points * radius[:, None] * (1.0, 1.15, 1.0) + (0.03, -0.01, -0.95), faces


def _knotted_rope(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A trefoil knot of 1600 x 300 squares, twisted from strands and rough, half a metre across."""
    random, (along, around) = np.random.default_rng(seed), (1600, 300)
    t = np.linspace(0, 2 * np.pi, along + 1)[:, None]
    angle = np.linspace(0, 2 * np.pi, around + 1)[None, :]

    def middle(t: np.ndarray) -> np.ndarray:
        x = np.sin(t) + 2 * np.sin(2 * t)
        return 0.1 * np.stack([x, np.cos(t) - 2 * np.cos(2 * t), -1.4 * np.sin(3 * t)], axis=-1)

    tangent = middle(t + 1e-4) - middle(t - 1e-4)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    side = np.cross(tangent, (0.0, 0.0, 1.0))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    radius = 0.062 + 0.007 * np.abs(np.sin(2.5 * angle + 30 * t))
    for _ in range(10):
        m, n = random.integers(20, 160, 2)
        radius = radius + 0.0006 * np.sin(m * t + (n // 8) * angle + random.uniform(0, 2 * np.pi))
    out = np.cos(angle)[..., None] * side + np.sin(angle)[..., None] * np.cross(tangent, side)
    points = middle(t) + radius[..., None] * out
    return points.reshape(-1, 3), _grid_faces(along, around)


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Two triangles for each square of a grid of (rows + 1) x (columns + 1) vertices."""
    row, column = (index.ravel() for index in np.mgrid[:rows, :columns])
    corner = row * (columns + 1) + column
    below = corner + columns + 1
    return np.stack([corner, corner + 1, below + 1, corner, below + 1, below], axis=-1).reshape(-1, 3)


def _painted(name: str, mesh: tuple[np.ndarray, np.ndarray], *, seed: int, hue: Colour) -> SceneObject:
    """Broad stains, fine veins, and noise of its own at every vertex, as scanners leave it."""
    vertices, faces = mesh
    random = np.random.default_rng(seed)
    near = vertices - vertices.mean(axis=0)
    tone = np.full((len(vertices), 3), 1.0)
    for scale, amount in ((15.0, 0.13), (60.0, 0.11), (250.0, 0.08)):
        waves = random.normal(scale=scale, size=(3, 3))
        tone += amount * np.sin(near @ waves.T + random.uniform(0, 2 * np.pi, 3))
    tone *= 1 + 0.25 * random.normal(size=(len(vertices), 1)) + 0.08 * random.normal(size=(len(vertices), 3))
    return make_object(name, vertices, faces, vertex_colours=np.clip(tone * np.asarray(hue), 0.01, 1.0))


def _checkered_wall(
    depth: float, edge: float, dark: Colour, light: Colour, *, turn: float, lean: float = 0.0
) -> SceneObject:
    """Squares `edge` metres wide at `depth` metres before a camera at the origin, beyond the view.

    The pattern is turned in its plane by `turn` degrees; the wall leans back by `lean` degrees.
    """
    count = 2 * round(1.6 * depth / edge / 2)
    column, row, faces = squares(count, count)
    x, y = (column - count / 2) * edge, (row - count / 2) * edge
    across, back = np.radians(turn), np.radians(lean)
    x, y = x * np.cos(across) - y * np.sin(across), x * np.sin(across) + y * np.cos(across)
    vertices = np.stack([x, y * np.cos(back), -depth - y * np.sin(back)], axis=-1).reshape(-1, 3)
    paint = np.where((row + column)[:, :1] % 2 == 0, dark, light)
    return make_object("wall", vertices, faces, vertex_colours=np.repeat(paint, 4, axis=0))


def _facing(camera: Camera, wall: SceneObject) -> SceneObject:
    """A wall given in the camera's frame, in the world's."""
    pose = np.asarray(camera.world_from_camera)
    vertices = wall.vertices @ pose[:3, :3].T + pose[:3, 3]
    return make_object("wall", vertices, wall.faces, vertex_colours=wall.colours)


def _in_daylight(thing: SceneObject, *, seed: int) -> SceneObject:
    """An object with its light painted on: a sun, a sky, and grain."""
    random = np.random.default_rng(seed)
    sun = np.array([0.55, 0.7, 0.45]) / np.linalg.norm([0.55, 0.7, 0.45])
    light = 0.5 + 0.6 * np.clip(np.abs(thing.normals @ sun), 0.0, 1.0)
    grain = 1 + 0.12 * random.normal(size=len(thing.vertices))
    colours = np.clip(thing.colours * (light * grain)[:, None], 0.0, 1.0)
    return make_object(
        thing.name, thing.vertices, thing.faces, vertex_colours=colours, colour=thing.materials[0].base_colour
    )
