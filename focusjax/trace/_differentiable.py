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
from focusjax.trace._flux import Means, Rays, Still, in_blocks, picture_flow
from focusjax.trace._known_light import evened, known_light
from focusjax.trace._radiances import disparity_ranges, traced_scene
from focusjax.trace._reach import check_reach, out_of_reach
from focusjax.trace._samples import ray_samples
from focusjax.trace._tracer import block_radiances

_RAYS_AT_ONCE = {"cpu": 1 << 17, "gpu": 1 << 22}


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
        derivative_rays: rays per border between pixels and, up to `rays`, per rim of the opening, of which
            derivatives by the lens are made; half of `rays` if not given.
        seed: chooses the rays. The same seed gives the same picture and the same derivatives.

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
    picture, derivative = Rays(rays, seed, at_once), Rays(derivative_rays, seed, at_once)
    return _differentiable(layers, lens, picture=picture, derivative=derivative)


@eqx.filter_jit
def _differentiable(
    layers: Layers, lens: AbstractLens, *, picture: Rays, derivative: Rays
) -> Float[Array, "h w 3"]:
    fixed = jax.tree.map(jax.lax.stop_gradient, eqx.filter(layers, eqx.is_array))
    fixed = eqx.combine(fixed, layers)
    look = layers.samples.radiance, layers.background
    means = _means(look, lens, fixed, picture=picture, derivative=derivative)
    return means.picture.reshape(layers.camera.height, layers.camera.width, 3)


@eqx.filter_custom_jvp
def _means(
    look: tuple[Array, Array], lens: AbstractLens, layers: Layers, *, picture: Rays, derivative: Rays
) -> Means:
    """The picture; of what else there is only derivatives are made, so that nothing moves it."""
    return _traced(look, lens, layers, picture, _at_rim(picture, derivative))


@_means.def_jvp
def _means_jvp(primals: Any, tangents: Any, *, picture: Rays, derivative: Rays) -> tuple[Means, Means]:
    look, lens, layers = primals
    look_moves, lens_moves, _ = tangents
    means = _means(look, lens, layers, picture=picture, derivative=derivative)
    few = _at_rim(picture, derivative)
    change = jnp.zeros_like(means.picture)
    if jax.tree.leaves(look_moves):

        def seen(look: tuple[Array, Array]) -> Float[Array, "p 3"]:
            return _traced(look, lens, layers, picture, few).picture

        change += eqx.filter_jvp(seen, (look,), (look_moves,))[1]
    if jax.tree.leaves(lens_moves):
        least, largest, _ = disparity_ranges(layers, lens)
        film = ray_samples(lens, [picture.number], picture.seed).offset[:, :few]
        still = Still(traced_scene(layers), lens, least, largest, means, picture, film, derivative)
        flow = eqx.filter_jvp(lambda new: picture_flow(still, new), (lens,), (lens_moves,))[1]
        change += flow.reshape(-1, 3)
    return means, Means(change, jnp.zeros_like(means.radiance), jnp.zeros_like(means.beside))


def _at_rim(picture: Rays, derivative: Rays) -> int:
    """Rays through the rim of the opening for each pixel."""
    return min(picture.number, derivative.number)


def _traced(look: tuple[Array, Array], lens: AbstractLens, layers: Layers, rays: Rays, few: int) -> Means:
    """What rays bring from layers of a given radiance, all of them and the first few."""
    camera = layers.camera
    least, largest, _ = disparity_ranges(layers, lens)
    samples = dataclasses.replace(layers.samples, radiance=look[0])
    scene = traced_scene(dataclasses.replace(layers, samples=samples, background=look[1]))
    starts = ray_samples(lens, [rays.number], rays.seed, with_chances=layers.samples.opacity is not None)

    def block(pixels: Int[Array, " b"]) -> Float[Array, "b 4 3"]:
        first = jnp.zeros_like(pixels)

        def seen(lens: AbstractLens) -> Float[Array, "b 4 3"]:
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
            arrives = [share * along[..., k] for k in range(3)]
            some = [part for value in (*arrives, share) for part in (value, value[:, :few])]
            *brought, light, few_light = [part.mean(axis=1) for part in some]
            of_all, of_few = (jnp.stack(brought[k::2], axis=-1) for k in (0, 1))
            stood = [jnp.broadcast_to(a[:, None], of_all.shape) for a in (light, few_light)]
            return jnp.stack([of_all, of_few, *stood], axis=1)

        return in_colour(seen, lens)

    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    found = in_blocks(block, column, row, max(1, rays.at_once // rays.number))
    picture, of_few, light, few_light = (found[:, k] for k in range(4))
    radiance = jnp.where(light > 0, picture / jnp.where(light > 0, light, 1.0), 0.0)
    known = known_light(lens, camera)
    picture = picture if known is None else evened(picture, light, known)
    return Means(picture, radiance, of_few - radiance * few_light)
