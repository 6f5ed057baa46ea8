"""The picture from a few rays per pixel, each circle-of-confusion bin smoothed as far as its blur allows.

What is blurred over a radius c has no detail much finer than c, but the rays of each pixel have their own
noise. So the rays of a pixel are kept apart by how blurred what they meet is, and those of one bin are
averaged with those of pixels around, by weights that leave every quadratic polynomial as it is over a few
tenths of c. What is in focus is not touched. (Soler et al. 2009 give the bandwidth of a defocused light
field; Vaidyanathan et al. 2015, Layered Light Field Reconstruction for Defocus Blur, filter by layers.)

Bins go from near to far, k = 0, 1, .... Of a pixel's rays let n_k be the light of those that end in bin k,
L_k the radiance they carry, and m_k = n_k + n_(k+1) + ... the light that passes all nearer bins. With S_k the
smoothing of bin k, both the share that it stops and the radiance that it adds are ratios,

    a_k = S_k n_k / S_k m_k,        l_k = S_k L_k / S_k m_k,

and the picture per light is composed from front to back,

    I = sum_k T_k l_k,        T_k = (1 - a_0) ... (1 - a_(k-1)).

Without smoothing all of that cancels to sum_k L_k / m_0, the plain mean; how much light there is does not
matter. A pixel of which no ray passes the nearer bins, although T_k says that some light does, borrows from
around: tents a few pixels wide count there, with small weights. Radiances are at most 1 here, and so is what
is made of them; but for that, and for weights below 0 that nothing is made darker than black by, all is
linear in them.

Where something less blurred cuts off part of the aperture, what is behind it does change faster than its own
blur says, within the blur of the edge; and the pixels of the border are left to their own rays.

The more rays, the less is smoothed: noise falls as rays^-1 or faster and the bias as a power of the width
above three, so that widths go as rays^-0.3 and the error of the picture still falls to that of the rays.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._at_once import one_by_one
from focusjax.trace._accumulate import PixelSums

_WIDTH, _FALL = 1.6, 0.3
"""Half the width of a kernel is this times rays^-0.3 times the blur's radius, at most that radius."""
_GAUSSIAN = 1.7
"""Standard deviations of the weights of the fit in half the width of a kernel."""
_BORROWED = ((2, 1e-3), (8, 1e-5))
"""Half the widths of tents in pixels, and what they count where there is no light."""
_MOST_TIMES = 4.0
"""What weights below 0 make of next to no light is taken no more often than that."""
_State = tuple[Float[Array, "3 h w"], Float[Array, "l h w"], Float[Array, "l h w"]]
"""Of the bins so far: radiance, the light that they stopped, and the light that passes them."""


def denoised(
    sums: PixelSums, width: int, least: tuple[float, ...], rays: float | Array
) -> Float[Array, "p 3"]:
    """Radiance per light in each pixel, up to white; 0 where there is none.

    Args:
        sums: of all rays of the picture.
        width: pixels per row.
        least: least radius of blur in each bin, in pixels.
        rays: per pixel on the average; where traced, kernels are as long as for the fewest rays.
    """
    pixels, lights = sums.binned.shape[1], sums.binned.shape[2] - 3
    shape = pixels // width, width

    def as_planes(values: Float[Array, "p c"]) -> Float[Array, "c h w"]:
        return values.T.reshape(-1, *shape)

    kernels = [_kernel_for(blur, rays) for blur in least]
    # Each is compiled once, whichever bins it is for.
    kinds = {0.0: functools.partial(_borrowing, lights=lights)}
    kinds |= {
        blur: functools.partial(_smoothed, taps=taps)
        for blur, taps in zip(least, kernels, strict=True)
        if len(taps) > 1
    }
    numbers = [list(kinds).index(blur if blur in kinds else 0.0) for blur in least]
    kind = jnp.asarray(numbers, dtype=jnp.int32)
    most = jnp.asarray([_MOST_TIMES if number else math.inf for number in numbers], dtype=sums.binned.dtype)

    def compose(
        state: _State, of_bin: Float[Array, "c h w"], kind: Int[Array, ""], most: Float[Array, ""]
    ) -> _State:
        picture, arrived, through = state
        found = jax.lax.switch(kind, list(kinds.values()), of_bin)
        stopped, lit = found[3 : 3 + lights], found[3 + lights :]
        # Of the light that there is: lenses may let pass next to none.
        through = jnp.where(arrived > 0, through, jnp.maximum(through, lit))
        # Nothing is brighter than white. At white the derivative is that of what is seen, which has been
        # halved once already, where rays were summed.
        added = jnp.where(found[:3] > stopped, stopped, found[:3])
        # How much light passes is known twice, by this bin's kernel and by those of nearer ones. No more
        # is stopped than that, although with weights below 0 it may seem so.
        least = jnp.maximum(lit, stopped)
        times = jnp.where(least > 0, through / jnp.where(least > 0, least, 1.0), 0.0)
        times = jnp.minimum(times, most)
        left = jnp.maximum(through - times * stopped, 0.0)
        return picture + times * added, arrived + times * stopped, left

    def advance(state: _State, of_bin: tuple[Array, ...]) -> tuple[_State, None]:
        binned, passing, kind, most = of_bin

        def with_bin(state: _State) -> _State:
            return compose(state, jnp.concatenate([as_planes(binned), as_planes(passing)]), kind, most)

        return jax.lax.cond(binned[:, 3:].max() > 0, with_bin, lambda state: state, state), None

    def pass_on(light: Float[Array, "p l"], of_bin: Float[Array, "p l"]) -> tuple[Array, Array]:
        return light + of_bin, light + of_bin

    light = sums.binned[..., 3:]
    through, passing = jax.lax.scan(pass_on, jnp.zeros_like(light[0]), light, reverse=True)
    dark = jnp.zeros((3 + lights, *shape), dtype=sums.binned.dtype)
    start = dark[:3], dark[3:], as_planes(through)
    (picture, arrived, _), _ = jax.lax.scan(advance, start, (sums.binned, passing, kind, most))
    lit = arrived > 0
    picture = jnp.where(lit, picture / jnp.where(lit, arrived, 1.0), 0.0)
    return jnp.moveaxis(picture, 0, -1).reshape(-1, 3)


def taken_in(least: tuple[float, ...], rays: int) -> int:
    """How many pixels away what counts for a pixel is at most; arguments as for `denoised`."""
    if len(least) == 1:
        return 0
    kernels = [len(_kernel_for(blur, rays)) // 2 for blur in least]
    return max(*kernels, *(reach for reach, _ in _BORROWED))


def _kernel_for(blur: float, rays: float | Array) -> Float[np.ndarray, " n"] | Float[Array, " n"]:
    """Weights for what is blurred over a radius in pixels."""
    if not isinstance(rays, Array):
        return _kernel(min(_WIDTH * rays**-_FALL, 1.0) * blur)
    if blur < 1.0:
        return np.ones(1)
    # The same fit, in closed form.
    half_width = jnp.minimum(_WIDTH * rays.astype(jnp.zeros(()).dtype) ** -_FALL, 1.0) * blur
    reach = math.ceil(blur)
    x = jnp.arange(-reach, reach + 1, dtype=half_width.dtype)
    weights = jnp.where(
        jnp.abs(x) <= jnp.ceil(half_width), jnp.exp(-0.5 * (_GAUSSIAN * x / half_width) ** 2), 0
    )
    zeroth, second, fourth = ((weights * x**power).sum() for power in (0, 2, 4))
    fit = weights * (fourth - second * x**2) / jnp.maximum(zeroth * fourth - second**2, 1e-30)
    return jnp.where(half_width < 1.0, (x == 0).astype(fit.dtype), fit)


def _borrowing(planes: Float[Array, "c h w"], lights: int) -> Float[Array, "c h w"]:
    """The planes as they are, but for pixels without any light, which have a little of that around."""
    through = planes[3 + lights :].sum(axis=0)
    dark = through == 0

    def borrow(planes: Float[Array, "c h w"]) -> Float[Array, "c h w"]:
        around = [count * _smoothed(planes, _tent(reach)) for reach, count in _BORROWED]
        return jnp.where(dark[None], functools.reduce(jnp.add, around), planes)

    return jax.lax.cond(through.min() == 0, borrow, lambda planes: planes, planes)


@functools.lru_cache(maxsize=64)
def _kernel(half_width: float) -> Float[np.ndarray, " n"]:
    """Weights at whole pixels about 0 that fit a quadratic polynomial, and give its value at 0.

    The fit is weighted by a Gaussian (Savitzky and Golay 1964). One of less than a pixel leaves all as it is.
    """
    if half_width < 1.0:
        return np.ones(1)
    reach = math.ceil(half_width)
    x = np.arange(-reach, reach + 1)
    root = np.exp(-0.25 * (_GAUSSIAN * x / half_width) ** 2)
    powers = np.stack([np.ones_like(root), x, x**2], axis=1) * root[:, None]
    return np.linalg.pinv(powers)[0] * root


def _tent(reach: int) -> Float[np.ndarray, " n"]:
    weights = reach + 1.0 - np.abs(np.arange(-reach, reach + 1))
    return weights / weights.sum()


def _smoothed(
    planes: Float[Array, "c h w"], taps: Float[np.ndarray, " n"] | Float[Array, " n"]
) -> Float[Array, "c h w"]:
    """The planes averaged along both axes; what weights below 0 leave below 0 is 0.

    Beyond the picture it goes on mirrored in the points of its border. That leaves ramps as they are, and the
    border itself to its own rays.
    """
    reach = len(taps) // 2

    def tap(step: int) -> float | Array:
        return taps[reach + step] if isinstance(taps, Array) else float(taps[reach + step])

    def along(plane: Float[Array, "v w"], axis: int) -> Float[Array, "v w"]:
        size = plane.shape[axis]
        around = [(reach, reach) if each == axis else (0, 0) for each in (0, 1)]
        plane = jnp.pad(plane, around, mode="reflect", reflect_type="odd")

        def at(step: int) -> Float[Array, "v w"]:
            return jax.lax.slice_in_dim(plane, reach + step, reach + step + size, axis=axis)

        total = tap(0) * at(0)
        for step in range(1, reach + 1):
            total += tap(step) * (at(step) + at(-step))
        return total

    def both(plane: Float[Array, "v w"]) -> Float[Array, "v w"]:
        # XLA for CPU would work out the first axis anew for each place along the second.
        down = jax.lax.optimization_barrier(along(plane, 0))
        return jnp.maximum(along(down, 1), 0.0)

    return one_by_one(both, planes)
