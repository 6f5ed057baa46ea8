"""What layers hold of glossy surfaces, so that each lens ray sees its own highlight (Lee09 section 5)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from focusjax.scene import Gloss

_STEPS = 65535


class GlossSamples(eqx.Module):
    """The attributes from which gloss is worked out wherever a surface is seen from.

    Attributes:
        normal: packed unit normals [n] on the side that the lens centre sees; see `unpack_normal`.
        material: material number [n] in as few bytes as hold them all.
        model: what materials, lights and surroundings make of a normal and a direction.
    """

    normal: UInt[Array, " n"]
    material: UInt[Array, " n"]
    model: Gloss


def pack_normal(normal: Float[Array, "3"]) -> UInt[Array, ""]:
    """A unit vector in 32 bits: its projection to an octahedron, unfolded to a square of 16 bits each way.

    The direction is kept to 0.004 degrees (Cigolle et al. 2014, "oct32").
    """
    x, y, z = normal / jnp.maximum(jnp.abs(normal).sum(), jnp.finfo(normal.dtype).tiny)
    folded_x, folded_y = _folded(x, y)
    u, v = (
        jnp.round((0.5 + 0.5 * jnp.where(z < 0, folded, flat)) * _STEPS).astype(jnp.uint32)
        for folded, flat in ((folded_x, x), (folded_y, y))
    )
    return u << 16 | v


def unpack_normal(code: UInt[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """World x, y and z of a packed vector; their absolute values sum to 1, so that its length is below 1."""
    real = jnp.zeros(()).dtype
    x, y = ((half.astype(real) * (2.0 / _STEPS) - 1.0) for half in (code >> 16, code & 0xFFFF))
    z = 1.0 - jnp.abs(x) - jnp.abs(y)
    folded_x, folded_y = _folded(x, y)
    return jnp.where(z < 0, folded_x, x), jnp.where(z < 0, folded_y, y), z


def _folded(x: Float[Array, ""], y: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The lower half of the octahedron on the corners of the square around the upper half, and back."""
    sign_x, sign_y = jnp.where(x < 0, -1.0, 1.0), jnp.where(y < 0, -1.0, 1.0)
    return (1.0 - jnp.abs(y)) * sign_x, (1.0 - jnp.abs(x)) * sign_y
