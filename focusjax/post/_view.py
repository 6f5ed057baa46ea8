"""What post-processing knows of a scene."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.layers import Layers, disparity_map
from focusjax.lens import ThinLens, thin_lens
from focusjax.scene import Scene
from focusjax.trace import render_pinhole


class PinholeView(eqx.Module):
    """One sharp view with its depth, and how it moves.

    Attributes:
        image: [h, w, 3] linear radiance.
        disparity: [h, w] of the first surface at pixel centres, in 1/m; 0 is infinitely far.
        velocity: [h, w, 2] pixels (x right, y down) by which that surface moves while the shutter is open,
            the view being the middle of that time; None where nothing moves.
    """

    image: Float[Array, "h w 3"]
    disparity: Float[Array, "h w"]
    velocity: Float[Array, "h w 2"] | None = None


def closed_lens() -> ThinLens:
    """A lens with no opening, for layers that hold what a pinhole sees and no more."""
    return thin_lens(focus_distance=1.0, aperture_radius=0.0)


def view_in_layers(
    layers: Layers, scene: Scene, *, velocity: Float[Array, "h w 2"] | None = None
) -> PinholeView:
    """The sharp view that layers hold; those peeled for a `closed_lens` are enough.

    Args:
        layers: of the scene.
        scene: what they are of, for the depth at pixel centres.
        velocity: as in `PinholeView`.
    """
    image = render_pinhole(layers)
    disparity = jnp.asarray(disparity_map(scene, layers.camera), dtype=image.dtype)
    return PinholeView(image, disparity, velocity)
