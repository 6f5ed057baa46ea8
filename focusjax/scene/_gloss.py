"""What of a surface's radiance depends on where it is seen from: highlights and mirrored surroundings."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.scene._background import AbstractBackground
from focusjax.scene._lights import AbstractLight
from focusjax.scene._vectors import Planes


class Gloss(eqx.Module):
    """The radiance that glossy materials add to a matt surface.

    With unit normal n on the side of the eye, unit direction e to the eye, its mirror image
    m = 2 (n.e) n - e, and for each light the direction l to it and its light L,

        k_s sum L max(m.l, 0)^shininess  +  k_r B(m),

    the sum over lights above the surface only (Phong 1975), and B the scene's background (Blinn and Newell
    1976). Light comes straight from lights and from infinity: objects neither mirror nor shade one another,
    and k_r does not grow towards grazing angles as Fresnel's laws would have it.

    Everything is a leaf that a gradient can reach; what no material uses is None and costs nothing.

    Attributes:
        specular: k_s of each material [m], per component, or once when it is grey in all of them.
        shininess: Phong exponent of each material [m].
        reflectance: k_r of each material [m], likewise.
        lights: what highlights are of.
        background: B, what is mirrored.
    """

    specular: Planes | None
    shininess: Float[Array, "_"]
    reflectance: Planes | None
    lights: tuple[AbstractLight, ...]
    background: AbstractBackground | None

    def __call__(
        self,
        point: Float[Array, "3"],
        normal: Float[Array, "3"],
        to_eye: Float[Array, "3"],
        material: Int[Array, ""],
    ) -> Float[Array, "3"]:
        """Linear RGB radiance added at one point.

        Args:
            point: world metres.
            normal: unit shading normal, on the side that the eye sees.
            to_eye: unit direction to the eye.
            material: number of the material.
        """

        def constant(planes: Planes) -> Float[Array, "3"] | Float[Array, "1"]:
            return jnp.stack([plane[material] for plane in planes])

        mirrored = 2.0 * _dot(normal, to_eye) * normal - to_eye
        radiance = jnp.zeros_like(to_eye)
        if self.specular is not None:
            for light in self.lights:
                to_light, arriving = light.arriving(point)
                lobe = jnp.maximum(_dot(mirrored, to_light), 0.0) ** self.shininess[material]
                radiance = radiance + jnp.where(_dot(normal, to_light) > 0.0, arriving * lobe, 0.0)
            radiance = constant(self.specular) * radiance
        if self.reflectance is not None and self.background is not None:
            radiance = radiance + constant(self.reflectance) * self.background.radiance(mirrored)
        return radiance


def _dot(left: Float[Array, "3"], right: Float[Array, "3"]) -> Float[Array, ""]:
    """Inner product term by term: for millions of rays XLA fuses it with what is around it."""
    products = left * right
    return products[0] + products[1] + products[2]
