"""Gather: every pixel averages one sharp view over its own circle of confusion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._counts import require_counts
from focusjax.baselines._view import checked_view
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

# Steps of Roberts' sequence in two dimensions, and of Jimenez' gradient noise between pixels.
_STEPS = (0.7548776662466927, 0.5698402909980532)
_NOISE = (0.06711056, 0.00583715, 52.9829189)


def gather(
    image: Float[Array | np.ndarray, "_ _ 3"],
    disparity: Float[Array | np.ndarray, "_ _"],
    camera: Camera,
    lens: AbstractLens,
    *,
    taps: int = 64,
) -> Float[Array, "h w 3"]:
    """One sharp view, filtered at each pixel over the circle of confusion that its depth has.

    The classic post-process (Potmesil and Chakravarty 1981 turned round; Scheuermann and Tatarchuk 2004): a
    pixel looks where its lens rays pass at its own disparity. What lies there in front of it counts only as
    far as its own blur reaches back, which keeps sharp foregrounds from leaking into a blurred background.
    A blurred foreground still ends where its sharp view ends, and hides what the lens would see past it.

    Beyond the frame the view goes on as at its edge.

    Args:
        image: linear radiance of the sharp view.
        disparity: 1/m at its pixel centres; 0 is infinitely far.
        camera: the frame.
        lens: where rays go; its opening shapes the filter.
        taps: places to look at per pixel.

    Raises:
        ValueError: sizes that differ from the camera's, values that are not finite, negative disparity, or
            fewer than one tap.

    Example:
        >>> image, disparity = pinhole_view(scene, camera)  # doctest: +SKIP
        >>> soft = gather(image, disparity, camera, lens, taps=64)  # doctest: +SKIP
    """
    require_counts(taps=taps)
    picture, depth = checked_view(np.asarray(image), np.asarray(disparity), camera)
    real = jnp.zeros(()).dtype
    return _gathered(jnp.asarray(picture, real), jnp.asarray(depth, real), camera, lens, jnp.asarray(taps))


@eqx.filter_jit
def _gathered(
    image: Float[Array, "h w 3"],
    disparity: Float[Array, "h w"],
    camera: Camera,
    lens: AbstractLens,
    taps: Array,
) -> Float[Array, "h w 3"]:
    height, width = disparity.shape
    planes = [image[..., channel].ravel() for channel in range(3)]
    depths = disparity.ravel()
    y, x = jnp.divmod(jnp.arange(height * width), width)
    film = jnp.stack([x, y], axis=1).astype(depths.dtype) + 0.5
    noise = jnp.mod(_NOISE[2] * jnp.mod(film @ jnp.asarray(_NOISE[:2], film.dtype), 1.0), 1.0)
    reaches = jax.vmap(lambda point, w: jnp.abs(lens.blur(camera, point, w)) / 2)(film, depths)

    def one(point: Array, w: Array, turn: Array, number: Array) -> tuple[Array, Array]:
        # A step of the turn in both coordinates tells the patterns of neighbours apart.
        sample = jnp.mod((number + 0.5) * jnp.asarray(_STEPS, w.dtype) + turn * jnp.asarray([1.0, 7.0]), 1.0)
        ray = lens.ray(camera, point, lens.pupil_point(sample.astype(w.dtype)))
        place = ray.a + ray.b * w
        column, row = jnp.floor(place).astype(int)
        index = jnp.clip(row, 0, height - 1) * width + jnp.clip(column, 0, width - 1)
        colour = jnp.stack([plane[index] for plane in planes])
        covers = jnp.clip(reaches[index] + 1.0 - jnp.linalg.norm(place - point), 0.0, 1.0)
        weight = ray.weight * jnp.where(depths[index] > w, covers, 1.0)
        return weight * colour, weight

    def add(number: Array, total: tuple[Array, Array]) -> tuple[Array, Array]:
        light, weight = jax.vmap(one, in_axes=(0, 0, 0, None))(film, depths, noise, number)
        return total[0] + light, total[1] + weight

    start = (jnp.zeros((height * width, 3), image.dtype), jnp.zeros(height * width, image.dtype))
    light, weight = jax.lax.fori_loop(0, taps, add, start)
    # All taps of a pixel can lie on sharp things in front of it; it then keeps its own colour.
    empty = weight <= 0.0
    mean = light / jnp.where(empty, 1.0, weight)[:, None]
    return jnp.where(empty[:, None], image.reshape(-1, 3), mean).reshape(height, width, 3)
