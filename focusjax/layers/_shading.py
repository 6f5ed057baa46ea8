"""The radiance of surface samples, what rays need to see gloss themselves, and what is seen behind all."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._device import device_array
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.layers._blocks import in_blocks
from focusjax.layers._grid import Grid
from focusjax.scene import AbstractBackground, ConstantBackground, Gloss, Scene, Shader

_STEPS = 65535
"""Of each coordinate of a packed normal."""
_SHADED_AT_ONCE = 1 << 16


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


@dataclasses.dataclass(frozen=True)
class ShadedSamples:
    """Surface samples as they look.

    Attributes:
        radiance: [n, 3], gloss left out where `normal` is there to work it out.
        normal: packed normals [n], or None.
    """

    radiance: np.ndarray
    normal: np.ndarray | None


@jit
def _shade_block(
    shader: Shader,
    face: Int[Array, " n"],
    barycentric: Float[Array, "n 3"],
    extent: Float[Array, " n"],
    *,
    gloss_apart: bool,
) -> tuple[Float[Array, "n 3"], UInt[Array, " n"] | None]:
    def one(sample: tuple[Array, Array, Array]) -> tuple[Array, Array | None]:
        if not gloss_apart:
            return shader(*sample), None
        surface = shader.surface(*sample)
        assert surface.normal is not None
        return surface.matt, pack_normal(surface.normal)

    # Blocks that fit the cache: look-ups of a million samples at once would spill it.
    return jax.lax.map(one, (face, barycentric, extent), batch_size=4096)


def shaded(
    shader: Shader, face: np.ndarray, barycentric: np.ndarray, extent: np.ndarray, *, gloss_apart: bool
) -> ShadedSamples:
    """The surface samples as seen by the shader's eye, with gloss or apart from it."""
    real = jnp.zeros(()).dtype

    def program(*samples: Array) -> tuple[Array, Array | None]:
        return _shade_block(shader, *samples, gloss_apart=gloss_apart)

    columns = (face, barycentric.astype(real), extent.astype(real))
    return ShadedSamples(*in_blocks(program, columns, _SHADED_AT_ONCE))


@jit
def _background_radiance(background: AbstractBackground, camera: Camera, grid: Grid) -> Float[Array, "h w 3"]:
    x, y = (
        (jnp.arange(count, dtype=float) + (0.5 - grid.margin)) / grid.supersampling
        for count in (grid.columns, grid.rows)
    )
    seen = jax.vmap(lambda x, y: background.radiance(camera.direction(jnp.stack([x, y]))), in_axes=(0, None))
    return jax.vmap(seen, in_axes=(None, 0))(x, y)


def background(scene: Scene, camera: Camera, grid: Grid) -> Float[Array, "h w 3"] | Float[Array, "3"]:
    """What is seen at infinity through every sample of the grid; one colour if it is the same all over."""
    if isinstance(scene.background, ConstantBackground):
        # In the precision of now, whatever it was made in.
        return device_array(np.asarray(scene.background.colour))
    return _background_radiance(scene.background, camera, grid)
