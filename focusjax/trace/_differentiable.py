"""The picture as a function that JAX differentiates, silhouettes included."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from focusjax._counts import require_counts, require_seed
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._flux import Rays, Still, in_blocks, picture_flow
from focusjax.trace._known_light import evened, known_light
from focusjax.trace._radiances import disparity_ranges, traced_scene
from focusjax.trace._reach import check_reach, out_of_reach
from focusjax.trace._samples import RaySamples, ray_samples
from focusjax.trace._tracer import block_radiances

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 22}
_APART = 1 << 20
"""Of the seed of derivatives from that of the picture."""


def render_differentiable(
    layers: Layers,
    lens: AbstractLens,
    *,
    rays: int = 64,
    derivative_rays: int | None = None,
    seed: int = 0,
) -> Float[Array, "h w 3"]:
    """The picture of `render(..., even=True, pixel_filter="box")`, for JAX to differentiate.

    No rays are aimed at highlights, so small ones are grainier than there.
    Its derivatives are those of the converged picture: what is hidden and what shows may change. They hold
    for every array of the lens (focus, aperture, plane in focus, focal surface, shape of the opening), and
    for `layers.samples.radiance` and `layers.background`; all else of the layers is taken as fixed.
    Forward (`jax.jvp`, `jax.jacfwd`) and reverse (`jax.vjp`, `jax.grad`) modes work, in memory that does
    not grow with the number of rays. See `_motion` for the mathematics.

    Args:
        layers: peeled for this lens or for one whose rays go farther.
        lens: any lens.
        rays: rays per pixel of the picture.
        derivative_rays: rays per border between pixels, rim of the opening and pixel, of which derivatives by
            the lens are made; half of `rays` if not given.
        seed: chooses the rays. The same seed gives the same picture and the same derivatives. Those by the
            lens are made of other rays: the gradient of a loss multiplies both, and noise must not meet
            itself in it. Those by radiances are of the picture's own, in which it is linear.

    Raises:
        ValueError: no rays, or a lens whose rays leave what the layers were peeled for. Within compiled
            functions the latter is an `equinox.EquinoxRuntimeError`.

    Example:
        >>> def contrast(focus):  # doctest: +SKIP
        ...     lens = eqx.tree_at(lambda lens: lens.focus_disparity, start, focus)
        ...     return render_differentiable(layers, lens).var()
        >>> jax.grad(contrast)(0.5)  # doctest: +SKIP
    """
    derivative_rays = max(1, rays // 2) if derivative_rays is None else derivative_rays
    require_counts(rays=rays, derivative_rays=derivative_rays)
    require_seed(seed)
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((layers, lens))):
        lens = eqx.error_if(
            lens,
            out_of_reach(layers, lens),
            "rays of the lens leave what the layers were peeled for; keep its focus and aperture within"
            " bounds, or peel with the lens whose rays go farthest",
        )
    else:
        check_reach(layers, lens)
    at_once = _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20)
    picture, derivative = Rays(rays, seed, at_once), Rays(derivative_rays, seed + _APART, at_once)
    return _differentiable(layers, lens, picture=picture, derivative=derivative)


@eqx.filter_jit
def _differentiable(
    layers: Layers, lens: AbstractLens, *, picture: Rays, derivative: Rays
) -> Float[Array, "h w 3"]:
    fixed = jax.tree.map(jax.lax.stop_gradient, eqx.filter(layers, eqx.is_array))
    fixed = eqx.combine(fixed, layers)
    look = layers.samples.radiance, layers.background
    means = _means(look, lens, fixed, picture=picture, derivative=derivative)
    return means.reshape(layers.camera.height, layers.camera.width, 3)


@eqx.filter_custom_jvp
def _means(
    look: tuple[Array, Array], lens: AbstractLens, layers: Layers, *, picture: Rays, derivative: Rays
) -> Float[Array, "p 3"]:
    """The picture, row-major."""
    return _traced(look, lens, layers, picture, _starts(lens, layers, picture))[0]


@_means.def_jvp
def _means_jvp(
    primals: Any, tangents: Any, *, picture: Rays, derivative: Rays
) -> tuple[Float[Array, "p 3"], Float[Array, "p 3"]]:
    look, lens, layers = primals
    look_moves, lens_moves, _ = tangents
    means = _means(look, lens, layers, picture=picture, derivative=derivative)
    change = jnp.zeros_like(means)
    if jax.tree.leaves(look_moves):

        def seen(look: tuple[Array, Array]) -> Float[Array, "p 3"]:
            return _traced(look, lens, layers, picture, _starts(lens, layers, picture))[0]

        change += eqx.filter_jvp(seen, (look,), (look_moves,))[1]
    if jax.tree.leaves(lens_moves):
        least, largest, _ = disparity_ranges(layers, lens)
        starts = _starts(lens, layers, derivative)
        _, radiance = _traced(look, lens, layers, derivative, starts)
        still = Still(traced_scene(layers), lens, least, largest, radiance, starts.offset, derivative)
        flow = eqx.filter_jvp(lambda new: picture_flow(still, new), (lens,), (lens_moves,))[1]
        change += flow.reshape(-1, 3)
    return means, change


def _starts(lens: AbstractLens, layers: Layers, rays: Rays) -> RaySamples:
    return ray_samples(lens, [rays.number], rays.seed, with_chances=layers.samples.opacity is not None)


def _traced(
    look: tuple[Array, Array], lens: AbstractLens, layers: Layers, rays: Rays, starts: RaySamples
) -> tuple[Float[Array, "p 3"], Float[Array, "p 3"]]:
    """What rays bring to each pixel from layers of a given radiance, and that relative to their light.

    The latter is 0 where there is no light.
    """
    camera = layers.camera
    least, largest, _ = disparity_ranges(layers, lens)
    samples = dataclasses.replace(layers.samples, radiance=look[0])
    scene = traced_scene(dataclasses.replace(layers, samples=samples, background=look[1]))

    def block(pixels: Int[Array, " b"]) -> Float[Array, "b 2 3"]:
        first = jnp.zeros_like(pixels)

        def seen(lens: AbstractLens) -> Float[Array, "b 2 3"]:
            along, share, _ = block_radiances(
                scene,
                lens,
                starts,
                pixels,
                first,
                least,
                largest,
                together=rays.number,
                depth=layers.count,
            )
            # Each colour for itself, as in `trace_block`.
            brought = [(share * along[..., k]).mean(axis=1) for k in range(3)]
            return jnp.stack([jnp.stack(brought, axis=-1), jnp.tile(share.mean(axis=1)[:, None], 3)], axis=1)

        return in_colour(seen, lens)

    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    found = in_blocks(block, column, row, max(1, rays.at_once // rays.number))
    picture, light = found[:, 0], found[:, 1]
    radiance = jnp.where(light > 0, picture / jnp.where(light > 0, light, 1.0), 0.0)
    known = known_light(lens, camera)
    return picture if known is None else evened(picture, light, known), radiance
