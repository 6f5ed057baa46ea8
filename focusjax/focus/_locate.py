"""From places in the scene to image positions and disparities."""

import dataclasses
import difflib
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Integer

from focusjax.focus._image_points import ImagePoints
from focusjax.focus._points import (
    AtInfinity,
    AtPixel,
    AtPoint,
    Attachment,
    Blur,
    FocusPoint,
    OnObject,
    OnTriangle,
    Vector,
)
from focusjax.focus._surface import surface_samples, thin_out
from focusjax.geometry import Camera

VISIBLE_WITHIN = 0.01
"""A surface point is visible when its disparity is within this share of the first surface's."""

# Surface points drawn per sample wanted: an object seen only in part still gets its samples.
_CANDIDATES = 16


def locate(
    points: Sequence[FocusPoint],
    camera: Camera,
    *,
    vertices: Float[np.ndarray, "v 3"] | None = None,
    faces: Integer[np.ndarray, "t 3"] | None = None,
    objects: Mapping[str, range] | None = None,
    disparity_map: Float[np.ndarray, "h w"] | Float[Array, "h w"] | None = None,
) -> ImagePoints:
    """Where every wish is in the picture, and how far away.

    A pixel takes the disparity of the first surface at the nearest pixel centre. World points,
    triangles and directions count whether or not something hides them. Of an object, those sampled
    surface points count that the camera sees: in the frame, and within `VISIBLE_WITHIN` of the
    disparity of the first surface at the nearest pixel centre. They share the wish's weight.

    Args:
        points: the wishes, at least one.
        camera: the pinhole that frames the picture.
        vertices: world metres; needed for triangles and objects.
        faces: rows of `vertices`; needed for triangles and objects.
        objects: object names and their ranges of faces; needed for objects.
        disparity_map: disparity of the first surface at every pixel centre in 1/m, 0 where there is
            only background; needed for pixels and objects.

    Raises:
        ValueError: no points; a place that is off screen, behind the camera, not finite or not in
            the scene; an object that is unknown or hidden; a missing argument.

    Example:
        >>> from focusjax.focus import Sharp
        >>> from focusjax.geometry import make_camera
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> found = locate([FocusPoint(AtPoint((0, 0, -2)), Sharp(), name="nose")], camera)
        >>> found.names, found.xy.tolist(), found.disparity.tolist()
        (('nose',), [[32.0, 24.0]], [0.5])
    """
    if not points:
        raise ValueError("there are no focus points; give at least one wish")
    finder = _Finder(camera, vertices, faces, objects or {}, _checked_map(disparity_map, camera))
    names = tuple(point.name or f"point {index + 1}" for index, point in enumerate(points))
    places = [
        finder.find(point.where, f"focus point {name!r}") for point, name in zip(points, names, strict=True)
    ]
    counts = np.array([len(place) for place in places])
    blurs = [point.wish if isinstance(point.wish, Blur) else Blur(0.0, signed=True) for point in points]
    weights = np.array([float(point.weight) for point in points]) / counts
    rows = np.concatenate(places)
    wish = np.repeat(np.arange(len(points)), counts)
    return ImagePoints(
        xy=jnp.asarray(rows[:, :2], dtype=float),
        disparity=jnp.asarray(rows[:, 2], dtype=float),
        target=jnp.asarray(np.array([float(blur.pixels) for blur in blurs])[wish], dtype=float),
        signed=jnp.asarray(np.array([blur.signed for blur in blurs])[wish]),
        weight=jnp.asarray(weights[wish], dtype=float),
        tolerance=jnp.asarray(np.array([float(point.tolerance) for point in points])[wish], dtype=float),
        wish=jnp.asarray(wish),
        names=names,
    )


@dataclasses.dataclass(frozen=True)
class _Finder:
    """The scene as `locate` was given it; finds one place at a time as rows of (x, y, disparity)."""

    camera: Camera
    vertices: Float[np.ndarray, "v 3"] | None
    faces: Integer[np.ndarray, "t 3"] | None
    objects: Mapping[str, range]
    disparity_map: Float[np.ndarray, "h w"] | None

    def find(self, where: Attachment, label: str) -> Float[np.ndarray, "n 3"]:
        match where:
            case AtPixel(x, y):
                return self._pixel(np.array([float(x), float(y)]), label)
            case AtPoint(position):
                return self._point(_finite(position, f"{label}: position"), label)
            case AtInfinity(direction):
                return self._direction(_finite(direction, f"{label}: direction"), label)
            case OnTriangle(face, barycentric):
                return self._point(self._on_triangle(int(face), barycentric, label), label)
            case OnObject(name, samples):
                return self._object(name, samples, label)

    def _pixel(self, xy: Float[np.ndarray, "2"], label: str) -> Float[np.ndarray, "1 3"]:
        if self.disparity_map is None:
            raise ValueError(f"{label} is given as a pixel; that needs the disparity map")
        row = self._on_screen(np.append(xy, 0.0)[None], label)
        return np.append(xy, self._seen(row)).reshape(1, 3)

    def _point(self, position: Float[np.ndarray, "3"], label: str) -> Float[np.ndarray, "1 3"]:
        rows = _project(self.camera, position[None])
        if not rows[0, 2] > 0 or not np.all(np.isfinite(rows)):
            raise ValueError(
                f"{label} at {position.tolist()} m is behind the camera; move it, or turn the camera"
            )
        return self._on_screen(rows, label)

    def _direction(self, direction: Float[np.ndarray, "3"], label: str) -> Float[np.ndarray, "1 3"]:
        if not np.any(direction):
            raise ValueError(f"{label} is in direction {direction.tolist()}; give one that is not zero")
        x, y, z = np.asarray(self.camera.world_from_camera)[:3, :3].T.astype(float) @ direction
        if not z < 0:
            raise ValueError(
                f"{label} in direction {direction.tolist()} is behind the camera; turn the camera"
            )
        offset = float(self.camera.focal_px) * np.array([x, -y]) / -z
        xy = np.asarray(self.camera.principal_point).astype(float) + offset
        return self._on_screen(np.append(xy, 0.0)[None], label)

    def _on_triangle(self, face: int, barycentric: Vector, label: str) -> Float[np.ndarray, "3"]:
        vertices, faces = self._mesh(label)
        weights = _finite(barycentric, f"{label}: barycentric coordinates")
        if not 0 <= face < len(faces):
            raise ValueError(f"{label} is on face {face}; the scene has faces 0 to {len(faces) - 1}")
        if weights.min() < -1e-6 or abs(weights.sum() - 1) > 1e-6:
            raise ValueError(
                f"{label} has barycentric coordinates {weights.tolist()}; expected three numbers that"
                " are not negative and add up to 1"
            )
        return weights @ vertices[faces[face]].astype(float)

    def _object(self, name: str, samples: int, label: str) -> Float[np.ndarray, "n 3"]:
        if name not in self.objects:
            near = difflib.get_close_matches(name, list(self.objects), n=1, cutoff=0.4)
            hint = f"did you mean {near[0]!r}?" if near else f"the scene has {sorted(self.objects)}"
            raise ValueError(f"{label} is on object {name!r}, which the scene does not have; {hint}")
        if self.disparity_map is None:
            raise ValueError(
                f"{label} is on object {name!r}; to see which part shows, give the disparity map"
            )
        vertices, faces = self._mesh(label)
        span = self.objects[name]
        corners = vertices[faces[span.start : span.stop]].astype(float)
        rows = _project(self.camera, surface_samples(corners, _CANDIDATES * samples))
        rows = rows[self._in_frame(rows) & (rows[:, 2] > 0)]
        rows = rows[np.abs(self._seen(rows) - rows[:, 2]) <= VISIBLE_WITHIN * rows[:, 2]]
        if len(rows) == 0:
            raise ValueError(
                f"{label} is on object {name!r}, no part of which shows in the picture; move the camera,"
                " or wish for something that shows"
            )
        return rows[thin_out(len(rows), samples)]

    def _mesh(self, label: str) -> tuple[Float[np.ndarray, "v 3"], Integer[np.ndarray, "t 3"]]:
        if self.vertices is None or self.faces is None:
            raise ValueError(f"{label} is on a mesh; that needs the scene's vertices and faces")
        return self.vertices, self.faces

    def _in_frame(self, rows: Float[np.ndarray, "n 3"]) -> np.ndarray:
        size = np.array([self.camera.width, self.camera.height])
        return np.all((rows[:, :2] >= 0) & (rows[:, :2] <= size), axis=-1)

    def _on_screen(self, rows: Float[np.ndarray, "1 3"], label: str) -> Float[np.ndarray, "1 3"]:
        if not self._in_frame(rows).all():
            x, y = rows[0, :2]
            raise ValueError(
                f"{label} is off screen at pixel ({x:.6g}, {y:.6g}); expected 0 to {self.camera.width}"
                f" across and 0 to {self.camera.height} down"
            )
        return rows

    def _seen(self, rows: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Disparity of the first surface at the pixel centres nearest to rows in the frame."""
        assert self.disparity_map is not None
        height, width = self.disparity_map.shape
        column, line = np.floor(rows[:, :2]).astype(int).T
        return self.disparity_map[np.minimum(line, height - 1), np.minimum(column, width - 1)]


@eqx.filter_jit
def _project_all(camera: Camera, positions: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    xy, disparity = jax.vmap(camera.project)(positions)
    return jnp.concatenate([xy, disparity[:, None]], axis=-1)


def _project(camera: Camera, positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Image position and disparity of world points, in float64 rows."""
    return np.asarray(_project_all(camera, jnp.asarray(positions, dtype=float))).astype(float)


def _finite(values: Vector, what: str) -> Float[np.ndarray, "3"]:
    array = np.asarray(values, dtype=float)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{what} is {array.tolist()}; expected three finite numbers")
    return array


def _checked_map(
    disparity_map: Float[np.ndarray, "h w"] | Float[Array, "h w"] | None, camera: Camera
) -> Float[np.ndarray, "h w"] | None:
    if disparity_map is None:
        return None
    array = np.asarray(disparity_map).astype(float)
    if array.shape != (camera.height, camera.width):
        raise ValueError(
            f"the disparity map has shape {array.shape}; expected one value per pixel,"
            f" {(camera.height, camera.width)}"
        )
    if not np.all(np.isfinite(array) & (array >= 0)):
        raise ValueError("the disparity map has negative values or values that are not finite")
    return array
