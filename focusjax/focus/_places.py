"""From one place in the scene to image positions and disparities."""

import dataclasses
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int, Integer

from focusjax._arguments import real_numbers
from focusjax._device import device_array
from focusjax._programs import jit
from focusjax._words import did_you_mean, shown
from focusjax.focus._points import (
    AtInfinity,
    AtPixel,
    AtPoint,
    Attachment,
    InDepthRange,
    OnMask,
    OnObject,
    OnTriangle,
    Vector,
)
from focusjax.focus._visibility import VISIBLE_WITHIN, seen_at, visibility
from focusjax.geometry import Camera

BEHIND, OUTSIDE, HIDDEN = "behind the camera", "outside the frame", "hidden"
"""Why a place has no say."""

# Surface points drawn per sample wanted: an object seen only in part still gets its samples.
_CANDIDATES = 16

# The plastic number's powers: the two-dimensional counterpart of the golden ratio, whose
# multiples modulo 1 fill the square more evenly than random numbers.
_PLASTIC = 1.32471795724474602596


@dataclasses.dataclass(frozen=True)
class Place:
    """Where something is in the picture.

    Attributes:
        rows: image position in pixels and disparity in 1/m of every sample.
        trouble: why it cannot be seen, or nothing.
        shown: share of it that is to be seen.
    """

    rows: Float[np.ndarray, "n 3"] | Float[Array, "n 3"]
    trouble: str = ""
    shown: float = 1.0


@dataclasses.dataclass(frozen=True)
class Finder:
    """The scene as `locate` was given it; finds one place at a time."""

    camera: Camera
    vertices: Float[np.ndarray, "v 3"] | None
    faces: Integer[np.ndarray, "t 3"] | None
    objects: Mapping[str, range]
    disparity_map: Float[np.ndarray, "h w"] | None

    def find(self, where: Attachment, label: str) -> Place:
        match where:
            case AtPixel(x, y):
                return self._pixel(np.array([float(x), float(y)]), label)
            case AtPoint(position):
                return self._point(_finite(position, f"{label}: position"))
            case AtInfinity(direction):
                return self._direction(_finite(direction, f"{label}: direction"), label)
            case OnTriangle(face, barycentric):
                return self._point(self._on_triangle(int(face), barycentric, label))
            case OnObject(name, samples):
                return self._object(name, samples, label)
            case OnMask(mask, samples):
                return self._mask(mask, samples, label)
            case InDepthRange(near, far, samples):
                disparity = np.linspace(1.0 / float(near), 1.0 / float(far), samples)
                return Place(np.column_stack([np.tile(self._middle(), (samples, 1)), disparity]))

    def extent(self, where: Attachment, label: str) -> Place:
        """All of a place, seen or not: every vertex of an object, every pixel of a mask."""
        match where:
            case OnObject(name, _):
                vertices, faces = self._mesh(label)
                span = self._span(name, label)
                corners = vertices[np.unique(faces[span.start : span.stop])].astype(float)
                ahead = self._ahead(corners)
                return Place(ahead) if len(ahead) else self._nowhere(BEHIND)
            case OnMask(mask, _):
                line, column = np.nonzero(mask)
                middle = self._mask(mask, 1, label).rows
                edges = np.array([(column.min(), line.min()), (column.max() + 1, line.max() + 1)])
                return Place(np.column_stack([edges, np.repeat(middle[:, 2], 2)]))
            case _:
                found = self.find(where, label)
                return found if found.trouble == BEHIND else Place(found.rows)

    def traced(self, where: AtPoint | AtInfinity) -> bool:
        """Whether a place is only known when a compiled function runs."""
        given = where.position if isinstance(where, AtPoint) else where.direction
        return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(given))

    def unseen(self, where: AtPoint | AtInfinity) -> Place:
        """The place of a point that is traced; whether it is to be seen is not looked at."""
        given = where.position if isinstance(where, AtPoint) else where.direction
        point = jnp.asarray(given, dtype=float)
        if point.shape != (3,):
            raise ValueError(f"the place has {list(point.shape)} numbers; expected three")
        if isinstance(where, AtPoint):
            xy, disparity = self.camera.project(point)
            return Place(jnp.append(xy, disparity)[None])
        # A point in that direction is shown where its end is.
        ahead = self.camera.world_from_camera[:3, 3] + point / jnp.linalg.norm(point)
        xy, _ = self.camera.project(ahead)
        return Place(jnp.append(xy, jnp.zeros((), xy.dtype))[None])

    def _pixel(self, xy: Float[np.ndarray, "2"], label: str) -> Place:
        if self.disparity_map is None:
            raise ValueError(f"{label} is given as a pixel; that needs the disparity map")
        if not self._in_frame(xy[None])[0]:
            raise ValueError(
                f"{label} is off screen at pixel ({xy[0]:.6g}, {xy[1]:.6g}); expected 0 to"
                f" {self.camera.width} across and 0 to {self.camera.height} down"
            )
        return Place(np.append(xy, seen_at(self.disparity_map, xy[None])).reshape(1, 3))

    def _point(self, position: Float[np.ndarray, "3"]) -> Place:
        row = self._ahead(position[None])
        return self._judged(row) if len(row) else self._nowhere(BEHIND)

    def _direction(self, direction: Float[np.ndarray, "3"], label: str) -> Place:
        if not np.any(direction):
            raise ValueError(f"{label} is in direction {shown(direction)}; give one that is not zero")
        x, y, z = np.asarray(self.camera.world_from_camera)[:3, :3].T.astype(float) @ direction
        if not z < 0:
            return self._nowhere(BEHIND)
        offset = float(self.camera.focal_px) * np.array([x, -y]) / -z
        return self._judged(np.append(self._middle() + offset, 0.0)[None])

    def _judged(self, row: Float[np.ndarray, "1 3"]) -> Place:
        """The place of one point, with how much of it is to be seen."""
        if not self._in_frame(row[:, :2])[0]:
            return Place(row, OUTSIDE, 0.0)
        if self.disparity_map is None:
            return Place(row)
        shown = visibility(self.disparity_map, row[0, :2], float(row[0, 2]))
        return Place(row, "" if shown > 0 else HIDDEN, shown)

    def _on_triangle(self, face: int, barycentric: Vector, label: str) -> Float[np.ndarray, "3"]:
        vertices, faces = self._mesh(label)
        weights = _finite(barycentric, f"{label}: barycentric coordinates")
        if not 0 <= face < len(faces):
            raise ValueError(f"{label} is on face {face}; the scene has faces 0 to {len(faces) - 1}")
        if weights.min() < -1e-6 or abs(weights.sum() - 1) > 1e-6:
            raise ValueError(
                f"{label} has barycentric coordinates {shown(weights)}; expected three numbers that"
                " are not negative and add up to 1"
            )
        return weights @ vertices[faces[face]].astype(float)

    def _span(self, name: str, label: str) -> range:
        """An object's faces."""
        if name not in self.objects:
            hint = did_you_mean(name, self.objects, f"the scene has {sorted(self.objects)}")
            raise ValueError(f"{label} is on object {name!r}, which the scene does not have; {hint}")
        return self.objects[name]

    def _object(self, name: str, samples: int, label: str) -> Place:
        span = self._span(name, label)
        if self.disparity_map is None:
            raise ValueError(
                f"{label} is on object {name!r}; to see which part shows, give the disparity map"
            )
        vertices, faces = self._mesh(label)
        corners = vertices[faces[span.start : span.stop]].astype(float)
        ahead = self._ahead(_surface_samples(corners, _CANDIDATES * samples))
        if len(ahead) == 0:
            return self._nowhere(BEHIND)
        rows = ahead[self._in_frame(ahead[:, :2])]
        if len(rows) == 0:
            return Place(ahead[_thin_out(len(ahead), samples)], OUTSIDE, 0.0)
        seen = np.abs(seen_at(self.disparity_map, rows[:, :2]) - rows[:, 2]) <= VISIBLE_WITHIN * rows[:, 2]
        if not seen.any():
            return Place(rows[_thin_out(len(rows), samples)], HIDDEN, 0.0)
        rows = rows[seen]
        return Place(rows[_thin_out(len(rows), samples)])

    def _mask(self, mask: np.ndarray, samples: int, label: str) -> Place:
        if self.disparity_map is None:
            raise ValueError(f"{label} is on a mask; that needs the disparity map")
        if mask.shape != self.disparity_map.shape:
            raise ValueError(
                f"{label} has a mask of shape {mask.shape}; expected one value per pixel,"
                f" {self.disparity_map.shape}"
            )
        if not mask.any():
            raise ValueError(f"{label} has an empty mask; mark at least one pixel")
        solid = mask & (self.disparity_map > 0)
        line, column = np.nonzero(solid if solid.any() else mask)
        order = np.argsort(_along_z_curve(line, column), kind="stable")
        chosen = order[_thin_out(len(order), samples)]
        line, column = line[chosen], column[chosen]
        return Place(np.column_stack([column + 0.5, line + 0.5, self.disparity_map[line, column]]))

    def _mesh(self, label: str) -> tuple[Float[np.ndarray, "v 3"], Integer[np.ndarray, "t 3"]]:
        if self.vertices is None or self.faces is None:
            raise ValueError(f"{label} is on a mesh; that needs the scene's vertices and faces")
        return self.vertices, self.faces

    def _in_frame(self, xy: Float[np.ndarray, "n 2"]) -> np.ndarray:
        size = np.array([self.camera.width, self.camera.height])
        return np.all((xy >= 0) & (xy <= size), axis=-1)

    def _ahead(self, positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
        """Rows of those positions that are in front of the camera."""
        rows = np.asarray(_project_all(self.camera, device_array(positions, dtype=float))).astype(float)
        return rows[(rows[:, 2] > 0) & np.isfinite(rows).all(axis=-1)]

    def _middle(self) -> Float[np.ndarray, "2"]:
        return np.asarray(self.camera.principal_point).astype(float)

    def _nowhere(self, trouble: str) -> Place:
        """A place that has no image."""
        return Place(np.append(self._middle(), 0.0)[None], trouble, 0.0)


@jit
def _project_all(camera: Camera, positions: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Image position and disparity of world points."""
    xy, disparity = jax.vmap(camera.project)(positions)
    return jnp.concatenate([xy, disparity[:, None]], axis=-1)


def _along_z_curve(
    line: Integer[np.ndarray, "n"], column: Integer[np.ndarray, "n"]
) -> Integer[np.ndarray, "n"]:
    """Positions along a curve that fills the plane, so that even steps along it are spread evenly."""
    key = np.zeros(len(line), dtype=np.int64)
    for bit in range(16):
        key |= ((column >> bit) & 1).astype(np.int64) << (2 * bit)
        key |= ((line >> bit) & 1).astype(np.int64) << (2 * bit + 1)
    return key


def _finite(values: Vector, what: str) -> Float[np.ndarray, "3"]:
    array = real_numbers(values, what, "three finite numbers")
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{what} is {shown(array)}; expected three finite numbers")
    return array


def _surface_samples(corners: Float[np.ndarray, "t 3 3"], count: int) -> Float[np.ndarray, "n 3"]:
    """`count` points spread over triangles in proportion to their area; the same every time.

    Args:
        corners: triangle, corner, coordinate in metres.
        count: number of points n.

    Returns:
        Points in metres; none when the triangles have no area.
    """
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    total = area.sum()
    if not total > 0:
        return np.zeros((0, 3))
    # Equal steps along the summed area: every triangle gets its share to within one point.
    steps = (np.arange(count) + 0.5) / count * total
    triangle = np.minimum(np.searchsorted(np.cumsum(area), steps), len(area) - 1)
    barycentric = _barycentric(np.arange(count))
    return np.einsum("nk,nkx->nx", barycentric, corners[triangle])


def _barycentric(index: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """Well-spread barycentric weights: the unit square folded along its diagonal."""
    u = (0.5 + index / _PLASTIC) % 1.0
    v = (0.5 + index / _PLASTIC**2) % 1.0
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    return np.stack([1.0 - u - v, u, v], axis=-1)


def _thin_out(count: int, keep: int) -> Int[np.ndarray, "n"]:
    """Indices of at most `keep` out of `count` items, evenly spaced."""
    if count <= keep:
        return np.arange(count)
    return np.floor((np.arange(keep) + 0.5) * count / keep).astype(int)
