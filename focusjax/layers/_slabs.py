"""Layers by slabs of depth, uniform in blur: one pass instead of peeling (Lee09 sections 4.1 and 4.2).

Lee09 spaces layers so that the signed circle of confusion grows by the same delta from one to the next,
for that is about how far in the picture a ray travels within a layer. Rays are lines q(w) = a + b w with
|b| at most the parallax f E, so between two disparities

    a ray travels at most f E |w1 - w2| pixels,   and a blur diameter changes by at most 2 f E |w1 - w2|,

for every lens; a thin lens's blur 2 f E (w_f - w) changes by just that, wherever it is focused. Slabs
uniform in blur are therefore slabs uniform in disparity, and equation 4 is, with delta a diameter,

    slab = floor((w_nearest - w) 2 f E / delta).

In its slab each sample keeps the nearest surface. A slab reaches a tenth of its thickness into the one
behind it. A surface found there is taken out of the one behind, which makes room for the next in it: what
is kept is always more than without the overlap. The paper overlaps slabs to close seams between them; we have
none, as joins link samples across layers.

Surfaces that the umbra hides (see `_peel`) are left out before they can take a place: those behind solid
parts of the first surface of all, and those right behind what a nearer slab keeps.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from focusjax._arguments import real_number, require_switches
from focusjax._counts import require_counts
from focusjax.geometry import Camera
from focusjax.layers._assemble import assemble
from focusjax.layers._grid import Extent, Grid
from focusjax.layers._layers import Layers, extent_like
from focusjax.layers._memory import check_layers
from focusjax.layers._peel import first_surface
from focusjax.layers._picture import rasterised_for
from focusjax.layers._raster import Fragments
from focusjax.layers._umbra import SEPARATION, hidden_below, windows_within
from focusjax.lens import AbstractLens
from focusjax.scene import Scene

_OVERLAP = 0.1
_MOST_SLABS = 1024


def decompose(
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    *,
    count: int | None = None,
    blur_step: float | None = None,
    supersampling: int = 1,
    near: float | None = None,
    view_dependent: bool = False,
    pixel_filter: str = "box",
    like: Layers | Extent | None = None,
    spare: bool = False,
) -> Layers:
    """The nearest surface in each of several slabs of depth, as layers seen from the lens centre (Lee09).

    The slabs divide the disparities of all that the lens can reach, evenly. Of two surfaces behind one
    another within a slab only the nearer is kept, so that light is missed where slabs are thick; peeling
    misses nothing, but how many layers that takes is not known beforehand. A layer of the result is not one
    slab: the surfaces at a sample fill the layers from the front, nearest first, as they do after `peel`.

    Args:
        scene: what is in front of the camera.
        camera: frame and pose.
        lens: the layers serve it and every lens whose rays stay within its own.
        count: number of slabs; give this or `blur_step`.
        blur_step: thickness of a slab in pixels: by how much the blur diameter may change within it (twice
            the delta of Lee09, which is of radii; they find 3 to 10 enough).
        supersampling: layer samples per output pixel and axis; see `peel`.
        near: depth in metres from which surfaces count; a tenth of the focal length if not given.
        view_dependent: keep what highlights and mirrored surroundings depend on; see `peel`.
        pixel_filter: how a pixel weighs the light around its centre; see `peel`.
        like: layers of another moment whose shapes are kept, so that nothing is compiled again; see `peel`.
        spare: leave room for later layers like these, up to as many as slabs; see `peel`.

    Returns:
        At most as many layers as slabs; `complete` says whether every surface that is not known to be
        hidden found a place.

    Raises:
        ValueError: not exactly one of `count` and `blur_step`, a value out of range, a step so small
            that it makes over a thousand slabs, a grid or layers that do not fit in memory, or layers to
            be like that are of another frame.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> fj.decompose(fj.make_scene([wall], unlit=True), camera, lens, count=4).count
        1
    """
    if (count is None) == (blur_step is None):
        raise ValueError(f"count is {count} and blur_step is {blur_step}; give exactly one of them")
    require_counts(supersampling=supersampling)
    if count is not None:
        require_counts(count=count)
    require_switches(view_dependent=view_dependent, spare=spare)
    expected = "a positive number such as 4"
    if blur_step is not None and not 0 < real_number(blur_step, "blur_step in pixels", expected) < math.inf:
        raise ValueError(f"blur_step is {blur_step} px; expected {expected}")
    extent = extent_like(like)
    picture = rasterised_for(
        scene, camera, lens, supersampling=supersampling, near=near, pixel_filter=pixel_filter, like=extent
    )
    grid, parallax = picture.grid, float(lens.parallax(camera))
    bounds = _bounds(picture.fragments.disparity, parallax, count, blur_step)
    chosen, left_out = slab_fragments(
        picture.fragments, grid, parallax * grid.supersampling, bounds, opacity=picture.opacity
    )
    limit = "count" if blur_step is None else "the number of slabs by a larger blur_step"
    counts = [len(some) for some in chosen]
    check_layers(grid, counts, limit)
    return assemble(
        scene,
        camera,
        lens,
        picture.held(chosen),
        counts,
        max_layers=len(bounds) - 1,
        left_out=left_out,
        like=extent,
        spare=spare,
        view_dependent=view_dependent,
        pixel_filter=pixel_filter,
    )


def _bounds(
    disparity: Float[np.ndarray, " f"], parallax: float, count: int | None, blur_step: float | None
) -> Float[np.ndarray, " b"]:
    """Decreasing disparities between which slabs of even thickness lie, by their number or by their blur.

    Raises:
        ValueError: more slabs than there can be.
    """
    nearest = float(disparity.max(initial=0.0))
    span = nearest - float(disparity.min(initial=nearest))
    if blur_step is not None:
        count = max(1, math.ceil(2.0 * parallax * span / blur_step))
        thickness = blur_step / (2.0 * parallax) if parallax > 0 else span
    else:
        assert count is not None
        thickness = span / count
    if count > _MOST_SLABS:
        remedy = "give a lower count" if blur_step is None else f"make the blur_step of {blur_step} px larger"
        raise ValueError(f"{count} slabs are more than the {_MOST_SLABS} there can be; {remedy}")
    return nearest - thickness * np.arange(count + 1)


def slab_fragments(
    fragments: Fragments,
    grid: Grid,
    parallax: float,
    bounds: np.ndarray,
    *,
    opacity: Float[np.ndarray, " f"] | None = None,
) -> tuple[list[Int[np.ndarray, " _"]], int]:
    """The fragments that each layer holds, in the order of their samples.

    Also how many were left out that are not known to be hidden. `parallax` is f E in samples per dioptre;
    `bounds` are the decreasing disparities [slabs + 1] between which slabs lie, of which the outermost are
    open; `opacity` is that of each fragment, None where all are opaque.
    """
    shape = (grid.rows, grid.columns)
    opaque = None if opacity is None else opacity == 1.0
    alive = _not_behind_the_first(fragments, grid, parallax, opaque)
    layers: list[np.ndarray] = []
    filled = np.zeros(grid.size, dtype=np.int32)
    limit = np.full(grid.size, np.inf, dtype=fragments.disparity.dtype)
    overlap = _OVERLAP * (bounds[0] - bounds[-1]) / (len(bounds) - 1)
    left_out = 0
    for farther in [*bounds[1:-1], 0.0]:
        within = fragments.disparity[alive] >= farther - overlap
        nearest, owner = _nearest(fragments, alive[within], grid)
        held = np.flatnonzero(owner >= 0)
        if not len(held):
            continue
        depth = filled[held]
        layers += [np.full(grid.size, -1, dtype=np.int32) for _ in range(len(layers), depth.max() + 1)]
        for number, layer in enumerate(layers):
            here = held[depth == number]
            layer[here] = owner[here]
        filled[held] += 1
        limit = np.minimum(limit, np.where(owner >= 0, nearest * np.float32(1.0 - SEPARATION), np.inf))
        solid = nearest if opaque is None else np.where((owner >= 0) & opaque[owner], nearest, 0)
        limit = np.minimum(limit, hidden_below(solid.reshape(shape), parallax).reshape(-1))
        disparity = fragments.disparity[alive]
        left = disparity < limit[fragments.sample[alive]]
        # What is left in this slab is too near for the next one.
        missed = left & (disparity >= farther)
        left_out += int(missed.sum())
        alive = alive[left & ~missed]
    return [layer[layer >= 0] for layer in layers], left_out


def _not_behind_the_first(
    fragments: Fragments, grid: Grid, parallax: float, opaque: Bool[np.ndarray, " f"] | None
) -> Int[np.ndarray, " n"]:
    """Fragments but for those that solid parts of the first opaque surface hide."""
    among = np.arange(len(fragments.sample)) if opaque is None else np.flatnonzero(opaque)
    first, _ = _nearest(fragments, among, grid)
    windows = windows_within(parallax, float(first.max(initial=0.0)))
    limit = hidden_below(first.reshape(grid.rows, grid.columns), parallax, windows=windows).reshape(-1)
    sample, disparity = fragments.sample, fragments.disparity
    return np.flatnonzero((disparity < limit[sample]) | (disparity >= first[sample]))


def _nearest(
    fragments: Fragments, chosen: Int[np.ndarray, " n"], grid: Grid
) -> tuple[Float[np.ndarray, " samples"], Int[np.ndarray, " samples"]]:
    """Disparity and index of the nearest of the `chosen` fragments at every sample; 0 and -1 if none is."""
    disparity, owner = first_surface(fragments.sample[chosen], fragments.disparity[chosen], grid)
    there = owner >= 0
    owner[there] = chosen[owner[there]]
    return disparity, owner
