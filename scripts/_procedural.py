"""Benchmark scenes: many lumpy balls, or given meshes, spread through a view before a painted wall."""

import dataclasses
import math
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh
from _shapes import squares

from focusjax.geometry import Camera, make_camera
from focusjax.lens import ThinLens, thin_lens
from focusjax.scene import Scene, SceneObject, load_mesh, make_object, make_scene

HALF_WIDTH, HALF_HEIGHT = 0.38, 0.29  # of the view, per metre of depth


def boulders(count: int = 120, subdivisions: int = 4, seed: int = 0) -> trimesh.Trimesh:
    """`count` lumpy balls of 5120 triangles each (at 4 subdivisions), with painted stripes, in one mesh."""
    random = np.random.default_rng(seed)
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    parts = []
    for place in placements(count, random):
        waves = random.normal(scale=5.0, size=(3, 3))
        lumps = 1.0 + 0.05 * np.sin(ball.vertices @ waves.T + random.uniform(0, 6, 3)).sum(axis=1)
        stripes = 0.65 + 0.35 * np.sin(14.0 * ball.vertices @ random.normal(size=3))
        colours = np.clip(random.uniform(0.1, 1.0, 3) * stripes[:, None] * 255, 0, 255).astype(np.uint8)
        radius = random.uniform(0.1, 0.35)
        vertices = radius * lumps[:, None] * ball.vertices + place
        parts.append(trimesh.Trimesh(vertices, ball.faces, vertex_colors=colours, process=False))
    return trimesh.util.concatenate(parts)


def placements(count: int, random: np.random.Generator) -> np.ndarray:
    """Positions [count, 3] in metres, 2 to 12 m ahead of a camera at the origin, over the whole view."""
    depth = random.uniform(2.0, 12.0, count)
    across = random.uniform(-1.15, 1.15, (count, 2)) * (HALF_WIDTH, HALF_HEIGHT)
    return np.concatenate([across * depth[:, None], -depth[:, None]], axis=1)


def wall(columns: int = 64, rows: int = 48, seed: int = 1) -> SceneObject:
    """Squares of random colours 14 m away, larger than the view."""
    random = np.random.default_rng(seed)
    column, row, faces = squares(columns, rows)
    x, y = (column / columns - 0.5) * 16.0, (row / rows - 0.5) * 12.0
    vertices = np.stack([x, y, np.full_like(x, -14.0)], axis=-1).reshape(-1, 3)
    colours = np.repeat(random.uniform(0.05, 0.95, (rows * columns, 3)), 4, axis=0)
    return make_object("wall", vertices, faces, vertex_colours=colours)


def view(width: int, height: int, *, focus: float = 5.0, radius: float = 0.05) -> tuple[Camera, ThinLens]:
    """A camera at the origin, 30 degrees high, and the lens before it; metres."""
    field = 2 * math.atan(math.tan(math.radians(15)) * width / height)
    camera = make_camera(np.eye(4), width=width, height=height, field_of_view=field)
    return camera, thin_lens(focus_distance=focus, aperture_radius=radius)


def timed_scene(meshes: list[Path], count: int | None, subdivisions: int) -> tuple[Scene, float]:
    """The scene and the seconds from files on disk to `Scene`.

    Args:
        meshes: files to use instead of the balls; their copies stand where balls would.
        count: balls or copies; 120 balls, or three copies of each mesh, if not given.
        subdivisions: of the balls.
    """
    with TemporaryDirectory() as folder:
        if not meshes:
            file = Path(folder) / "boulders.ply"
            boulders(120 if count is None else count, subdivisions).export(file)
        start = time.perf_counter()
        if meshes:
            loaded = [load_mesh(path, name=path.stem) for path in meshes]
            objects = _copies(loaded, 3 * len(loaded) if count is None else count)
        else:
            objects = [load_mesh(file)]
        scene = make_scene([*objects, wall()], unlit=True)
        return scene, time.perf_counter() - start


def _copies(loaded: list[SceneObject], count: int) -> list[SceneObject]:
    """`count` copies in turn, 1.2 m large, painted by their normals so that there is something to see."""
    random = np.random.default_rng(2)
    copies = []
    for number, place in enumerate(placements(count, random)):
        source = loaded[number % len(loaded)]
        low, high = source.vertices.min(axis=0), source.vertices.max(axis=0)
        vertices = (source.vertices - (low + high) / 2) * (1.2 / (high - low).max()) + place
        paint = random.uniform(0.3, 1.0, 3) * (0.6 + 0.4 * source.normals)
        name = f"{source.name} {number}"
        # The paint is all of the colour, as it is for the program that the picture is compared with.
        white = tuple(dataclasses.replace(m, base_colour=np.ones(3)) for m in source.materials)
        copies.append(
            dataclasses.replace(source, name=name, vertices=vertices, colours=paint, materials=white)
        )
    return copies
