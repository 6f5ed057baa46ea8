"""The least of a quadratic of two unknowns over a disk: the trust-region problem, exactly."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_STEPS = 60


def least_in_disk(
    stiffness: Float[Array, "2 2"], best: Float[Array, "2"], radius: Float[Array, ""]
) -> tuple[Float[Array, "2"], Bool[Array, ""]]:
    """The p that minimises (p - best)' K (p - best) with |p| <= radius, and whether the rim holds it.

    On the rim (K + l) p = K best for the one l > 0 that makes |p| = radius (More and Sorensen 1983). Let
    g be the parts of K best along K's eigenvectors, of eigenvalue k; |p|^2 is the sum of (g / (k + l))^2.
    Newton's method on 1 / |p|, which is concave in l, climbs to the root from 0 without overshooting. One
    more Newton step on both equations, with its matrix held, leaves the values and carries the derivatives.

    Args:
        stiffness: K [2, 2], symmetric and positive definite.
        best: the least without the disk.
        radius: of the disk, at least 0.
    """
    outside = best @ best > radius**2
    size = jnp.maximum(jnp.trace(stiffness), jnp.finfo(best.dtype).tiny)
    k = stiffness / size
    safe_best = jnp.where(outside, best, 1.0)
    # A disk of radius 0 is its centre, whatever K is.
    room = outside & (radius > 0)
    safe_radius = jnp.where(room, radius, 1.0)
    still_k, still_best, still_radius = jax.lax.stop_gradient((k, safe_best, safe_radius))
    values, vectors = jnp.linalg.eigh(still_k)
    values = jnp.maximum(values, jnp.finfo(best.dtype).tiny)
    pull = values * (vectors.T @ still_best) / still_radius

    def climb(_: Array, multiplier: Float[Array, ""]) -> Float[Array, ""]:
        part = pull / (values + multiplier)
        square = part @ part
        slope = part @ (part / (values + multiplier))
        return jnp.maximum(multiplier + square / slope * (jnp.sqrt(square) - 1.0), 0.0)

    multiplier = jax.lax.fori_loop(0, _STEPS, climb, jnp.zeros_like(radius))
    held = vectors @ (pull / (values + multiplier))
    held = held / jnp.sqrt(held @ held)
    # In units of the radius: (k + l) p - k best / radius = 0 and (p.p - 1) / 2 = 0.
    matrix = jnp.block(
        [[still_k + multiplier * jnp.eye(2, dtype=k.dtype), held[:, None]], [held[None], jnp.zeros((1, 1))]]
    )
    off = k @ (held - safe_best / safe_radius) + multiplier * held
    # Only its derivative counts: its value is the rounding of the climb.
    off = off - jax.lax.stop_gradient(off)
    step = jnp.linalg.solve(matrix.astype(k.dtype), jnp.append(off, jnp.zeros((), dtype=k.dtype)))[:2]
    rim = jnp.where(room, safe_radius * (held - step), 0.0)
    return jnp.where(outside, rim, best), outside
