"""Whether layers hold all that the rays of a lens can pass."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._arguments import ArgumentError
from focusjax.geometry import Camera, filter_radius
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, not_numbers

_ROUNDING = 1e-5
_SLACK = 1e-3
"""Pixels."""
_LOOKS = 9
"""Disparities over the layers' range at which rays are looked at."""


def check_filter(layers: Layers, pixel_filter: str) -> None:
    """Refuse rays from film points of a filter that is wider than the one that the layers were peeled for.

    Raises:
        ArgumentError: (a `ValueError`) it is wider.
    """
    wide, held = filter_radius(pixel_filter), filter_radius(layers.pixel_filter)
    if wide > held:
        raise ArgumentError(
            f"rays start up to {wide:g} pixels from their pixel's centre with pixel_filter={pixel_filter!r}"
            f" but the layers were peeled for {held:g}; peel with pixel_filter={pixel_filter!r}",
            "pixel_filter",
        )


def check_reach(layers: Layers, lens: AbstractLens, pixel_filter: str = "box") -> None:
    """Refuse rays that may pass surfaces that were left out as out of reach when peeling.

    Those of a lens that moves them farther, or from film points of a filter that is wider.

    Raises:
        ArgumentError: (a `ValueError`) there may be such rays, or a setting of the lens is not a number.
    """
    check_filter(layers, pixel_filter)
    camera = layers.camera
    moves, peeled = float(_parallax(lens, camera)), float(_parallax(layers.lens, camera))
    leaves, margin = _strays(layers, lens), layers.grid.margin / layers.grid.supersampling
    if np.isnan(moves) or np.isnan(leaves).any():
        what = not_numbers(lens) or "an angle or a distance of its rays is not a number"
        raise ArgumentError(f"{what}; expected a lens of finite settings, such as `thin_lens` makes", "lens")
    if not moves <= peeled * (1 + _ROUNDING):
        raise ArgumentError(
            f"the lens moves rays by {moves:.4g} pixels per dioptre but the layers were peeled for"
            f" {peeled:.4g}; peel again with this lens",
            "lens",
        )
    if not np.all(leaves <= np.maximum(_strays(layers, layers.lens), margin) + _SLACK):
        raise ArgumentError(
            f"rays of the lens leave the frame by up to {leaves.max():.4g} pixels but the layers, peeled for"
            f" another focus, hold a margin of {margin:.4g}; peel again with this lens",
            "lens",
        )


def out_of_reach(layers: Layers, lens: AbstractLens) -> Bool[Array, ""]:
    """Whether `check_reach` would refuse the lens, for compiled functions."""
    camera = layers.camera
    moves, peeled = lens.parallax(camera), layers.lens.parallax(camera)
    least, largest = layers.ranges.overall
    share = jnp.linspace(0.0, 1.0, _LOOKS).astype(least.dtype)
    at = least + share * (largest - least)
    margin = layers.grid.margin / layers.grid.supersampling
    held = jnp.maximum(_strays_at(layers.lens, camera, at), margin) + _SLACK
    strays = (largest > 0) & ~(_strays_at(lens, camera, at) <= held).all()
    return ~(moves <= peeled * (1 + _ROUNDING)) | strays


def widest_opening(layers: Layers, lens: AbstractLens) -> Float[Array, ""]:
    """The share of the opening of `lens`, at most 1, up to which `check_reach` lets it pass.

    All else of the lens stays as it is. Rays stray in proportion to the opening, or less as it closes, so
    that every smaller share passes, too. Differentiable but where another limit takes over.
    """
    camera = layers.camera
    moves, peeled = lens.parallax(camera), layers.lens.parallax(camera)
    least, largest = layers.ranges.overall
    at = least + jnp.linspace(0.0, 1.0, _LOOKS).astype(least.dtype) * (largest - least)
    margin = layers.grid.margin / layers.grid.supersampling
    held = jnp.maximum(_strays_at(layers.lens, camera, at), margin)
    strays = jnp.where(largest > 0, _strays_at(lens, camera, at), 0.0)
    shares = jnp.append(_share(held, strays), _share(peeled, moves))
    return jnp.minimum(jnp.min(shares), 1.0)


def _share(held: Array, wanted: Array) -> Array:
    """How much of `wanted` is held; 1 where nothing is wanted."""
    safe = jnp.where(wanted > 0.0, wanted, 1.0)
    return jnp.where(wanted > 0.0, held / safe, 1.0)


def _strays(layers: Layers, lens: AbstractLens) -> np.ndarray:
    """How far in pixels rays stray from their film points, at disparities over the layers' range."""
    least, largest = (float(w) for w in layers.ranges.overall)
    if not largest > 0:
        return np.zeros(1)
    disparities = jnp.asarray(np.linspace(least, largest, _LOOKS).astype(layers.background.dtype))
    return np.asarray(_strays_at(lens, layers.camera, disparities))


@eqx.filter_jit
def _parallax(lens: AbstractLens, camera: Camera) -> Float[Array, ""]:
    return lens.parallax(camera)


@eqx.filter_jit
def _strays_at(lens: AbstractLens, camera: Camera, disparities: Float[Array, " n"]) -> Float[Array, " n"]:
    return jax.vmap(lambda w: lens.reach(camera, w))(disparities)
