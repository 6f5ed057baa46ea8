"""A piece of a mesh as it comes, and what is refused of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from focusjax import _parallel
from focusjax._arguments import ArgumentError
from focusjax.scene._material import Material

_FACES_AT_ONCE = 1 << 14
_FARTHEST = 1e12
"""Metres from the origin within which single precision still separates directions after squaring."""
_SMALLEST = 1e-12
"""Metres from end to end, for the same reason."""


@dataclass(frozen=True)
class Part:
    """A piece of a mesh with one material, before normals are made; `check_part` tests its shapes.

    vertices [v, 3], faces [t, 3], normals [v, 3], uv [v, 2], linear colours [v, 3], opacity [v].
    """

    vertices: Float[np.ndarray, "..."]
    faces: Int[np.ndarray, "..."]
    material: Material
    normals: Float[np.ndarray, "..."] | None = None
    uv: Float[np.ndarray, "..."] | None = None
    colours: Float[np.ndarray, "..."] | None = None
    opacity: Float[np.ndarray, "..."] | None = None


def check_part(part: Part, what: str) -> None:
    """Raise a ValueError when `part` is empty, not finite, or refers to vertices it lacks."""
    if part.faces.size == 0:
        raise ValueError(f"{what} has no faces; expected a mesh of triangles")
    if part.vertices.ndim != 2 or part.vertices.shape[-1] != 3 or part.faces.shape[1:] != (3,):
        raise ValueError(
            f"{what} has vertices {part.vertices.shape} and faces {part.faces.shape};"
            " expected three coordinates per vertex and three vertices per face"
        )
    if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
        worst = part.faces.min() if part.faces.min() < 0 else part.faces.max()
        raise ValueError(
            f"{what} has a face that refers to vertex {worst}, but its {len(part.vertices)} vertices"
            f" are 0 to {len(part.vertices) - 1}; repair the file"
        )
    bad = ~np.isfinite(part.vertices).all(axis=1)
    if bad.any():
        raise ValueError(
            f"{what} has {int(bad.sum())} vertices with NaN or infinite coordinates (the first is"
            f" vertex {int(bad.argmax())}); repair the mesh"
        )
    for values, name, width in ((part.uv, "texture coordinates", 2), (part.colours, "vertex colours", 3)):
        if values is not None and values.shape != (len(part.vertices), width):
            raise ValueError(
                f"{what} has {name} of shape {values.shape}; expected {(len(part.vertices), width)}"
            )
        if values is not None and not np.isfinite(values).all():
            raise ValueError(f"{what} has {name} that are not finite; repair the mesh")
    if part.colours is not None and (part.colours < 0).any():
        raise ValueError(
            f"{what} has vertex colours below 0 (the least is {part.colours.min():g}); repair the mesh"
        )


def check_size(parts: Sequence[Part], placed: Float[np.ndarray, "v 3"], linear: object, what: str) -> None:
    """Refuse parts that are points in the world, at `placed`, and are none by themselves.

    Args:
        parts: as they come.
        placed: their vertices in world metres.
        linear: how they are turned and scaled [3, 3].
        what: names them.

    Raises:
        ArgumentError: they are less than a picometre from end to end; it is about `scale`.
    """
    if np.ptp(placed, axis=0).max() >= _SMALLEST:
        return
    own = max(float(np.ptp(part.vertices, axis=0).max()) for part in parts)
    size = max(float(np.ptp(part.vertices @ np.asarray(linear).T, axis=0).max()) for part in parts)
    if own > 0.0 and size < _SMALLEST:
        raise ArgumentError(
            f"{what} is {size:.3g} m from end to end; expected at least {_SMALLEST:g} m, so give a larger"
            " scale",
            "scale",
        )


def check_placed(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"], what: str) -> None:
    """Raise a ValueError when placed triangles lie beyond all reason, or none has an area."""
    farthest = float(np.abs(vertices).max())
    if not farthest <= _FARTHEST:
        raise ValueError(
            f"{what} reaches {farthest:.3g} m from the origin; expected at most {_FARTHEST:g} m, so check its"
            " scale, or make it part of the background"
        )
    if not any(_has_area(vertices[faces[some]]) for some in _parallel.parts(len(faces), _FACES_AT_ONCE)):
        raise ValueError(
            f"{what} has no area: its triangles ({len(faces)}) are lines or points; repair the mesh, or"
            " its scale"
        )


def _has_area(corners: Float[np.ndarray, "t 3 3"]) -> bool:
    """Whether any of some triangles is more than a line or a point."""
    first, second, third = corners.transpose(1, 0, 2)
    doubled = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    longest = np.maximum(np.linalg.norm(second - first, axis=1), np.linalg.norm(third - first, axis=1))
    return bool((doubled > 1e-12 * longest**2).any())
