"""The picture from a few rays per pixel, each class of blur smoothed as far as its blur allows.

What is blurred over a radius c has no detail much finer than c, but the rays of each pixel have their own
noise. So the rays of a pixel are kept apart by how blurred what they meet is, and those of one class are
averaged with those of pixels around, by weights that leave every quadratic polynomial as it is over a few
tenths of c. What is in focus is not touched. (Soler et al. 2009 tell the bandwidth of a defocused light
field; Vaidyanathan et al. 2015, Layered Light Field Reconstruction for Defocus Blur, filter by layers.)

Classes go from near to far, k = 0, 1, .... Of a pixel's rays let n_k be the light of those that end in class
k, L_k what they bring, and m_k = n_k + n_(k+1) + ... the light that passes all nearer classes. With S_k the
smoothing of class k, both the share that it stops and what it brings are ratios,

    a_k = S_k n_k / S_k m_k,        l_k = S_k L_k / S_k m_k,

and the picture per light is composed from front to back,

    I = sum_k T_k l_k,        T_k = (1 - a_0) ... (1 - a_(k-1)).

Without smoothing all of that cancels to sum_k L_k / m_0, the plain mean; how much light there is does not
matter. A pixel of which no ray passes the
nearer classes, although T_k says that some light does, borrows from around: tents a few pixels wide are added
with small weights. Radiances are at most 1 here, and so is what is made of them; but for that, and for
weights below 0 that nothing is made darker than black by, all is linear in them.

Where something less blurred cuts off part of the opening, what is behind it does change faster than its own
blur says, within the blur of the edge; and the pixels of the border are left to their own rays.

The more rays, the less is smoothed: noise falls as rays^-1 or faster and the bias as a power of the width
above three, so that widths go as rays^-0.3 and the error of the picture still falls to that of the rays.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.sparse import csr_array

from focusjax._parallel import in_parallel

_WIDTH, _FALL = 1.6, 0.3
"""Half the width of a kernel is this times rays^-0.3 times the blur's radius, at most that radius."""
_GAUSSIAN = 1.7
"""Standard deviations of the weights of the fit in half the width of a kernel."""
_REACHES = (1, 2, 4, 6, 8, 12, 16, 24, 32)
"""Of kernels, few enough for their programs to serve again."""
_BORROWED = ((2, 1e-3), (8, 1e-5))
"""Half the widths of tents in pixels, and what they count where there is no light."""
_MOST_TIMES = 4.0
"""What weights below 0 make of next to no light is taken no more often than that."""
_ROWS = 64
"""Of the picture, worked out together."""


def reconstruct(
    sums: csr_array, width: int, least: tuple[float, ...], rays: float
) -> Float[np.ndarray, "p 3"]:
    """Radiance per light in each pixel; 0 where there is none.

    Args:
        sums: mean [p, k c] over the rays of each pixel, row-major, and for one class after the other from
            near to far, of weight times radiance, at most 1, in red, green and blue, and of weight, once or
            in each colour.
        width: pixels per row.
        least: least radius of blur in each class, in pixels.
        rays: per pixel on the average.
    """
    height = sums.shape[0] // width  # pyright: ignore[reportOptionalSubscript]
    kernels = tuple(_kernel(_half_width(blur, rays)) for blur in least)
    halo = max([len(kernel) // 2 for kernel in kernels] + [reach for reach, _ in _BORROWED])
    rows = min(_ROWS, height)
    taps = tuple(jnp.asarray(kernel, dtype=sums.dtype) for kernel in kernels)
    tents = tuple(jnp.asarray(_tent(reach), dtype=sums.dtype) for reach, _ in _BORROWED)
    starts = [min(start, height - rows) for start in range(0, height, rows)]

    def strip(start: int) -> Float[np.ndarray, "r w 3"]:
        first, last = start - halo, start + rows + halo
        beyond = max(-first, 0), max(last - height, 0)
        inside = np.asarray(sums[max(first, 0) * width : min(last, height) * width].toarray())
        told = inside.reshape(-1, width, len(least), inside.shape[1] // len(least))
        smooth, planes = [], None
        for number in reversed(range(len(least))):
            own = taps[number]
            planes = _planes(_with_halo(told[:, :, number], beyond, halo), planes)
            found = _smoothed(planes, own, halo=halo)
            if len(own) == 1:
                for (_, count), tent in zip(_BORROWED, tents, strict=True):
                    found += count * _smoothed(planes, tent, halo=halo)
            # Else all classes would wait side by side.
            smooth.append(jax.block_until_ready(found))
        most = tuple(math.inf if len(own) == 1 else _MOST_TIMES for own in taps)
        assert planes is not None
        return np.asarray(_composed(smooth[::-1], planes[:, halo:-halo, halo:-halo], most))

    out = np.empty((height, width, 3), dtype=sums.dtype)
    for start, found in zip(starts, in_parallel(strip, starts), strict=True):
        out[start : start + rows] = found
    return out.reshape(-1, 3)


def _half_width(blur: float, rays: float) -> float:
    return blur * min(_WIDTH * rays**-_FALL, 1.0)


@functools.lru_cache(maxsize=64)
def _kernel(half_width: float) -> Float[np.ndarray, " n"]:
    """Weights at whole pixels about 0 that fit a quadratic polynomial, and tell its value at 0.

    The fit is weighted by a Gaussian (Savitzky and Golay 1964). One of less than a pixel leaves all as it is.
    """
    if half_width < 1.0:
        return np.ones(1)
    reach = next(reach for reach in _REACHES if reach >= half_width)
    x = np.arange(-reach, reach + 1)
    root = np.exp(-0.25 * (_GAUSSIAN * x / half_width) ** 2)
    powers = np.stack([np.ones_like(root), x, x**2], axis=1) * root[:, None]
    return np.linalg.pinv(powers)[0] * root


def _tent(reach: int) -> Float[np.ndarray, " n"]:
    weights = reach + 1.0 - np.abs(np.arange(-reach, reach + 1))
    return weights / weights.sum()


def _with_halo(
    inside: Float[np.ndarray, "h w c"], beyond: tuple[int, int], halo: int
) -> Float[np.ndarray, "r v c"]:
    """Some rows with `beyond` above and below the picture, and a halo on either side of it.

    There it goes on mirrored in the points of its border. That leaves ramps as they are, and the border
    itself to its own rays.
    """
    return np.pad(inside, (beyond, (halo, halo), (0, 0)), mode="reflect", reflect_type="odd")


# Three programs instead of one, in which XLA for CPU would work out much of each step anew for the next.


@jax.jit
def _planes(around: Float[Array, "r w n"], farther: Float[Array, "c r w"] | None) -> Float[Array, "c r w"]:
    """What a class brings in red, green and blue, its light, and what passes all nearer ones.

    The last is its own light and what passes it, of which the planes of the next `farther` class tell.
    """
    told = jnp.moveaxis(around, -1, 0)
    light = told[3:]
    return jnp.concatenate([told, light if farther is None else light + farther[len(told) :]])


@functools.partial(jax.jit, static_argnames="most_times")
def _composed(
    smooth: list[Float[Array, "c r w"]], nearest: Float[Array, "c r w"], most_times: tuple[float, ...]
) -> Float[Array, "r w 3"]:
    """Radiance per light, of smoothed planes, each taken so many times at most, and the nearest as it was."""
    lights = (smooth[0].shape[0] - 3) // 2
    picture = jnp.zeros_like(smooth[0][:3])
    # Of the light that there is: lenses may let pass next to none.
    through = jnp.maximum(nearest, smooth[0])[3 + lights :]
    told = jnp.zeros_like(through)
    for found, most in zip(smooth, most_times, strict=True):
        stopped, light = found[3 : 3 + lights], found[3 + lights :]
        # Nothing is brighter than white.
        brought = jnp.minimum(found[:3], stopped)
        # How much light passes is told twice, by this class's kernel and by those of nearer ones. No more is
        # stopped than that, although with weights below 0 it may seem so.
        least = jnp.maximum(light, stopped)
        times = jnp.minimum(jnp.where(least > 0, through / jnp.where(least > 0, least, 1.0), 0.0), most)
        picture += times * brought
        told += times * stopped
        through -= times * stopped
    return jnp.moveaxis(jnp.where(told > 0, picture / jnp.where(told > 0, told, 1.0), 0.0), 0, -1)


@functools.partial(jax.jit, static_argnames="halo")
def _smoothed(planes: Float[Array, "c r w"], taps: Float[Array, " n"], *, halo: int) -> Float[Array, "c q v"]:
    """The planes without their halo, averaged along both axes; what weights below 0 leave below 0 is 0."""
    reach = taps.shape[0] // 2
    for axis in (1, 0):

        def along(plane: Float[Array, "r w"], axis: int = axis) -> Float[Array, "q v"]:
            first, size = halo - reach, plane.shape[axis] - 2 * halo

            def at(step: int) -> Float[Array, "q v"]:
                start = first + reach + step
                return jax.lax.slice_in_dim(plane, start, start + size, axis=axis)

            total = taps[reach] * at(0)
            for step in range(1, reach + 1):
                total += taps[reach + step] * (at(step) + at(-step))
            return total

        # A loop, as XLA for CPU would work out the first axis anew for each place along the second.
        planes = jax.lax.map(along, planes)
    return jnp.maximum(planes, 0.0)
