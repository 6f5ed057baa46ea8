"""Lens rays of many film and aperture points.

XLA for CPU works what several programs read out anew in each of them, and what it is made of: film points,
looked up in a table of samples, would be looked up again, and rays traced through glass again, in every step
after. Nothing but a loop keeps it from that. So rays are made in a loop over some thousand of them at a time,
whose numbers stay in the cache of a processor, and in plain columns.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._at_once import at_once
from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens
from focusjax.trace._samples import Starts


def lens_rays(camera: Camera, lens: AbstractLens, starts: Starts) -> LensRay:
    """The rays [n] of film points through points of the aperture."""
    count = starts.x.shape[0]
    parts = -(-count // at_once(cpu=1 << 14, gpu=1 << 24))
    size = -(-count // parts)

    def in_parts(column: Float[Array, " n"]) -> Float[Array, "k m"]:
        # The last one is repeated to fill them.
        return jnp.pad(column, (0, parts * size - count), mode="edge").reshape(parts, size)

    def one(x: Array, y: Array, u: Array, v: Array) -> tuple[Array, ...]:
        ray = lens.ray(camera, jnp.stack([x, y]), jnp.stack([u, v]))
        return *ray.a, *ray.b, ray.weight

    columns = [in_parts(column) for column in (starts.x, starts.y, starts.u, starts.v)]
    found = jax.lax.map(lambda some: jax.vmap(one)(*some), columns)
    a_x, a_y, b_x, b_y, weight = (values.reshape(-1)[:count] for values in found)
    return LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), weight)
