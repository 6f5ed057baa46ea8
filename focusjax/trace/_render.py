"""The picture, with its arguments checked."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jax.experimental.jet import JetTracer
from jaxtyping import Array, Float, UInt

from focusjax._arguments import ArgumentError, require_kind, require_switches
from focusjax._counts import MOST_SEED, require_counts, require_seed
from focusjax.geometry import filter_radius
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, require_lens, traced_faults
from focusjax.trace._devices import Device, mesh_of, replicated
from focusjax.trace._emitters import may_emit, split_at_once
from focusjax.trace._groups import ray_group
from focusjax.trace._picture import RenderSettings, light_at_once, most_rays, picture
from focusjax.trace._reach import check_filter, check_reach, out_of_reach


def render(
    layers: Layers,
    lens: AbstractLens,
    *,
    rays: int = 64,
    derivative_rays: int | None = None,
    even: bool = False,
    smooth: bool | None = None,
    pixel_filter: str | None = None,
    seed: int | Array = 0,
    devices: Sequence[Device] | None = None,
) -> Float[Array, "h w 3"]:
    """The picture that `lens` forms of `layers`: linear radiance, mean over the rays of each pixel.

    A pure function of its arrays: it works under `jax.jit`, `jax.vmap` (over lenses, seeds, layers of equal
    shape), `jax.jvp` and `jax.grad`. Counts, switches and the pixel filter are static; a lens that moves or
    another seed compile nothing new; the first picture with small bright things out of focus compiles a
    program for their light.

    Derivatives are those of the converged picture: what is hidden and what shows may change. They hold for
    every array of the lens (focus, aperture, plane in focus, focal surface, shape of the aperture), and for
    `layers.samples.radiance` and `layers.background`; all else of the layers is taken as fixed. They are
    first derivatives, forward or reverse, in memory that does not grow with the number of rays; second ones
    by the lens are refused.

    Args:
        layers: peeled for this lens or for one whose rays go farther.
        lens: any lens.
        rays: rays per pixel on the average; each has its own place in the pixel and on the lens. They go
            where what they may meet differs, up to eight times as many, and four where it is all alike; see
            `_allocate`. Fewer than four are the same for all.
        derivative_rays: rays per border between pixels, rim of the aperture and pixel, of which derivatives
            by the lens are made; half of `rays` if not given, or as many as can be counted.
        even: give just `rays` to every pixel, be it plain or not.
        smooth: denoise what is blurred, by averaging over a few tenths of its blur with the pixels around,
            less the more rays there are; see `_denoise`. Otherwise each pixel is the mean of its own rays, as
            it is with `even` unless this says otherwise.
        pixel_filter: "box", "tent" or "gaussian", how the light around a pixel's centre counts: its rays are
            spread with that density. The one that the layers were peeled for if not given. Derivatives are
            those of "box".
        seed: chooses the rays; the same seed gives the same picture. It may be traced.
        devices: what traces it, the default device if not given. With `jax.devices()` the processes of
            `jax.distributed`, of which each has the layers and calls this, share the work, and each gets the
            whole picture. Not for derivatives, nor within compiled functions.

    Raises:
        ArgumentError: (a `ValueError`) no rays, or more than can be counted; no such filter; a seed out of
            range; what are no devices, or those of some other processes only; a lens of which a setting is
            out of range; a lens or filter whose rays leave what the layers were peeled for; a second
            derivative by the lens; series by `jax.experimental.jet`.
        EquinoxRuntimeError: (a `RuntimeError`) of a lens or seed that JAX traces, where the picture is
            computed: by `equinox.filter_jit`, `jax.vmap` or `jax.grad`. Under plain `jax.jit` JAX itself
            raises a `jax.errors.JaxRuntimeError`, whose text has the same sentence after a traceback.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> picture = fj.render(layers, lens, rays=32)
        >>> picture.shape, round(float(picture[3, 4, 0]), 3)
        ((6, 8, 3), 0.8)

        The derivative of its contrast by the focus:

        >>> def contrast(focus):
        ...     focused = eqx.tree_at(lambda lens: lens.focus_disparity, lens, focus)
        ...     return fj.render(layers, focused).var()
        >>> slope = jax.grad(contrast)(0.5)  # doctest: +SKIP
    """
    _refuse_series(layers, lens)
    settings = render_settings(
        layers,
        lens,
        rays=rays,
        derivative_rays=derivative_rays,
        even=even,
        smooth=smooth,
        pixel_filter=pixel_filter,
    )
    given = layers, within_reach(layers, lens, settings.pixel_filter), seed_of(seed)
    mesh = mesh_of(devices)
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(given))
    if mesh is None:
        return picture(*given, settings=settings) if traced else _at_once(*given, settings)
    if traced:
        message = "devices are given to a picture that is differentiated or compiled; leave them out"
        raise ArgumentError(message, "devices")
    shared = picture(*replicated(given, mesh), settings=dataclasses.replace(settings, mesh=mesh))
    return jnp.asarray(shared.addressable_data(0))


def _at_once(
    layers: Layers, lens: AbstractLens, seed: UInt[Array, ""], settings: RenderSettings
) -> Float[Array, "h w 3"]:
    """A picture of what is known: most have no emitters, and their light is compiled for those that have."""
    light = None
    if settings.emitters:
        left, emitters = split_at_once(layers, lens)
        if emitters is not None:
            light = light_at_once(emitters, left, lens, seed, settings)
        layers, settings = left, dataclasses.replace(settings, emitters=False)
    image = picture(layers, lens, seed, settings=settings)
    return image if light is None else image + light.reshape(image.shape)


def _refuse_series(layers: Layers, lens: AbstractLens) -> None:
    """Taylor series are of higher derivatives, and do not ask for the first one as it is defined here."""
    if any(isinstance(leaf, JetTracer) for leaf in jax.tree.leaves((layers, lens))):
        raise ArgumentError(
            "series of a picture by its lens or radiance (`jax.experimental.jet`) cannot be estimated from"
            " its rays; first derivatives can, by `jax.jvp` and `jax.grad`",
            "lens",
        )


def render_settings(
    layers: Layers,
    lens: AbstractLens,
    *,
    rays: int = 64,
    derivative_rays: int | None = None,
    even: bool = False,
    smooth: bool | None = None,
    pixel_filter: str | None = None,
) -> RenderSettings:
    """Checked settings; arguments and errors are those of `render`."""
    usage = "(layers, lens)"
    require_kind(layers, Layers, usage, "`peel` and `decompose` make them", "layers")
    if layers.cells.ndim > 3:
        message = "layers are several, stacked; expected those of one picture: `jax.vmap` takes one at a time"
        raise ArgumentError(message, "layers")
    require_lens(lens, usage)
    require_counts(rays=rays)
    pixels = layers.camera.width * layers.camera.height
    derivative_rays = (
        max(1, min(rays // 2, most_rays(pixels))) if derivative_rays is None else derivative_rays
    )
    require_counts(derivative_rays=derivative_rays)
    smooth = not even if smooth is None else smooth
    require_switches(even=even, smooth=smooth)
    _require_countable("rays", int(rays), layers, even=even)
    _require_countable("derivative_rays", int(derivative_rays), layers, even=True)
    chosen = layers.pixel_filter if pixel_filter is None else pixel_filter
    filter_radius(chosen)
    return RenderSettings(
        int(rays), int(derivative_rays), bool(even), bool(smooth), chosen, emitters=may_emit(layers)
    )


def _require_countable(name: str, rays: int, layers: Layers, *, even: bool) -> None:
    """Refuse more rays than the numbers of a picture's rays can count."""
    camera = layers.camera
    most = most_rays(camera.width * camera.height, ray_group(rays, even=even))
    if rays > most:
        raise ArgumentError(
            f"{name} is {rays}; at {camera.width} x {camera.height} pixels expected at most {most}: for more,"
            " take the mean of pictures of several seeds",
            name,
        )


def seed_of(seed: Any) -> UInt[Array, ""]:
    """A whole number, traced or not, as the device takes it.

    Raises:
        ArgumentError: (a `ValueError`) it is no whole number from 0 to 2^32 - 1. One that is traced is looked
            at where it is used, unless its type holds no other numbers.
    """
    if not isinstance(seed, Tracer):
        return jnp.uint32(require_seed(seed))
    if seed.shape or not jnp.issubdtype(seed.dtype, jnp.integer):
        expected = "one whole number" + ("" if not seed.shape else ": `jax.vmap` takes many")
        message = f"seed is traced as {seed.dtype}{list(seed.shape)}; expected {expected}"
        raise ArgumentError(message, "seed")
    bounds = jnp.iinfo(seed.dtype)
    wrong = jnp.zeros((), dtype=bool)
    if bounds.min < 0:
        wrong |= seed < 0
    if bounds.max > MOST_SEED:
        wrong |= seed > MOST_SEED
    if isinstance(wrong, Tracer):
        expected = f"expected a whole number from 0 to {MOST_SEED}"
        seed = eqx.error_if(seed, wrong, f"seed is out of range; {expected}")
    return seed.astype(jnp.uint32)


def within_reach(layers: Layers, lens: AbstractLens, pixel_filter: str) -> AbstractLens:
    """The lens, if the layers hold all of its rays; when traced, with checks where it is used.

    Raises:
        ArgumentError: (a `ValueError`) they do not.
    """
    check_filter(layers, pixel_filter)
    if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((layers, lens))):
        # Also where something else is traced, such as the seed.
        with jax.ensure_compile_time_eval():
            check_reach(layers, lens, pixel_filter)
        return lens
    for wrong, sentence in traced_faults(lens):
        lens = eqx.error_if(lens, wrong, sentence)
    return eqx.error_if(
        lens,
        out_of_reach(layers, lens),
        "rays of the lens leave what the layers were peeled for; keep its focus and aperture within"
        " bounds, or peel with the lens whose rays go farthest",
    )
