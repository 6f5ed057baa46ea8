"""Whether layers hold all that the rays of a lens can pass."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.layers import Layers
from focusjax.lens import AbstractLens

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 23}


def check_reach(layers: Layers, lens: AbstractLens) -> None:
    """Refuse a lens whose rays may pass surfaces that were left out as out of reach when peeling."""
    camera = layers.camera
    moves, peeled = float(lens.parallax(camera)), float(layers.lens.parallax(camera))
    if moves > peeled * (1 + 1e-5):
        raise ValueError(
            f"the lens moves rays by {moves:.4g} pixels per dioptre but the layers were peeled for"
            f" {peeled:.4g}; peel again with this lens"
        )
    leaves, margin = _strays(layers, lens), layers.grid.margin / layers.grid.supersampling
    if np.any(leaves > np.maximum(_strays(layers, layers.lens), margin) + 1e-3):
        raise ValueError(
            f"rays of the lens leave the frame by up to {leaves.max():.4g} pixels but the layers, peeled for"
            f" another focus, hold a margin of {margin:.4g}; peel again with this lens"
        )


def _strays(layers: Layers, lens: AbstractLens) -> np.ndarray:
    """How far in pixels rays stray from their film points, at disparities over the layers' range."""
    least, largest = (float(w) for w in layers.ranges.overall)
    if not largest > 0:
        return np.zeros(1)
    disparities = jnp.asarray(np.linspace(least, largest, 9).astype(layers.background.dtype))
    return np.asarray(_strays_at(lens, layers.camera, disparities))


@eqx.filter_jit
def _strays_at(lens: AbstractLens, camera: Camera, disparities: Float[Array, " n"]) -> Float[Array, " n"]:
    return jax.vmap(lambda w: lens.reach(camera, w))(disparities)
