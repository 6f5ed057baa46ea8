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
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._frame_nodes import frame_nodes

_Colours: TypeAlias = Float[Array, "p 3"] | Float[np.ndarray, "p 3"]

_RAYS = 1 << 11
"""Through each of the nodes, whose cubic splines are off by up to 3e-4 RMS: off by 2e-4 to 1e-3 RMS."""
_TRUSTED = 0.02
"""By how much splines of every other node may be off; those of all are off by a fraction of it."""


class KnownLight(eqx.Module):
    """Mean weights of the rays of each pixel, row-major.

    Attributes:
        share: in red, green and blue [p, 3].
        doubt: 0 where that is good, to 1 where light changes too fast for it, as behind a hood that is far
            from a small opening; there the mean weight of the pixel's own rays is used.
    """

    share: Float[Array, "p 3"]
    doubt: Float[Array, "p 3"]

    def of(self, light: _Colours) -> Float[Array, "p 3"]:
        """The light that each pixel gets, of whose rays the mean weight is `light`."""
        return self.share + self.doubt * (light - self.share)


def known_light(lens: AbstractLens, camera: Camera) -> KnownLight | None:
    """What is known of the light; None where all rays pass alike."""
    return light_map(lens, camera) if lens.vignettes() else None


def evened(brought: _Colours, light: _Colours, known: KnownLight) -> Float[Array, "p 3"]:
    """The radiance that rays carry, in proportion to the light that is known instead of to theirs.

    `brought` is the mean over rays of weight times radiance, `light` that of weights alone; pixels without
    any stay black.
    """
    return jnp.where(light > 0, brought / jnp.where(light > 0, light, 1.0), 0.0) * known.of(light)


@jit
def light_map(lens: AbstractLens, camera: Camera) -> KnownLight:
    """The same of any lens."""
    nodes = frame_nodes(camera)
    real = jnp.zeros(()).dtype
    pupil = jax.vmap(lens.pupil_point)(jnp.asarray(_square(), dtype=real))

    def seen(lens: AbstractLens) -> Float[Array, "n 3"]:
        def one(film: Float[Array, "2"]) -> Float[Array, ""]:
            return jnp.mean(jax.vmap(lambda point: lens.ray(camera, film, point).weight)(pupil))

        light = nodes.at_all(one)
        return jnp.broadcast_to(light[:, None], (len(light), 3))

    light = in_colour(seen, lens)
    doubt = jnp.clip(nodes.in_pixels(nodes.off(light, 3), 1) / _TRUSTED - 1.0, 0.0, 1.0)
    return KnownLight(jnp.clip(nodes.in_pixels(light, 3), 0.0, light.max()), doubt)


@functools.cache
def _square() -> Float[np.ndarray, "s 2"]:
    """Points of the unit square, the same for all nodes, so that what they miss changes smoothly."""
    from scipy.stats import qmc

    return np.minimum(qmc.Sobol(2, rng=np.random.default_rng(0)).random(_RAYS), 1.0 - 2.0**-24)
