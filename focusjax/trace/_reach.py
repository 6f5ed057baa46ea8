"""Whether layers hold all that the rays of a lens can pass."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._arguments import ArgumentError
from focusjax._programs import jit
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
    wanted, held = np.asarray(_measured(layers.lens, lens, layers.camera, *_held_for(layers)))
    if np.isnan(wanted).any():
        what = not_numbers(lens) or "an angle or a distance of its rays is not a number"
        raise ArgumentError(f"{what}; expected a lens of finite settings, such as `thin_lens` makes", "lens")
    (moves, *leaves), (peeled, *_) = wanted, held
    if not moves <= peeled * (1 + _ROUNDING):
        raise ArgumentError(
            f"the lens moves rays by {moves:.4g} pixels per dioptre but the layers were peeled for"
            f" {peeled:.4g}; peel again with this lens",
            "lens",
        )
    if not np.all(leaves <= held[1:] + _SLACK):
        raise ArgumentError(
            f"rays of the lens leave the frame by up to {max(leaves):.4g} pixels but the layers, peeled for"
            f" another focus, hold a margin of {_held_for(layers)[1]:.4g}; peel again with this lens",
            "lens",
        )


def out_of_reach(layers: Layers, lens: AbstractLens) -> Bool[Array, ""]:
    """Whether `check_reach` would refuse the lens, for compiled functions."""
    wanted, held = _measures(layers.lens, lens, layers.camera, *_held_for(layers))
    most = jnp.concatenate([held[:1] * (1 + _ROUNDING), held[1:] + _SLACK])
    return ~(wanted <= most).all()


def widest_opening(layers: Layers, lens: AbstractLens) -> Float[Array, ""]:
    """The share of the opening of `lens`, at most 1, up to which `check_reach` lets it pass.

    All else of the lens stays as it is. Rays stray in proportion to the opening, or less as it closes, so
    that every smaller share passes, too. Differentiable but where another limit takes over.
    """
    wanted, held = _measures(layers.lens, lens, layers.camera, *_held_for(layers))
    safe = jnp.where(wanted > 0.0, wanted, 1.0)
    return jnp.minimum(jnp.where(wanted > 0.0, held / safe, 1.0).min(), 1.0)


def _held_for(layers: Layers) -> tuple[Float[Array, "2"], float]:
    """Least and largest disparity of all that the layers hold, and their margin in pixels."""
    return layers.ranges.overall, layers.grid.margin / layers.grid.supersampling


def _measures(
    peeled: AbstractLens, lens: AbstractLens, camera: Camera, overall: Float[Array, "2"], margin: float
) -> Float[Array, "2 n"]:
    """How far rays go, of `lens` and as far as layers hold them that were `peeled` for another.

    First pixels per dioptre; then how far in pixels rays stray from their film points at disparities over
    the layers' range, 0 where the layers hold nothing.
    """
    least, largest = overall
    at = least + np.linspace(0.0, 1.0, _LOOKS, dtype=least.dtype) * (largest - least)

    def strays(lens: AbstractLens) -> Float[Array, " n"]:
        return jax.vmap(lambda disparity: lens.reach(camera, disparity))(at)

    def of(lens: AbstractLens, strays: Float[Array, " n"]) -> Float[Array, " m"]:
        strays = jnp.where(largest > 0, strays, 0.0)
        return jnp.concatenate([lens.parallax(camera)[None], strays])

    return jnp.stack([of(lens, strays(lens)), of(peeled, jnp.maximum(strays(peeled), margin))])


# One program and one answer: a GPU takes longer to say each number than to work it out.
_measured = jit(_measures)
