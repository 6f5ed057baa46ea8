"""The radiance of surface samples, and what is seen behind them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._parallel import in_parallel, parts
from focusjax.geometry import Camera
from focusjax.layers._grid import Grid
from focusjax.layers._stamps import pad_rows
from focusjax.scene import AbstractBackground, ConstantBackground, Scene, Shader

_SHADED_AT_ONCE = 1 << 18


@eqx.filter_jit
def _shade_block(
    shader: Shader, face: Int[Array, " n"], barycentric: Float[Array, "n 3"], extent: Float[Array, " n"]
) -> Float[Array, "n 3"]:
    # Blocks that fit the cache: look-ups of a million samples at once would spill it.
    return jax.lax.map(lambda sample: shader(*sample), (face, barycentric, extent), batch_size=4096)


def shaded(shader: Shader, face: np.ndarray, barycentric: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """Radiance [n, 3] of the surface samples."""
    real = jnp.zeros(()).dtype

    def block(part: slice) -> np.ndarray:
        inputs = [
            pad_rows(a[part], _SHADED_AT_ONCE) for a in (face, barycentric.astype(real), extent.astype(real))
        ]
        shaded = _shade_block(shader, *(jnp.asarray(a) for a in inputs))
        return np.asarray(shaded)[: part.stop - part.start]

    # The blocks are scanned, which XLA does on one core: a CPU is given one per core at a time.
    blocks = in_parallel(block, parts(len(face), _SHADED_AT_ONCE))
    return np.concatenate([np.zeros((0, 3), dtype=real), *blocks])


@eqx.filter_jit
def _background_radiance(
    background: AbstractBackground, camera: Camera, positions: Float[Array, "n 2"]
) -> Float[Array, "n 3"]:
    return jax.vmap(lambda xy: background.radiance(camera.direction(xy)))(positions)


def background(scene: Scene, camera: Camera, grid: Grid) -> Float[Array, "h w 3"]:
    """What is seen at infinity through every sample of the grid."""
    if isinstance(scene.background, ConstantBackground):
        colour = np.asarray(scene.background.colour)
        return jnp.asarray(np.broadcast_to(colour, (grid.rows, grid.columns, 3)))
    x, y = np.meshgrid(np.arange(grid.columns) + 0.5, np.arange(grid.rows) + 0.5)
    positions = (np.stack([x, y], axis=-1).reshape(-1, 2) - grid.margin) / grid.supersampling
    flat = _background_radiance(scene.background, camera, jnp.asarray(positions, dtype=float))
    return flat.reshape(grid.rows, grid.columns, 3)
