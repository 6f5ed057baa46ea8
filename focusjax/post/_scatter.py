"""Scatter of what is bright: small lights out of focus spread over the picture of the opening.

A gathering pixel looks at few places of its circle of confusion and meets a small lamp by chance. A lamp's
own pixels are few, and know where their light goes: through every point of the opening to one place on the
film. So what small bright things have beyond white is taken out of the view that is gathered, and sent
there along lens rays, shaped by the opening and all aberrations; none of it is lost or made but for what
leaves the frame, the lens's own loss of light, and what nearer surfaces hide.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.post._gather import STEPS

WHITE = 1.0
_LEAST_REACH = 1.0
"""Pixels of blur's radius below which light stays where it is."""
_LARGEST_SHARE = 0.5
"""Of the square around a circle of confusion: brightness that fills more of it is met by gathering."""
_MOST_RAYS = 8192
_LEAST_ROOM = 256
_ROUNDS = 3
"""Corrections of the place on the film to which a ray goes."""


def small_lights(
    image: Float[np.ndarray, "h w 3"], reach: Float[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels brighter than white and out of focus, of which there are few in the circle of confusion around.

    `reach` is the radius of every pixel's circle of confusion in pixels.
    """
    bright = (image.max(axis=-1) > WHITE) & (reach >= _LEAST_REACH)
    height, width = bright.shape
    total = np.pad(bright.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    row, column = np.nonzero(bright)
    radius = np.ceil(reach[row, column]).astype(int)
    top, left = np.maximum(row - radius, 0), np.maximum(column - radius, 0)
    bottom, right = np.minimum(row + radius + 1, height), np.minimum(column + radius + 1, width)
    count = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
    small = count < _LARGEST_SHARE * (bottom - top) * (right - left)
    found = np.zeros_like(bright)
    found[row[small], column[small]] = True
    return found


def depths_of_light(
    image: Float[np.ndarray, "h w 3"], disparity: Float[np.ndarray, "h w"]
) -> Float[np.ndarray, "h w"]:
    """Disparity of the brightest pixel beside each: a lamp's edge is bright where its middle is wall."""
    height, width = disparity.shape
    light, depth = (np.pad(each, 1, mode="edge") for each in (image.max(axis=-1), disparity))
    around = [slice(k, k + size) for size in (height, width) for k in range(3)]
    rows, columns = around[:3], around[3:]
    values = np.stack([light[row, column] for row in rows for column in columns])
    depths = np.stack([depth[row, column] for row in rows for column in columns])
    return np.take_along_axis(depths, values.argmax(axis=0)[None], axis=0)[0]


def scattered(
    excess: Float[np.ndarray, "h w 3"],
    origin: Float[np.ndarray, "h w"],
    disparity: Float[np.ndarray, "h w"],
    camera: Camera,
    lens: AbstractLens,
    *,
    radius: float,
    taps: int,
) -> Float[Array, "h w 3"]:
    """The light of some pixels where the lens sends it.

    From each go a power of two of rays, 16 to 8192: about `taps` for every pixel of the widest circle of
    confusion, or fewer, so that all together have about `taps` for every pixel of the picture.

    Args:
        excess: light to be sent; 0 in all other pixels.
        origin: disparity in 1/m of what the light is from.
        disparity: 1/m at pixel centres, of what may hide it.
        camera: the frame.
        lens: where rays go.
        radius: of the widest circle of confusion of a pixel that sends light, in pixels.
        taps: places that each pixel looks at where light is gathered.
    """
    row, column = np.nonzero(excess.max(axis=-1) > 0)
    if not row.size:
        return jnp.zeros(excess.shape)
    rays = taps * max(1.0, min(math.pi * radius**2, excess[..., 0].size / row.size))
    each = 1 << round(np.clip(math.log2(rays), 4, math.log2(_MOST_RAYS)))
    # Few lengths, so that few programs are compiled.
    room = max(_LEAST_ROOM, 1 << (row.size - 1).bit_length())
    row, column = (np.pad(axis, (0, room - axis.size), mode="edge") for axis in (row, column))
    light = excess[row, column]
    light[np.count_nonzero(excess.max(axis=-1) > 0) :] = 0.0
    from scipy.stats import qmc

    square = qmc.Sobol(2, rng=np.random.default_rng(0)).random(each)
    real = jnp.zeros(()).dtype
    return _sent(
        jnp.asarray(light / each, real),
        jnp.asarray(row),
        jnp.asarray(column),
        jnp.asarray(origin[row, column], real),
        jnp.asarray(disparity, real),
        jnp.asarray(square, real),
        camera,
        lens,
    )


@jit
def _sent(
    light: Float[Array, "n 3"],
    row: Int[Array, "n"],
    column: Int[Array, "n"],
    depth: Float[Array, "n"],
    disparity: Float[Array, "h w"],
    square: Float[Array, "s 2"],
    camera: Camera,
    lens: AbstractLens,
) -> Float[Array, "h w 3"]:
    height, width = disparity.shape
    here = jnp.stack([column, row], axis=1).astype(disparity.dtype) + 0.5
    # Patterns of neighbours are shifted against each other, and light is spread over the pixel it is from.
    number = jnp.arange(row.size, dtype=disparity.dtype)[:, None]
    turn = number * jnp.asarray([STEPS], disparity.dtype)

    def one(
        start: Float[Array, "2"], w: Float[Array, ""], sample: Float[Array, "2"], inside: Float[Array, "2"]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        """Where on the film the ray arrives that leaves from a place, and its weight."""
        pupil, goal = lens.pupil_point(sample), start + inside - 0.5

        def closer(film: Float[Array, "2"]) -> Float[Array, "2"]:
            ray = lens.ray(camera, film, pupil)
            return film - (ray.a + ray.b * w - goal)

        film = goal
        for _ in range(_ROUNDS):
            film = closer(film)
        return film, lens.ray(camera, film, pupil).weight

    def add(picture: Float[Array, "p 3"], point: tuple[Array, Array]) -> tuple[Array, None]:
        sample, other = point
        film, weight = jax.vmap(one)(
            here, depth, jnp.mod(sample[None] + turn, 1.0), jnp.mod(other[None] + turn[:, ::-1], 1.0)
        )
        x, y = jnp.floor(film).astype(jnp.int32).T
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        place = jnp.where(inside, y * width + x, 0)
        # What is nearer hides it.
        seen = inside & (disparity.ravel()[place] <= depth * (1.0 + 1e-3) + 1e-6)
        carried = jnp.where(seen, weight, 0.0)[:, None] * light
        return picture.at[place].add(carried), None

    nothing = jnp.zeros((height * width, 3), light.dtype)
    picture, _ = jax.lax.scan(add, nothing, (square, jnp.roll(square, 1, axis=0)[:, ::-1]))
    return picture.reshape(height, width, 3)
