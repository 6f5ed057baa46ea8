"""The sharp picture, everything in focus, which needs no rays at all."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.layers import peel
from focusjax.lens import thin_lens
from focusjax.scene import Scene


def render_pinhole(scene: Scene, camera: Camera, *, supersampling: int = 4) -> Float[Array, "h w 3"]:
    """The picture of a pinhole: linear radiance, mean over `supersampling`^2 points of each pixel.

    It is also what any lens tends to when its aperture closes.
    """
    pinhole = thin_lens(focus_distance=1.0, aperture_radius=0.0)
    layers = peel(scene, camera, pinhole, supersampling=supersampling, max_layers=1)
    seen = jnp.where(layers.triangle[0, ..., None] >= 0, layers.radiance[0], layers.background)
    blocks = seen.reshape(camera.height, supersampling, camera.width, supersampling, 3)
    return blocks.mean(axis=(1, 3))
