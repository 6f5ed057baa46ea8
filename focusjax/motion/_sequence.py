"""Shapes over time: an array of vertices by frame, or a mesh file per frame."""

import dataclasses
import re
import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Float

from focusjax.scene import SceneObject, load_mesh

_MOST_BYTES = 4 << 30
"""Of all arrays of a file, unpacked."""


@dataclasses.dataclass(frozen=True)
class VertexSequence:
    """The vertices of a mesh, one set per step, in the mesh's own coordinates and order.

    Between steps vertices go straight; before the first and after the last they stay.

    Attributes:
        positions: [steps, vertices, 3].
        first_frame: frame of the first step.
        frames_per_step: frames from one step to the next.
        what: how messages call it.
    """

    positions: Float[np.ndarray, "s n 3"]
    first_frame: float = 1.0
    frames_per_step: float = 1.0
    what: str = "the vertex sequence"

    def __post_init__(self) -> None:
        if len(self.positions) == 0:
            raise ValueError(f"{self.what} is empty; expected at least one set of vertices")
        if not 0 < self.frames_per_step < np.inf:
            raise ValueError(
                f"{self.what} has {self.frames_per_step} frames per step; expected a positive number"
            )

    def check(self, item: SceneObject) -> None:
        """Refuse an object that has other vertices.

        Raises:
            ValueError: naming both numbers.
        """
        assert item.source is not None
        needed = int(item.source.max()) + 1
        if self.positions.shape[1] < needed:
            raise ValueError(
                f"{self.what} has {self.positions.shape[1]} vertices per step but object {item.name!r} has"
                f" {needed}; export it from the same mesh"
            )
        bad = ~np.isfinite(self.positions[:, item.source]).all(axis=(1, 2))
        if bad.any():
            raise ValueError(f"{self.what} has values that are not finite in step {int(bad.argmax())}")

    def at(self, frame: float, item: SceneObject) -> Float[np.ndarray, "v 3"]:
        """The object's vertices at a frame, in the mesh's own coordinates."""
        assert item.source is not None
        last = len(self.positions) - 1
        step = float(np.clip((frame - self.first_frame) / self.frames_per_step, 0, last))
        before = min(int(step), max(last - 1, 0))
        after = min(before + 1, last)
        earlier, later = (self.positions[k][item.source] for k in (before, after))
        return earlier + (step - before) * (later - earlier)

    def normals(self, vertices: Float[np.ndarray, "v 3"], item: SceneObject) -> Float[np.ndarray, "v 3"]:
        """Normals of a shape in world axes, of any length: as smooth and as creased as the object's.

        Weighted by the areas of the triangles around each vertex.
        """
        corners = vertices[item.faces]
        areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        group = _shared(item)
        sums = np.stack(
            [np.bincount(group[item.faces].ravel(), np.repeat(areas[:, k], 3)) for k in range(3)], axis=1
        )
        return sums[group]


def load_vertex_sequence(
    path: str | Path, item: SceneObject, *, first_frame: float = 1.0, frames_per_step: float = 1.0
) -> VertexSequence:
    """The shapes of an object over time, from a file or from many.

    Args:
        path: an .npz or .npy file with one array [steps, vertices, 3] in the order of the mesh file's
            vertices, or the path of numbered mesh files with # for the digits, such as "walk_####.ply": each
            has the triangles of `item`, in its order, and other positions.
        item: the object that is to change, as `load_mesh` made it.
        first_frame: frame of the first step.
        frames_per_step: frames from one step to the next; between them vertices go straight.

    Raises:
        ValueError: no such file, another number of vertices, or other triangles; the message names the file.
    """
    path = Path(path)
    positions = _numbered(path, item) if "#" in path.name else _array(path)
    found = VertexSequence(positions, first_frame, frames_per_step, f"vertex sequence {path}")
    found.check(item)
    return found


def _array(path: Path) -> Float[np.ndarray, "s n 3"]:
    try:
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as packed:
                size = sum(part.file_size for part in packed.infolist())
            if size > _MOST_BYTES:
                raise ValueError(f"it holds {size} bytes; expected at most {_MOST_BYTES}")
        # Mapped, so that a file shorter than it says is refused before memory is taken.
        loaded = np.load(path, allow_pickle=False, mmap_mode="r")
    except FileNotFoundError:
        raise ValueError(f"vertex sequence {path} does not exist; check the path") from None
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"vertex sequence {path} cannot be read ({error}); expected an .npz file") from None
    if isinstance(loaded, np.lib.npyio.NpzFile):
        if len(loaded.files) != 1:
            raise ValueError(f"vertex sequence {path} holds the arrays {loaded.files}; expected just one")
        loaded = loaded[loaded.files[0]]
    if loaded.ndim != 3 or loaded.shape[2] != 3 or not np.issubdtype(loaded.dtype, np.number):
        raise ValueError(
            f"vertex sequence {path} has an array of shape {loaded.shape}; expected [steps, vertices, 3]"
        )
    return np.asarray(loaded, dtype=np.float64)


def _numbered(path: Path, item: SceneObject) -> Float[np.ndarray, "s n 3"]:
    """The vertices of all mesh files of a pattern, in the order of their numbers."""
    digits = re.findall("#+", path.name)
    if len(digits) != 1:
        raise ValueError(f"vertex sequence {path} has # in several places; expected one row of them")
    before, after = path.name.split(digits[0])
    name = re.compile(re.escape(before) + r"(\d{" + str(len(digits[0])) + r",})" + re.escape(after))
    numbered = {int(m[1]): p for p in path.parent.glob("*") if (m := name.fullmatch(p.name))}
    if not numbered:
        raise ValueError(f"vertex sequence {path} matches no file; check the path")
    numbers = sorted(numbered)
    missing = sorted(set(range(numbers[0], numbers[-1] + 1)) - set(numbers))
    if missing:
        raise ValueError(f"vertex sequence {path} lacks number {missing[0]}; number the files without gaps")
    return np.stack(
        [_own_vertices(load_mesh(numbered[number]), numbered[number], item) for number in numbers]
    )


def _own_vertices(mesh: SceneObject, path: Path, item: SceneObject) -> Float[np.ndarray, "n 3"]:
    """The vertices of a mesh by their own numbers; what no triangle uses is not known."""
    assert mesh.source is not None
    assert item.source is not None
    same = mesh.faces.shape == item.faces.shape
    # A mirrored placement turns triangles around.
    rows = (item.source[item.faces], item.source[item.faces[:, ::-1]])
    if not (same and any(np.array_equal(mesh.source[mesh.faces], each) for each in rows)):
        count = "" if same else f" ({len(mesh.faces)} against {len(item.faces)})"
        raise ValueError(
            f"mesh file {path} has other triangles than object {item.name!r}{count}; export all steps from"
            " one mesh, with vertices and faces in one order"
        )
    vertices = np.full((int(item.source.max()) + 1, 3), np.nan)
    vertices[mesh.source] = mesh.vertices
    return vertices


def _shared(item: SceneObject) -> np.ndarray:
    """A number for every vertex, the same for those at one place that face one way: seams do not show."""
    rows = np.ascontiguousarray(np.round(np.concatenate([item.vertices, item.normals], axis=1), 9) + 0.0)
    return np.unique(rows.view(np.dtype((np.void, 48))).ravel(), return_inverse=True)[1].ravel()
