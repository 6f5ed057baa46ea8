"""The radiance a ray brings back from the surface it met."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import LensRay
from focusjax.layers import Layers, Places
from focusjax.trace._gloss import GlossPlanes, gloss_at, gloss_planes


class Surface(eqx.Module):
    """The layers' appearance as flat planes.

    Attributes:
        places: from the flat index of a sample to its position in the next three.
        radiance: red, green and blue, each [n].
        disparity: 1/m [n].
        background: red, green and blue at infinity, each [m] over the grid; of length 1 where it is the same
            all over.
        gloss: what to add for each ray; None where gloss is part of `radiance`.
        columns: samples per row (static).
        rows: rows (static).
    """

    places: Places
    radiance: tuple[Float[Array, " n"], ...]
    disparity: Float[Array, " n"]
    background: tuple[Float[Array, " m"], ...]
    gloss: GlossPlanes | None
    columns: int = eqx.field(static=True)
    rows: int = eqx.field(static=True)


def surface_of(layers: Layers) -> Surface:
    """The flat planes of `layers`; what is flat there is the same arrays."""
    return Surface(
        places=layers.places,
        radiance=_colours(layers.samples.radiance),
        disparity=layers.samples.disparity,
        background=_colours(layers.background),
        gloss=gloss_planes(layers),
        columns=layers.grid.columns,
        rows=layers.grid.rows,
    )


@jax.jit
def _colours(radiance: Float[Array, "*n 3"]) -> tuple[Float[Array, " m"], ...]:
    """Red, green and blue."""
    return tuple(radiance[..., k].reshape(-1) for k in range(3))


def disparity_of(surface: Surface, hit: Int[Array, ""]) -> Float[Array, ""]:
    """Disparity of sample `hit`, 0 if that is -1."""
    number = surface.places.number(jnp.maximum(hit, 0))
    return jnp.where(hit >= 0, surface.disparity[number], 0.0)


def radiance_at(surface: Surface, ray: LensRay, hit: Int[Array, ""]) -> tuple[Float[Array, ""], ...]:
    """Radiance in red, green and blue that `ray` (in grid units) brings from sample `hit`.

    That of the sample, which is the mean over its area; from infinity if `hit` is -1.
    """
    met, number = hit >= 0, surface.places.number(jnp.maximum(hit, 0))
    behind = jnp.int32(0)
    if surface.background[0].size > 1:
        column = jnp.clip(jnp.floor(ray.a[0]).astype(jnp.int32), 0, surface.columns - 1)
        row = jnp.clip(jnp.floor(ray.a[1]).astype(jnp.int32), 0, surface.rows - 1)
        behind = row * surface.columns + column

    def look(plane: Float[Array, " n"], far: Float[Array, " m"]) -> Float[Array, ""]:
        near = plane.at[number].get(mode="promise_in_bounds")
        return jnp.where(met, near, far.at[behind].get(mode="promise_in_bounds"))

    radiance = tuple(look(*planes) for planes in zip(surface.radiance, surface.background, strict=True))
    if surface.gloss is None:
        return radiance
    disparity = jnp.where(met, surface.disparity[number], 1.0)
    gloss = gloss_at(surface.gloss, ray, disparity, [(number, jnp.ones_like(disparity))])
    return tuple(colour + jnp.where(met, gloss[k], 0.0) for k, colour in enumerate(radiance))
