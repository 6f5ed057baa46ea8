"""Soft outlines of blurred foregrounds: lens rays followed through one sharp view.

A pixel beside a blurred foreground does not find it by its own depth, as `gather` looks: a wall in focus
has no circle of confusion at all. So pixels that a nearer thing's circle of confusion reaches follow their
lens rays from the nearest depth around to farther ones, until a ray is as deep as what the view shows where
it passes (a search as in relief mapping, Policarpo et al. 2005). Rays that hit the foreground have its
colour, the others that of what is behind it, so that outlines are as soft as the lens makes them, on both
sides. A ray that goes on behind something, where the view shows nothing, has the colour of the last place
that it passed before what is seen there.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.post._gather import (
    block_means,
    film_points,
    gather,
    gradient_noise,
    in_chunks,
    most_levels,
    signed_radii,
    tap_sample,
)

_TILE = 4
"""Pixels along the side of the squares in which the nearest depth around is found."""
_LEAST_RADIUS = 0.75
"""Pixels of blur's radius from which a foreground is followed."""
_LEAST_STEP = 1.0
"""Pixels by which the nearest thing's circle of confusion exceeds that of a pixel that follows its rays."""
_INSIDE = 4.0
"""The same, of a pixel of the foreground above the least blurred within its circle of confusion."""
_SAME = 1.0
"""Pixels that a ray moves at most between its own depth and that of what it hits."""
_STEPS = 3
"""Depths at which a ray is compared with the view."""
_CLEAR = 2.0
"""Pixels of radius by which a foreground must be more blurred than what is behind it to leave a line."""
_STRONG = 4.0
"""Pixels of radius from which blur hides a mean over 3 x 3 pixels."""
_ALIKE = 0.5
"""Pixels of blur's radius by which pixels of one surface differ."""
_NOWHERE = -1.0
_AROUND = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1)]
_FARTHER = [(row, column) for row in range(-2, 3) for column in range(-2, 3)]


def defocused(
    image: Float[Array, "h w 3"],
    disparity: Float[Array, "h w"],
    camera: Camera,
    lens: AbstractLens,
    *,
    taps: int,
    levels: int | None = None,
) -> Float[Array, "h w 3"]:
    """One sharp view through a lens: by `gather`, and beside blurred foregrounds along lens rays.

    Arguments are those of `gather`.
    """
    real = jnp.zeros(()).dtype
    sharp, depths = jnp.asarray(image, real), jnp.asarray(disparity, real)
    radii = signed_radii(depths, camera, lens)
    front, outlined = outline_zone(depths, radii, camera, lens)
    zone = np.asarray(outlined)
    if not zone.any():
        return gather(sharp, depths, camera, lens, taps=taps, levels=levels)
    if levels is None:
        levels = most_levels(float(jnp.abs(radii).max()), taps)
    picture = gather(sharp, depths, camera, lens, taps=taps, levels=levels, wanted=~zone)
    shown = _parts(_shown(_unmixed(sharp, radii), radii, jnp.asarray(taps), levels), radii)
    follow = functools.partial(
        _followed, shown.reshape(-1, 7), depths, front, camera, lens, jnp.asarray(taps)
    )
    parts = in_chunks(follow, _parts(picture, radii), zone)
    return jnp.where(outlined[..., None], _joined(parts), picture)


@jit
def _parts(image: Float[Array, "h w 3"], radii: Float[Array, "h w"]) -> Float[Array, "h w 7"]:
    """Light of strongly blurred foregrounds, how much of a pixel they cover, and the other light."""
    strong = (-radii >= _STRONG).astype(image.dtype)[..., None]
    return jnp.concatenate([strong * image, strong, (1.0 - strong) * image], axis=-1)


@jit
def _joined(parts: Float[Array, "h w 7"]) -> Float[Array, "h w 3"]:
    """The picture of its parts, strongly blurred foregrounds and their coverage averaged over 3 x 3 pixels.

    Both change little from pixel to pixel, so that this takes noise only; what shows between stays sharp.
    """
    covered = parts[..., 3:4]
    around = functools.reduce(jnp.add, (_moved(parts, *step) for step in _AROUND)) / len(_AROUND)
    light, cover, other = around[..., :3], around[..., 3:4], around[..., 4:]
    alone = covered >= 1.0 - 1e-6
    behind = parts[..., 4:] / jnp.where(alone, 1.0, 1.0 - covered)
    return light + jnp.where(alone, other, (1.0 - cover) * behind)


@jit
def outline_zone(
    disparity: Float[Array, "h w"], radii: Float[Array, "h w"], camera: Camera, lens: AbstractLens
) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
    """The nearest disparity around each pixel whose blur reaches it, and where it matters.

    Depths are those of tiles, so that the zone is up to two tiles too wide. `radii` are those of circles of
    confusion in pixels, negative before the focus.

    Returns:
        The disparity in 1/m, -1 where no blurred foreground is around, and the pixels beside its outline:
        those less blurred before the focus than it is, and its own that have such pixels within their circle.
    """
    height, width = disparity.shape
    near = jnp.maximum(-radii, 0.0)
    blurred = near >= _LEAST_RADIUS
    own = _tile_maxima(near)
    tiles = _tile_maxima(jnp.where(blurred, disparity, _NOWHERE)), own, -_tile_maxima(-near), own

    def grow(number: Array, tiles: tuple[Array, ...]) -> tuple[Array, ...]:
        depth, reach, least, within = tiles
        far_enough = reach > number * _TILE
        spread = jnp.where(far_enough, depth, _NOWHERE), jnp.where(far_enough, reach, 0.0)
        lower = -_ring_maximum(-least)
        within = jnp.where(own > number * _TILE, jnp.minimum(within, lower), within)
        return (
            jnp.maximum(depth, _ring_maximum(spread[0])),
            jnp.maximum(reach, _ring_maximum(spread[1])),
            lower,
            within,
        )

    rings = jnp.ceil(near.max() / _TILE).astype(jnp.int32)
    depth, _, _, within = jax.lax.fori_loop(0, rings, grow, tiles)
    front, least = (
        jnp.repeat(jnp.repeat(tile, _TILE, axis=0), _TILE, axis=1)[:height, :width]
        for tile in (depth, within)
    )
    there = -signed_radii(jnp.maximum(front, 0.0), camera, lens)
    outside = there - near > _LEAST_STEP
    inside = near - least > _INSIDE
    return front, (front >= 0.0) & (outside | inside)


def _tile_maxima(plane: Float[Array, "h w"]) -> Float[Array, "m n"]:
    height, width = plane.shape
    padded = jnp.pad(plane, ((0, -height % _TILE), (0, -width % _TILE)), mode="edge")
    rows, columns = padded.shape[0] // _TILE, padded.shape[1] // _TILE
    return padded.reshape(rows, _TILE, columns, _TILE).max(axis=(1, 3))


def _ring_maximum(tiles: Float[Array, "m n"]) -> Float[Array, "m n"]:
    """The maximum over each tile and the eight around it."""
    rows, columns = tiles.shape
    padded = jnp.pad(tiles, 1, mode="edge")
    over = functools.reduce(jnp.maximum, [padded[k : k + rows] for k in range(3)])
    return functools.reduce(jnp.maximum, [over[:, k : k + columns] for k in range(3)])


@jit
def _unmixed(image: Float[Array, "h w 3"], radii: Float[Array, "h w"]) -> Float[Array, "h w 3"]:
    """The view with colours of its own depth in pixels that the edge of a blurred foreground crosses.

    The mean radiance over such a pixel is partly the foreground's, which would stay as a sharp line in what
    is behind it. The colour becomes that of pixels around that are as blurred and have no such edge.
    """
    near = jnp.maximum(-radii, 0.0)
    around = functools.reduce(jnp.maximum, (_moved(near, *step) for step in _AROUND))
    crossed = around - jnp.abs(radii) > _CLEAR
    colour, weight = jnp.zeros_like(image), jnp.zeros_like(near)
    for row, column in _FARTHER:
        alike = jnp.abs(_moved(radii, row, column) - radii) < _ALIKE
        counts = (alike & ~_moved(crossed, row, column)) * math.exp(-(row**2) - column**2)
        colour = colour + counts[..., None] * _moved(image, row, column)
        weight = weight + counts
    known = crossed & (weight > 0.0)
    return jnp.where(known[..., None], colour / jnp.where(known, weight, 1.0)[..., None], image)


def _moved(plane: Shaped[Array, "h w *c"], row: int, column: int) -> Shaped[Array, "h w *c"]:
    """What is up to two rows below and columns to the right, beyond the border what is there."""
    height, width = plane.shape[:2]
    padded = jnp.pad(plane, ((2, 2), (2, 2), *((0, 0) for _ in plane.shape[2:])), mode="edge")
    return padded[2 + row : 2 + row + height, 2 + column : 2 + column + width]


@jit
def _shown(
    image: Float[Array, "h w 3"], radii: Float[Array, "h w"], taps: Array, levels: int
) -> Float[Array, "h w 3"]:
    """Colours that a tap reads: the pixel's, or those of the block around it that the tap covers.

    Blocks are as large as taps are apart in the pixel's own circle of confusion. What is before the focus and
    what is behind it have blocks of their own.
    """
    height, width = radii.shape
    apart = jnp.abs(radii) * jnp.sqrt(jnp.pi / taps).astype(radii.dtype)
    own = jnp.clip(jnp.log2(jnp.maximum(apart, 1.0)), 0, levels).astype(jnp.int32)
    planes = jnp.moveaxis(image, 2, 0)
    for level in range(1, levels + 1):
        edge = 2**level
        for side in (-radii, radii):
            means = block_means(planes, (side >= edge).astype(planes.dtype), edge)[0]
            wide = jnp.repeat(jnp.repeat(means, edge, axis=1), edge, axis=2)[:, :height, :width]
            planes = jnp.where(((own == level) & (side > 0.0))[None], wide, planes)
    return jnp.moveaxis(planes, 0, 2)


@jit
def _followed(
    shown: Float[Array, "m 7"],
    disparity: Float[Array, "h w"],
    front: Float[Array, "h w"],
    camera: Camera,
    lens: AbstractLens,
    taps: Array,
    pixels: Int[Array, "n"],
) -> Float[Array, "n 7"]:
    """The parts of the light of some pixels, along their lens rays."""
    height, width = disparity.shape
    depths = disparity.ravel()
    film = film_points(pixels, width, disparity.dtype)
    noise, nearest = gradient_noise(film), front.ravel()[pixels]

    def ray_of(point: Array, turn: Array, number: Array) -> tuple[Array, ...]:
        ray = lens.ray(camera, point, lens.pupil_point(tap_sample(number, turn)))
        return *ray.a, *ray.b, ray.weight

    def hit(line: tuple[Array, ...], pixel: Array, start: Array) -> Int[Array, ""]:
        """The pixel of the view that a ray sees."""
        x, y, to_x, to_y = line
        moves = jnp.hypot(to_x, to_y)
        own, w, seen, done = depths[pixel], start, pixel, jnp.array(False)
        for _ in range(_STEPS):
            column = jnp.clip(jnp.floor(x + to_x * w).astype(jnp.int32), 0, width - 1)
            row = jnp.clip(jnp.floor(y + to_y * w).astype(jnp.int32), 0, height - 1)
            place = row * width + column
            depth = depths[place]
            same = jnp.abs(depth - w) * moves <= _SAME
            seen = jnp.where(~done & (same | (depth < w)), place, seen)
            done = done | same
            # The depth of what is seen there is tried next, but none that is behind the pixel's own, untried.
            following = jnp.where(depth < w, jnp.maximum(depth, own), own)
            w = jnp.where(own < w, following, depth)
        return seen

    def add(number: Array, total: tuple[Array, Array]) -> tuple[Array, Array]:
        rays = jax.vmap(ray_of, in_axes=(0, 0, None))(film, noise, number)
        *line, weight = jax.lax.optimization_barrier(rays)
        # Otherwise rays are followed once for each colour.
        seen = jax.lax.optimization_barrier(jax.vmap(hit)(tuple(line), pixels, nearest))
        return total[0] + weight[:, None] * shown[seen], total[1] + weight

    start = (jnp.zeros((*pixels.shape, 7), disparity.dtype), jnp.zeros(pixels.shape, disparity.dtype))
    light, weight = jax.lax.fori_loop(0, taps, add, start)
    empty = weight <= 0.0
    mean = light / jnp.where(empty, 1.0, weight)[:, None]
    return jnp.where(empty[:, None], shown[pixels], mean)
