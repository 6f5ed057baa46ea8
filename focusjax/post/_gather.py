"""Gather: every pixel averages one sharp view over its own circle of confusion.

Where taps are far apart, each stands for the block of pixels around it, as a cone does for the rays between
it and the next (Lee09 sections 4.3 and 4.4). Levels of mip maps hold colour, depth and blur of blocks, and
in level l only pixels whose own blur reaches 2^l pixels or farther count: what is sharper than the block
keeps out of its mean, and is read as it is where a tap meets it.
"""

import functools
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._checked_view import checked_view
from focusjax._counts import require_counts
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

# Steps of Roberts' sequence in two dimensions, and of Jimenez' gradient noise between pixels.
STEPS = (0.7548776662466927, 0.5698402909980532)
_NOISE = (0.06711056, 0.00583715, 52.9829189)
_MOST_LEVELS = 5
"""Of mip maps, beyond the pixels themselves: blocks of 32 x 32."""
_CHUNKS = 8
_LEAST_CHUNK = 4096


def gather(
    image: Float[Array | np.ndarray, "_ _ 3"],
    disparity: Float[Array | np.ndarray, "_ _"],
    camera: Camera,
    lens: AbstractLens,
    *,
    taps: int = 64,
    levels: int | None = None,
    wanted: Bool[Array | np.ndarray, "_ _"] | None = None,
) -> Float[Array, "h w 3"]:
    """One sharp view, filtered at each pixel over the circle of confusion that its depth has.

    The classic post-process (Potmesil and Chakravarty 1981 turned round; Scheuermann and Tatarchuk 2004): a
    pixel looks where its lens rays pass at its own disparity. What lies there in front of it counts only as
    far as its own blur reaches back, which keeps sharp foregrounds from leaking into a blurred background.
    A blurred foreground still ends where its sharp view ends, and hides what the lens would see past it;
    `focusjax.post.post_process` mends that.

    Beyond the frame the view goes on as at its edge.

    Args:
        image: linear radiance of the sharp view.
        disparity: 1/m at its pixel centres; 0 is infinitely far.
        camera: the frame.
        lens: where rays go; its opening shapes the filter.
        taps: places to look at per pixel.
        levels: of mip maps, at most 5; as many as the widest circle needs if None. With a number of its own a
            lens that moves compiles nothing anew.
        wanted: pixels to filter; the others stay sharp. All if None.

    Raises:
        ValueError: sizes that differ from the camera's, values that are not finite, negative disparity,
            fewer than one tap, or a number of levels that is none.

    Example:
        >>> from focusjax.post import gather
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> picture, disparity = np.full((6, 8, 3), 0.5), np.full((6, 8), 0.25)
        >>> gather(picture, disparity, camera, lens, taps=16).round(6)[3, 4].tolist()
        [0.5, 0.5, 0.5]
    """
    require_counts(taps=taps)
    picture, depth = checked_view(np.asarray(image), np.asarray(disparity), camera)
    real = jnp.zeros(()).dtype
    depths = jnp.asarray(depth, real)
    reaches = circle_radii(depths, camera, lens)
    if levels is None:
        levels = most_levels(float(reaches.max()), taps)
    elif levels not in range(_MOST_LEVELS + 1):
        raise ValueError(f"levels is {levels!r}; expected a whole number from 0 to {_MOST_LEVELS}, or None")
    sharp = jnp.asarray(picture, real)
    maps = _mip_maps(sharp, depths, reaches, levels)
    through = functools.partial(_gathered, maps, depths, camera, lens, jnp.asarray(taps), levels)
    return in_chunks(through, sharp, wanted)


def most_levels(radius: float, taps: int) -> int:
    """Levels of mip maps for a widest `radius` of confusion in pixels, by how far apart its taps lie."""
    apart = radius * math.sqrt(math.pi / taps)
    return min(int(math.log2(max(apart, 1.0))), _MOST_LEVELS)


def in_chunks(
    seen: Callable[[Int[Array, "n"]], Float[Array, "n c"]],
    image: Float[Array, "h w c"],
    wanted: Bool[Array | np.ndarray, "h w"] | None,
) -> Float[Array, "h w c"]:
    """`image` with the `wanted` pixels replaced, a fixed number at a time, so that one program does for all.

    Without `wanted`, all are replaced at once. `seen` has colours of pixels by their numbers, row by row.
    """
    flat = image.reshape(-1, image.shape[2])
    if wanted is None:
        return seen(jnp.arange(len(flat), dtype=jnp.int32)).reshape(image.shape)
    chosen = np.flatnonzero(np.asarray(wanted))
    if not chosen.size:
        return image
    size = min(len(flat), max(_LEAST_CHUNK, -(-len(flat) // _CHUNKS)))
    # The last chunk is filled up with a pixel that it has.
    numbers = np.pad(chosen, (0, -chosen.size % size), mode="edge").astype(np.int32)
    found = jnp.concatenate([seen(jnp.asarray(chunk)) for chunk in numbers.reshape(-1, size)])
    return flat.at[numbers].set(found).reshape(image.shape)


@jit
def circle_radii(disparity: Float[Array, "h w"], camera: Camera, lens: AbstractLens) -> Float[Array, "h w"]:
    """Radius of every pixel's circle of confusion in pixels."""
    return jnp.abs(signed_radii(disparity, camera, lens))


@jit
def signed_radii(disparity: Float[Array, "h w"], camera: Camera, lens: AbstractLens) -> Float[Array, "h w"]:
    """The same, negative before the focus."""
    film = film_points(jnp.arange(disparity.size), disparity.shape[1], disparity.dtype)
    radius = jax.vmap(lambda point, w: lens.blur(camera, point, w) / 2.0)
    return radius(film, disparity.ravel()).reshape(disparity.shape)


def film_points(pixels: Int[Array, "n"], width: int, dtype: jnp.dtype) -> Float[Array, "n 2"]:
    """Centres of pixels by their numbers, row by row."""
    row, column = jnp.divmod(pixels, width)
    return jnp.stack([column, row], axis=1).astype(dtype) + 0.5


def gradient_noise(film: Float[Array, "n 2"]) -> Float[Array, "n"]:
    """A number from 0 to 1 for each pixel by which its taps are turned against its neighbours'."""
    return jnp.mod(_NOISE[2] * jnp.mod(film @ jnp.asarray(_NOISE[:2], film.dtype), 1.0), 1.0)


def tap_sample(number: Array, turn: Float[Array, ""]) -> Float[Array, "2"]:
    """The point of the unit square that a tap of a pixel looks through."""
    # A step of the turn in both coordinates makes the patterns of neighbours differ.
    shift = turn * jnp.asarray([1.0, 7.0], turn.dtype)
    return jnp.mod((number + 0.5) * jnp.asarray(STEPS, turn.dtype) + shift, 1.0).astype(turn.dtype)


@jit
def _mip_maps(
    image: Float[Array, "h w 3"], disparity: Float[Array, "h w"], reaches: Float[Array, "h w"], levels: int
) -> Float[Array, "m 5"]:
    """Colour, disparity and reach of pixels and then of blocks, level by level."""
    fine = jnp.concatenate([jnp.moveaxis(image, 2, 0), disparity[None], reaches[None]])
    maps = [fine]
    for edge in (2**level for level in range(1, levels + 1)):
        maps.append(block_means(fine, (reaches >= edge).astype(fine.dtype), edge)[0])
    return jnp.concatenate([each.reshape(len(fine), -1).T for each in maps])


@jit
def _gathered(
    maps: Float[Array, "m 5"],
    disparity: Float[Array, "h w"],
    camera: Camera,
    lens: AbstractLens,
    taps: Array,
    levels: int,
    pixels: Int[Array, "n"],
) -> Float[Array, "n 3"]:
    height, width = disparity.shape
    sharpness = maps[: height * width, 4]
    film = film_points(pixels, width, disparity.dtype)
    noise = gradient_noise(film)
    apart = sharpness[pixels] * jnp.sqrt(jnp.pi / taps).astype(sharpness.dtype)
    own = jnp.clip(jnp.log2(jnp.maximum(apart, 1.0)), 0, levels).astype(jnp.int32)
    sizes = [(-(-height // edge), -(-width // edge)) for edge in (2**level for level in range(levels + 1))]
    starts = jnp.asarray(np.cumsum([0, *(rows * columns for rows, columns in sizes[:-1])]), jnp.int32)
    widths = jnp.asarray([columns for _, columns in sizes], jnp.int32)

    def read(column: Array, row: Array, level: Array) -> tuple[Array, Array, Array]:
        """Colour, disparity and reach of a pixel, or of the block of a level around it."""
        index = row * width + column
        if levels:
            block = starts[level] + (row >> level) * widths[level] + (column >> level)
            index = jnp.where(sharpness[index] >= (1 << level), block, index)
        found = maps[index]
        return found[:3], found[3], found[4]

    def one(point: Array, w: Array, turn: Array, level: Array, number: Array) -> tuple[Array, Array]:
        ray = lens.ray(camera, point, lens.pupil_point(tap_sample(number, turn)))
        place = ray.a + ray.b * w
        column, row = jnp.floor(place).astype(jnp.int32)
        colour, depth, reach = read(jnp.clip(column, 0, width - 1), jnp.clip(row, 0, height - 1), level)
        covers = jnp.clip(reach + 1.0 - jnp.linalg.norm(place - point), 0.0, 1.0)
        # A block's depth is a mean, rounded.
        weight = ray.weight * jnp.where(depth > w * (1.0 + 1e-6), covers, 1.0)
        return weight * colour, weight

    def add(number: Array, total: tuple[Array, Array]) -> tuple[Array, Array]:
        over = jax.vmap(one, in_axes=(0, 0, 0, 0, None))
        light, weight = over(film, depths, noise, own, number)
        return total[0] + light, total[1] + weight

    depths = disparity.ravel()[pixels]
    start = (jnp.zeros((*pixels.shape, 3), film.dtype), jnp.zeros(pixels.shape, film.dtype))
    light, weight = jax.lax.fori_loop(0, taps, add, start)
    # All taps of a pixel can lie on sharp things in front of it; it then keeps its own colour.
    empty = weight <= 0.0
    mean = light / jnp.where(empty, 1.0, weight)[:, None]
    return jnp.where(empty[:, None], maps[pixels, :3], mean)


def block_means(
    planes: Float[Array, "c h w"], coverage: Float[Array, "h w"], edge: int
) -> tuple[Float[Array, "c m n"], Float[Array, "m n"]]:
    """Means of `planes` over blocks of `edge` x `edge` pixels, weighted by `coverage`, and its own means.

    What is not covered leaves no trace, so that colours of other surfaces do not bleed into a block. Blocks
    that stick out of the picture are means of what is inside. Where nothing is covered the means are 0.
    Values of planes are not multiplied by coverage, which is from 0 to 1.
    """
    inside = _block_sums(jnp.ones_like(coverage)[None], edge)[0]
    covered = _block_sums(coverage[None], edge)[0]
    total = _block_sums(planes * coverage[None], edge)
    return total / jnp.where(covered > 0.0, covered, 1.0)[None], covered / inside


def _block_sums(planes: Float[Array, "c h w"], edge: int) -> Float[Array, "c m n"]:
    count, height, width = planes.shape
    padded = jnp.pad(planes, ((0, 0), (0, -height % edge), (0, -width % edge)))
    rows, columns = padded.shape[1] // edge, padded.shape[2] // edge
    return padded.reshape(count, rows, edge, columns, edge).sum(axis=(2, 4))
