"""The light of the emitters of a still picture; see `focusjax.trace._emitter_pairs`."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from focusjax.geometry import LensRay
from focusjax.lens import AbstractLens
from focusjax.trace._emitter_pairs import FARTHEST_OFF, Drawing, Pairs, carried, light_of_pairs, reached
from focusjax.trace._emitters import Emitters
from focusjax.trace._in_parts import in_parts
from focusjax.trace._march import first_hits
from focusjax.trace._radiances import TracedScene, on_grid
from focusjax.trace._ranges import DisparityRanges
from focusjax.trace._walk import path_of


def emitter_light(
    scene: TracedScene,
    lens: AbstractLens,
    emitters: Emitters,
    ranges: DisparityRanges,
    seed: UInt[Array, ""],
    *,
    rays: int,
    pixel_filter: str,
) -> Float[Array, "p 3"]:
    """The light that each pixel gets from emitters, row-major, beyond what is left of them in the layers.

    Args:
        scene: without the emitters' excess, as of `split_emitters`.
        lens: whose picture it is.
        emitters: as of `split_emitters`.
        ranges: disparities that the rays of pixels can meet.
        seed: chooses the rays.
        rays: of a pixel, on the average.
        pixel_filter: "box", "tent" or "gaussian".
    """
    slots, volume = emitters.slots, scene.volume

    def brought(draw: Drawing, lens: AbstractLens, some: Pairs) -> tuple[Float[Array, " n"], ...]:
        a_x, a_y, b_x, b_y, value, slot, chance = in_parts(
            lambda columns: _aimed(draw, scene, lens, Pairs(*columns)), some.columns()
        )
        least, largest, _ = ranges.at(some.column, some.row)
        ray = LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), value)
        # A ray that carries nothing gets a path of no steps, on which it meets nothing.
        paths = jax.vmap(path_of)(on_grid(ray, scene.grid), least, jnp.where(value > 0, largest, 0.0))
        hits = first_hits(volume, paths, None if volume.opacity is None else chance)
        value = jnp.where(reached(slots, volume, hits, some.cluster, slot), value, 0.0)
        return tuple(value * plane.at[slot].get(mode="promise_in_bounds") for plane in slots.power)

    return light_of_pairs(emitters, scene.camera, lens, brought, seed, rays=rays, pixel_filter=pixel_filter)


def _aimed(draw: Drawing, scene: TracedScene, lens: AbstractLens, some: Pairs) -> tuple[Array, ...]:
    """Rays, in output pixels, what each carries per power of its slot, that slot, and its chance."""
    u, v, x, y = draw.points(some, 4)
    film, drawn = draw.film(some, x, y), draw.places(some, scene.grid, u, v)
    near = FARTHEST_OFF / scene.grid.supersampling

    def one(film: Array, place: Array, disparity: Array, slope: Array) -> tuple[Array, ...]:
        ray, value = carried(scene.camera, lens, film, place, disparity, slope, near)
        return *ray.a, *ray.b, value

    *ray, value = jax.vmap(one)(film, drawn.place, drawn.disparity, drawn.slope)
    return *ray, drawn.of_slot(value), drawn.slot, draw.chances(some)
