"""Radiances of samples: means over the part of each sample's square that its surface covers.

    L = sum over parts k of |P_k| L(c_k)  /  sum over k of |P_k|,

where part k of the square lies in triangle k of the surface, |P_k| is its share of the square, and c_k its
centroid (see `_parts`): exact where radiance changes linearly within each triangle. So edges between
colours inside a surface keep their place, and triangles smaller than a sample their share of the light. A
square inside one triangle is looked at in its centre alone.
"""

import dataclasses

import numpy as np

from focusjax.geometry import Camera
from focusjax.layers._attributes import SurfaceSamples
from focusjax.layers._parts import Parts, Squares, inside_one, square_parts
from focusjax.layers._picture import Rasterised
from focusjax.layers._shading import ShadedSamples, shaded
from focusjax.scene import Scene


@dataclasses.dataclass(frozen=True)
class Seen:
    """Samples as the layers have them: those held, and after them the fringe.

    Attributes:
        cell: grid sample [n], row-major.
        disparity: 1/m [n].
        low: least disparity [n] that each spans.
        high: largest disparity [n].
        source: sample [n] whose surface it is: itself of the samples held.
        cut: whether [n] a line cuts it.
    """

    cell: np.ndarray
    disparity: np.ndarray
    low: np.ndarray
    high: np.ndarray
    source: np.ndarray
    cut: np.ndarray
    index: np.ndarray


def mean_radiances(
    scene: Scene,
    camera: Camera,
    held: Rasterised,
    surface: SurfaceSamples,
    seen: Seen,
    tolerance: float,
    *,
    gloss_apart: bool,
) -> ShadedSamples:
    """What the samples `seen` look like; `surface` is at the centres of those held.

    Surfaces are `tolerance` dioptres thick: what lies closer belongs to one. The normals are those at the
    centres, and of the samples held alone.
    """
    number, count = len(surface.face), len(seen.cell)
    faces = scene.may_be_seen_through()
    several = np.concatenate([~inside_one(held.stamps, held.fragments, held.grid), np.ones(count - number, bool)])
    E = __import__("os").environ.get("ALLC")
    if E == "1":
        several[:] = True
    elif E == "2":
        several[:number] |= _beside_another(held, seen.index[:number])
    several = np.flatnonzero(several)
    squares = _squares(seen, tolerance, None if faces is None else faces[surface.face[seen.source]])
    parts = square_parts(held.triangles, held.grid, squares.take(several), faces)
    owner = several[parts.square]
    total = np.bincount(owner, parts.share, count)
    centres = np.arange(number) if gloss_apart else np.flatnonzero(total[:number] == 0)
    look = _shaded_together(scene, camera, held, surface, seen, parts, owner, centres, gloss_apart=gloss_apart)
    radiance = np.zeros((count, 3), dtype=look.radiance.dtype)
    radiance[centres] = look.radiance[: len(centres)]
    there = np.flatnonzero(total)
    for channel in range(3):
        sums = np.bincount(owner, parts.share * look.radiance[len(centres) :, channel], count)
        radiance[there, channel] = sums[there] / total[there]
    lone = number + np.flatnonzero(total[number:] == 0)
    radiance[lone] = radiance[seen.source[lone]]
    return ShadedSamples(radiance, None if look.normal is None else look.normal[:number])


def _shaded_together(
    scene: Scene,
    camera: Camera,
    held: Rasterised,
    surface: SurfaceSamples,
    seen: Seen,
    parts: Parts,
    owner: np.ndarray,
    centres: np.ndarray,
    *,
    gloss_apart: bool,
) -> ShadedSamples:
    """The samples `centres` at their centres and, after them, all parts, `owner` being their samples."""
    per_sample = 1.0 / (float(camera.focal_px) * held.grid.supersampling)
    width = per_sample / np.concatenate([seen.disparity[centres], seen.disparity[owner]])
    width[len(centres) :] *= np.sqrt(parts.share)
    return shaded(
        scene.shader(camera.position),
        np.concatenate([surface.face[centres], parts.surface.face]),
        np.concatenate([surface.barycentric[centres], parts.surface.barycentric]),
        width,
        gloss_apart=gloss_apart,
    )


def _squares(seen: Seen, tolerance: float, clear: np.ndarray | None) -> Squares:
    """Of all samples, with disparities that are nearer to them than to others in the same place."""
    low, high = np.maximum(seen.low - tolerance, 0.0), seen.high + tolerance
    several = np.flatnonzero(np.bincount(seen.cell)[seen.cell] > 1)
    several = several[np.lexsort((seen.disparity[several], seen.cell[several]))]
    farther, nearer = several[:-1], several[1:]
    same = seen.cell[farther] == seen.cell[nearer]
    farther, nearer = farther[same], nearer[same]
    middle = 0.5 * (seen.disparity[farther] + seen.disparity[nearer])
    high[farther] = np.minimum(high[farther], middle)
    cut = seen.cut[nearer]
    nearer, middle = nearer[cut], middle[cut]
    low[nearer] = np.maximum(low[nearer], middle)
    return Squares(seen.cell, low, high, clear)


def _beside_another(held: Rasterised, index: np.ndarray) -> np.ndarray:
    """Whether one of the samples around each in its layer, of those held at flat `index`, shows another triangle."""
    triangle = held.stamps.triangle[held.fragments.stamp]
    columns, size = held.grid.columns, held.grid.size
    ends = np.searchsorted(index, size * np.arange(index[-1] // size + 2))
    out = np.zeros(len(index), bool)
    for layer, (a, b) in enumerate(zip(ends[:-1], ends[1:])):
        there = index[a:b] - layer * size
        shown = np.full(size, -1, np.int32)
        shown[there] = triangle[a:b]
        shown = shown.reshape(held.grid.rows, columns)
        differs = np.zeros(shown.shape, bool)
        across = shown[:, 1:] != shown[:, :-1]
        differs[:, 1:] |= across
        differs[:, :-1] |= across
        down = shown[1:] != shown[:-1]
        differs[1:] |= down
        differs[:-1] |= down
        for k in (0, 1):
            diagonal = shown[1:, 1:] != shown[:-1, :-1] if k == 0 else shown[1:, :-1] != shown[:-1, 1:]
            if k == 0:
                differs[1:, 1:] |= diagonal
                differs[:-1, :-1] |= diagonal
            else:
                differs[1:, :-1] |= diagonal
                differs[:-1, 1:] |= diagonal
        out[a:b] = differs.reshape(-1)[there]
    return out
