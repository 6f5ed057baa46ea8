"""Radiances of samples: means over the part of each sample's square that its surface covers.

    L = sum over parts k of |P_k| L(c_k)  /  sum over k of |P_k|,

where part k of the square lies in triangle k of the surface, |P_k| is its share of the square, and c_k its
centroid (see `_parts`): exact where radiance changes linearly within each triangle. So edges between
colours inside a surface keep their place, and triangles smaller than a sample their share of the light. A
square inside one triangle, as all around it are, is looked at in its centre alone.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt

from focusjax._parallel import in_parallel, parts
from focusjax.geometry import Camera
from focusjax.layers._attributes import SurfaceSamples
from focusjax.layers._opacity import NEARER
from focusjax.layers._parts import Squares, inside_one, square_parts
from focusjax.layers._picture import Rasterised
from focusjax.layers._shading import ShadedSamples, shaded
from focusjax.scene import Scene, Shader

_AT_ONCE = 1 << 21
"""Samples shaded together."""
_HIDES = 1.0 - 1e-4
"""Of a surface's disparity: what is nearer than this may lie in the same place."""


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
        index: flat index [n] in the layers.
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
    inside = inside_one(held.triangles, held.fragments, held.grid)
    several = np.ones(count, dtype=bool)
    several[:number] = ~inside | _beside_another(held, seen.index[:number])
    several = np.flatnonzero(several)
    squares = _squares(held, surface, seen, inside, several, tolerance, faces)
    asked = _Asked(held, surface, seen, several, squares, faces, gloss_apart=gloss_apart)
    per_sample = 1.0 / (float(camera.focal_px) * held.grid.supersampling)
    shader = scene.shader(camera.position)
    radiance = np.zeros((count, 3), dtype=jnp.zeros(()).dtype)
    normals, lone = [], []
    for part in parts(count, _AT_ONCE):
        alone, normal = _shade_part(shader, per_sample, asked, part, radiance)
        lone.append(alone)
        normals.append(normal)
    lone = np.concatenate([np.zeros(0, dtype=np.intp), *lone])
    radiance[lone] = radiance[seen.source[lone]]
    return ShadedSamples(radiance, np.concatenate(normals) if gloss_apart else None)


@dataclasses.dataclass(frozen=True)
class _Asked:
    """Samples whose looks are asked for; what is not said here, `mean_radiances` says.

    Attributes:
        several: samples [k], increasing, whose squares may lie in several triangles.
        squares: theirs.
        faces: which of the scene's faces may be seen through; None if none may.
    """

    held: Rasterised
    surface: SurfaceSamples
    seen: Seen
    several: Int[np.ndarray, " k"]
    squares: Squares
    faces: Bool[np.ndarray, " t"] | None
    gloss_apart: bool


def _shade_part(
    shader: Shader, per_sample: float, asked: _Asked, part: slice, radiance: Float[np.ndarray, "n 3"]
) -> tuple[Int[np.ndarray, " l"], UInt[np.ndarray, " h"]]:
    """Writes the radiance of the samples `part`.

    Some at a time, so that no more is held of the others than what they look like. `per_sample` is the width
    of a sample at one metre.

    Returns:
        Samples of the fringe that no triangle covers, and packed normals of the samples held, if asked for.
    """
    surface, seen, held = asked.surface, asked.seen, asked.held
    number, length = len(surface.face), part.stop - part.start
    some = slice(*np.searchsorted(asked.several, (part.start, part.stop)))
    chosen = asked.several[some]
    pieces = square_parts(held.triangles, held.grid, asked.squares.take(some), asked.faces)
    owner = chosen[pieces.square]
    total = np.bincount(owner - part.start, pieces.share, length)
    at_centre = max(number - part.start, 0)
    if asked.gloss_apart:
        centres = part.start + np.arange(min(at_centre, length))
    else:
        centres = part.start + np.flatnonzero(total[:at_centre] == 0)
    width = per_sample / np.concatenate([seen.disparity[centres], seen.disparity[owner]])
    width[len(centres) :] *= np.sqrt(pieces.share)
    look = shaded(
        shader,
        np.concatenate([surface.face[centres], pieces.surface.face]),
        np.concatenate([surface.barycentric[centres], pieces.surface.barycentric]),
        width,
        gloss_apart=asked.gloss_apart,
    )
    radiance[centres] = look.radiance[: len(centres)]
    there = np.flatnonzero(total)
    for channel in range(3):
        light = pieces.share * look.radiance[len(centres) :, channel]
        sums = np.bincount(owner - part.start, light, length)
        radiance[part.start + there, channel] = sums[there] / total[there]
    alone = part.start + at_centre + np.flatnonzero(total[at_centre:] == 0)
    normal = np.zeros(0, dtype=np.uint32) if look.normal is None else look.normal[: len(centres)]
    return alone, normal


def _squares(
    held: Rasterised,
    surface: SurfaceSamples,
    seen: Seen,
    inside: Bool[np.ndarray, " h"],
    several: Int[np.ndarray, " k"],
    tolerance: float,
    faces: Bool[np.ndarray, " t"] | None,
) -> Squares:
    """Those of the samples `several`; `inside` says which of those held lie inside one triangle."""
    low, high = (end[several] for end in _without_others(seen, tolerance))
    source = seen.source[several]
    if held.opacity is not None:
        put_back = np.where(held.opacity[source] < 1.0, 1.0 / NEARER, 1.0)
        low, high = low * put_back, high * put_back
    # Behind a triangle that covers all of a square nothing counts.
    behind = np.zeros_like(low)
    number = int(np.searchsorted(several, len(surface.face)))
    own = several[:number]
    steep = 0.5 * (np.abs(surface.slope_x[own]) + np.abs(surface.slope_y[own]))
    behind[:number] = np.where(inside[own], (seen.disparity[own] - steep) * _HIDES, 0.0)
    clear = None if faces is None else faces[surface.face[source]]
    triangle = held.fragments.triangle[source]
    return Squares(seen.cell[several], np.maximum(low, behind), high, triangle, clear)


def _without_others(seen: Seen, tolerance: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Least and largest disparity of each sample's surface, without those of others in the same place.

    A sample that no line cuts is all that rays see of its square, so it takes in what is right behind it.
    """
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
    return low, high


def _beside_another(held: Rasterised, index: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Whether one of the eight samples around each in its layer shows another triangle, or none.

    Of the samples held, at flat `index`. Where all show one, nothing as large as a sample reaches in.
    """
    grid = held.grid
    triangle = held.fragments.triangle
    ends = np.searchsorted(index, grid.size * np.arange(index.max(initial=0) // grid.size + 2))

    def inside(layer: int) -> Bool[np.ndarray, " k"]:
        part = slice(ends[layer], ends[layer + 1])
        there = index[part] - layer * grid.size
        least = np.full(grid.size, -1, dtype=np.int32)
        least[there] = triangle[part]
        least = most = least.reshape(grid.rows, grid.columns)
        for _ in range(2):
            # Along rows, then along columns: over squares of three.
            least, most = (_over_three(least, np.minimum).T, _over_three(most, np.maximum).T)
        return (least != most).reshape(-1)[there]

    return np.concatenate([np.zeros(0, dtype=bool), *in_parallel(inside, range(len(ends) - 1))])


def _over_three(values: Int[np.ndarray, "h w"], op: np.ufunc) -> Int[np.ndarray, "h w"]:
    """`op` over each number and the ones before and after it in its row."""
    out = values.copy()
    op(out[:, 1:], values[:, :-1], out=out[:, 1:])
    op(out[:, :-1], values[:, 1:], out=out[:, :-1])
    return out
