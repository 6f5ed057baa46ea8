"""The light that gets through a lens that vignettes: known beforehand, not by the rays that happen to pass.

Where rims cut off part of the opening, I = (mean of w L) is a mean over rays of weight w, of which now more
and now fewer pass. A pixel of a plain wall would be darker or brighter by as much as its own rays are, and as
they repeat from tile to tile, so would a pattern. But the mean of w is a smooth function of the film point,
found by many rays at few places without any scene. With it

    I = (sum of w L) / (sum of w) * W,        W = that function,

the ratio estimate of sampling theory (Cochran, Sampling Techniques, chapter 6): exact where L is the same for
all rays, and elsewhere left with the variance of L alone. Its bias falls as 1 / rays; most of it is where no
ray at all gets through. W knows nothing of the scene, so that all is as linear in radiances as a mean is.
"""

import functools
from collections.abc import Sequence
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import make_interp_spline
from scipy.stats import qmc

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, in_colour

_Colours: TypeAlias = Float[Array, "p 3"] | Float[np.ndarray, "p 3"]

_NODES = 17, 25
"""Along the longer side of the frame at least and at most. Of 25, cubic splines are off by up to 3e-4 RMS."""
_FEWEST_NODES = 7
_PIXELS_APART = 8
_RAYS = 1 << 11
"""Through each node: off by 2e-4 to 1e-3 RMS."""
_TRUSTED = 0.02
"""By how much splines of every other node may be off; those of all are off by a fraction of it."""


class KnownLight(eqx.Module):
    """Mean weights of the rays of each pixel, row-major.

    Attributes:
        share: in red, green and blue [p, 3].
        doubt: 0 where that is good, to 1 where light changes too fast for it, as behind a hood that is far
            from a small opening; there the rays tell their own weight.
    """

    share: Float[Array, "p 3"]
    doubt: Float[Array, "p 3"]


def known_light(lens: AbstractLens, camera: Camera) -> KnownLight | None:
    """What is known of the light; None where all rays pass alike."""
    return light_map(lens, camera) if lens.vignettes() else None


def evened(brought: _Colours, light: _Colours, known: KnownLight) -> Float[Array, "p 3"]:
    """What rays bring, in proportion to the light that is known instead of to theirs.

    Args:
        brought: mean over rays of weight times radiance.
        light: the same of weights alone; pixels without any stay black.
        known: as of `known_light`.
    """
    share = known.share + known.doubt * (light - known.share)
    return jnp.where(light > 0, brought / jnp.where(light > 0, light, 1.0), 0.0) * share


@eqx.filter_jit
def light_map(lens: AbstractLens, camera: Camera) -> KnownLight:
    """The same of any lens."""
    real = jnp.zeros(()).dtype
    longest = max(camera.width, camera.height)
    along = min(max(longest // _PIXELS_APART + 1, _NODES[0]), _NODES[1])
    # Odd numbers, so that every other node is one at each end, too.
    rows, columns = (
        max(_FEWEST_NODES, round(along * side / longest)) | 1 for side in (camera.height, camera.width)
    )
    y, x = np.meshgrid(
        np.linspace(0.0, camera.height, rows), np.linspace(0.0, camera.width, columns), indexing="ij"
    )
    places = jnp.asarray(np.stack([x.ravel(), y.ravel()], axis=1), dtype=real)
    pupil = jax.vmap(lens.pupil_point)(jnp.asarray(_square(), dtype=real))

    def seen(lens: AbstractLens) -> Float[Array, "n 3"]:
        def one(film: Float[Array, "2"]) -> Float[Array, ""]:
            return jnp.mean(jax.vmap(lambda point: lens.ray(camera, film, point).weight)(pupil))

        return jnp.broadcast_to(jax.lax.map(one, places)[:, None], (len(places), 3))

    nodes = in_colour(seen, lens).reshape(rows, columns, 3)

    def spread(values: Array, degree: int, to: Sequence[np.ndarray]) -> Array:
        shares = (
            jnp.asarray(_spline(count, at, degree), dtype=real)
            for count, at in zip(values.shape[:2], to, strict=True)
        )
        return jnp.einsum("yr,rcb,xc->yxb", next(shares), values, next(shares), precision="highest")

    centres = tuple((np.arange(size) + 0.5) / size for size in (camera.height, camera.width))
    off = jnp.abs(spread(nodes[::2, ::2], 3, (np.linspace(0, 1, rows), np.linspace(0, 1, columns))) - nodes)
    off = jax.lax.reduce_window(off, 0.0, jax.lax.max, (3, 3, 1), (1, 1, 1), "same")
    doubt = jnp.clip(spread(off, 1, centres) / _TRUSTED - 1.0, 0.0, 1.0)
    share = jnp.clip(spread(nodes, 3, centres), 0.0, nodes.max())
    return KnownLight(share.reshape(-1, 3), doubt.reshape(-1, 3))


@functools.cache
def _square() -> Float[np.ndarray, "s 2"]:
    """Points of the unit square, the same for all nodes, so that what they miss changes smoothly."""
    return np.minimum(qmc.Sobol(2, rng=np.random.default_rng(0)).random(_RAYS), 1.0 - 2.0**-24)


def _spline(count: int, at: Float[np.ndarray, " p"], degree: int) -> Float[np.ndarray, "p n"]:
    """Shares of `count` nodes from 0 to 1 in a spline `at` some places."""
    return make_interp_spline(np.linspace(0.0, 1.0, count), np.eye(count), k=degree)(at)
