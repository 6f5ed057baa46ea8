"""The shapes that objects have, about the origin and one metre in their largest extent."""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from focusjax.scene import SceneObject, load_mesh

_FINE = 3
"""Subdivisions of an icosahedron for spheres, of 1280 triangles; lights have two less."""
_MESHES_KEPT = 64
"""In the memory of a process."""


@dataclass(frozen=True)
class Shape:
    """Triangles with texture coordinates.

    Attributes:
        vertices: [v, 3].
        faces: vertex numbers [t, 3].
        uv: texture coordinates [v, 2]; 1 is about the largest extent.
        smooth_angle: degrees up to which edges are shaded smooth.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "t 3"]
    uv: Float[np.ndarray, "v 2"]
    smooth_angle: float = 0.0

    @property
    def radius(self) -> float:
        """The largest distance from the origin."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def patch(width: float, height: float) -> Shape:
    """A rectangle in the plane z = 0 that faces +z."""
    corners = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]) * (width, height)
    return Shape(np.pad(corners, ((0, 0), (0, 1))), np.array([(0, 1, 2), (0, 2, 3)]), corners + 0.5)


def box(x: float, y: float, z: float) -> Shape:
    """A cuboid of those edges, each side with texture coordinates of its own."""
    edges = np.array([x, y, z])
    vertices, faces, uv = [], [], []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        for side in (-0.5, 0.5):
            corners = np.zeros((4, 3))
            corners[:, axis] = side
            corners[:, across] = (-0.5, 0.5, 0.5, -0.5)
            corners[:, along] = (-0.5, -0.5, 0.5, 0.5)
            start = 4 * len(vertices)
            turn = (0, 1, 2, 3) if side > 0 else (0, 3, 2, 1)
            quad = np.array([(turn[0], turn[1], turn[2]), (turn[0], turn[2], turn[3])])
            faces.append(start + quad)
            uv.append(corners[:, [across, along]] * edges[[across, along]] + 0.5)
            vertices.append(corners * edges)
    return Shape(np.concatenate(vertices), np.concatenate(faces), np.concatenate(uv))


@functools.cache
def sphere(subdivisions: int = _FINE) -> Shape:
    """A sphere of diameter 1; its texture is seen along z, and so without a seam."""
    import trimesh.creation

    made = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.5)
    vertices = np.asarray(made.vertices, dtype=np.float64)
    return Shape(vertices, np.asarray(made.faces), vertices[:, :2] + 0.5, smooth_angle=180.0)


def light() -> Shape:
    """A sphere that is small in the picture."""
    return sphere(_FINE - 2)


@functools.lru_cache(maxsize=_MESHES_KEPT)
def mesh(path: Path, folder: Path) -> SceneObject:
    """A mesh file with its middle in the origin, and one metre in its largest extent.

    What it names in its turn is read from below `folder` only.

    Raises:
        ValueError: as `load_mesh`.
    """
    raw = load_mesh(path, within=(folder,))
    low, high = raw.vertices.min(axis=0), raw.vertices.max(axis=0)
    scale = 1.0 / float((high - low).max())
    return load_mesh(path, translate=tuple(-0.5 * scale * (low + high)), scale=scale, within=(folder,))
