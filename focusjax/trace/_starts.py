"""Lens rays of many film and pupil points.

XLA for CPU works what several programs read out anew in each of them, and what it is made of: the film points
of a block, looked up in a table of samples, would be looked up again, and rays followed through glass again,
in every step after. Nothing but a loop keeps it from that. So rays are made in a loop over some thousand of
them at a time, whose numbers stay in the cache of a processor, and in plain columns.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens

_TOGETHER = {"cpu": 1 << 13, "gpu": 1 << 19}
"""Rays made at a time."""


def lens_rays(
    camera: Camera, lens: AbstractLens, film: Float[Array, "p s 2"], pupil: Float[Array, "p s 2"]
) -> LensRay:
    """The rays [p, s] of film points through points of the opening."""
    shape = film.shape[:2]
    count = shape[0] * shape[1]
    parts = -(-count // _TOGETHER.get(jax.default_backend(), 1 << 16))
    size = -(-count // parts)

    def in_parts(column: Float[Array, "p s"]) -> Float[Array, "k m"]:
        # The last one is repeated to fill them.
        filled = jnp.pad(column.reshape(-1), (0, parts * size - count), mode="edge")
        return filled.reshape(parts, size)

    def one(film_x: Array, film_y: Array, pupil_x: Array, pupil_y: Array) -> tuple[Array, ...]:
        ray = lens.ray(camera, jnp.stack([film_x, film_y]), jnp.stack([pupil_x, pupil_y]))
        return *ray.a, *ray.b, ray.weight

    starts = [in_parts(points[..., axis]) for points in (film, pupil) for axis in range(2)]
    found = jax.lax.map(lambda some: jax.vmap(one)(*some), starts)
    a_x, a_y, b_x, b_y, weight = (values.reshape(-1)[:count].reshape(shape) for values in found)
    return LensRay(jnp.stack([a_x, a_y], axis=-1), jnp.stack([b_x, b_y], axis=-1), weight)
