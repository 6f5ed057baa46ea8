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
from jaxtyping import Bool, Float, Int

from focusjax._parallel import in_parallel, parts
from focusjax.geometry import Camera
from focusjax.layers._attributes import SurfaceSamples
from focusjax.layers._opacity import NEARER
from focusjax.layers._parts import Squares, square_parts
from focusjax.layers._picture import Rasterised
from focusjax.layers._shading import ShadedSamples, shaded
from focusjax.layers._touching import Band, in_bands
from focusjax.scene import Scene

_AT_ONCE = 1 << 21
"""Samples shaded at their centres together."""
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
    several = np.ones(count, dtype=bool)
    several[:number] = ~surface.inside | _beside_another(held, seen.index[:number])
    several = np.flatnonzero(several)
    several = several[np.argsort(seen.cell[several], kind="stable")]
    squares = _squares(held, surface, seen, several, tolerance, faces)
    per_sample = 1.0 / (float(camera.focal_px) * held.grid.supersampling)
    shader = scene.shader(camera.position)
    radiance = np.zeros((count, 3), dtype=jnp.zeros(()).dtype)
    unseen = np.ones(count, dtype=bool)

    def shade_parts(band: Band) -> None:
        sample = several[band.squares]
        pieces = square_parts(band, held.triangles, held.grid, squares.take(band.squares), faces)
        width = per_sample * np.sqrt(pieces.share) / seen.disparity[sample[pieces.square]]
        surface = pieces.surface
        look = shaded(shader, surface.face, surface.barycentric, width, gloss_apart=gloss_apart)
        total = np.bincount(pieces.square, pieces.share, len(sample))
        there = np.flatnonzero(total)
        unseen[sample[there]] = False
        for channel in range(3):
            light = np.bincount(pieces.square, pieces.share * look.radiance[:, channel], len(sample))
            radiance[sample[there], channel] = light[there] / total[there]

    in_bands(shade_parts, held.triangles, held.grid, squares.cell)
    centres = np.arange(number) if gloss_apart else np.flatnonzero(unseen[:number])
    normals = [np.zeros(0, dtype=np.uint32)]
    for part in parts(len(centres), _AT_ONCE):
        some = centres[part]
        width = per_sample / seen.disparity[some]
        look = shaded(shader, surface.face[some], surface.barycentric[some], width, gloss_apart=gloss_apart)
        alone = unseen[some]
        radiance[some[alone]] = look.radiance[alone]
        if look.normal is not None:
            normals.append(look.normal)
    lone = number + np.flatnonzero(unseen[number:])
    radiance[lone] = radiance[seen.source[lone]]
    return ShadedSamples(radiance, np.concatenate(normals) if gloss_apart else None)


def _squares(
    held: Rasterised,
    surface: SurfaceSamples,
    seen: Seen,
    several: Int[np.ndarray, " k"],
    tolerance: float,
    faces: Bool[np.ndarray, " t"] | None,
) -> Squares:
    """Those of the samples `several`, in their order."""
    low, high = (end[several] for end in _without_others(seen, tolerance))
    source = seen.source[several]
    if held.opacity is not None:
        put_back = np.where(held.opacity[source] < 1.0, 1.0 / NEARER, 1.0)
        low, high = low * put_back, high * put_back
    # Behind a triangle that covers all of a square nothing counts.
    behind = np.zeros_like(low)
    whole = np.flatnonzero(several < len(surface.face))
    whole = whole[surface.inside[several[whole]]]
    own = several[whole]
    steep = 0.5 * (np.abs(surface.slope_x[own]) + np.abs(surface.slope_y[own]))
    behind[whole] = (seen.disparity[own] - steep) * _HIDES
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
