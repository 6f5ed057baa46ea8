"""The radiance of surface samples, and what is seen behind them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._device import device_array
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.layers._blocks import in_blocks
from focusjax.layers._gloss import pack_normal
from focusjax.layers._grid import Grid
from focusjax.scene import AbstractBackground, ConstantBackground, Scene, Shader

_SHADED_AT_ONCE = 1 << 16


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
