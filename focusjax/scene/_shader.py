"""Radiance of one surface sample, written so that a million of them are a few hundred gathers."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.scene._atlas import Atlas
from focusjax.scene._gloss import Gloss
from focusjax.scene._lights import AbstractLight
from focusjax.scene._vectors import Planes, dot, unit

_ONE_TEXEL = 1.05
"""Footprint in texels up to which a sample is no larger than a texel: rounding, and a little."""


class Texturing(eqx.Module):
    """What a textured scene adds: pictures, and where triangles lie in them.

    Attributes:
        atlas: the pictures; number 0 is white, for materials without one.
        texture: picture of each material [m].
        uv: texture coordinates of the vertices.
        texels_per_metre: level-0 texels along a metre of each face [t].
        pixels: whether the texels of each material [m] are looked at as they are; None where of no material.
    """

    atlas: Atlas
    texture: Int[Array, "_"]
    uv: Planes
    texels_per_metre: Float[Array, "_"]
    pixels: Bool[Array, "_"] | None = None

    def look_up(
        self, material: Int[Array, ""], uv: Float[Array, "2"], footprint: Float[Array, ""]
    ) -> Float[Array, "3"]:
        """Colour of a material at `uv` over a square of `footprint` texels."""
        texture = self.texture[material]
        if self.pixels is not None:
            own = self.pixels[material] & (footprint <= _ONE_TEXEL)
            uv = jnp.where(own, self.atlas.texel_centre(texture, uv), uv)
            footprint = jnp.where(own, 0.0, footprint)
        return self.atlas(texture, uv, footprint)


class SurfacePoint(eqx.Module):
    """A shaded point, all but its gloss.

    Attributes:
        matt: linear radiance, the same from wherever that side of the surface is seen.
        point: world metres.
        normal: unit shading normal on the side of the eye; None when unlit.
        to_eye: unit direction to the eye.
        material: number of the material.
    """

    matt: Float[Array, "3"]
    point: Float[Array, "3"]
    normal: Float[Array, "3"] | None
    to_eye: Float[Array, "3"]
    material: Int[Array, ""]


class Shader(eqx.Module):
    """The outgoing radiance towards `eye` of points on a scene's triangles.

    With albedo rho = base colour x vertex colour x texture, unit normal n, and for each light the direction
    l to it and its light L:

        radiance = emission + rho (ambient + sum L max(n.l, 0)) + gloss,

    where `Gloss` says what highlights and mirrored surroundings add. Unlit: emission + rho. Surfaces
    have two sides: n is turned to the side of the triangle that the eye sees.

    Everything is a pytree leaf, so a gradient can reach light, albedo and texture; what a scene
    does not use is None and costs nothing (normals are None when unlit). Pass the shader to a jitted
    function as an argument: closed over, its arrays would be compiled in as constants.
    """

    faces: tuple[Int[Array, "_"], ...]
    positions: Planes
    normals: Planes | None
    colours: Planes | None
    face_material: Int[Array, "_"]
    base_colour: Planes
    emission: Planes | None
    gloss: Gloss | None
    texturing: Texturing | None
    lights: tuple[AbstractLight, ...]
    ambient: Float[Array, "3"]
    eye: Float[Array, "3"]

    def __call__(
        self, triangle: Int[Array, ""], barycentric: Float[Array, "3"], extent: Float[Array, ""]
    ) -> Float[Array, "3"]:
        """Linear RGB radiance of one point.

        Args:
            triangle: face number; any number in range gives a finite answer.
            barycentric: perspective-correct weights [3] of that face's vertices, which sum to 1.
            extent: width in metres of the patch the sample stands for; sets the texture's mip level.
        """
        surface = self.surface(triangle, barycentric, extent)
        if self.gloss is None or surface.normal is None:
            return surface.matt
        return surface.matt + self.gloss(surface.point, surface.normal, surface.to_eye, surface.material)

    def surface(
        self, triangle: Int[Array, ""], barycentric: Float[Array, "3"], extent: Float[Array, ""]
    ) -> SurfacePoint:
        """One point without its gloss; arguments as for calling."""
        corners = [corner[triangle] for corner in self.faces]

        def at_corners(planes: Planes) -> list[Float[Array, "_"]]:
            return [jnp.stack([plane[corner] for plane in planes]) for corner in corners]

        def blend(planes: Planes) -> Float[Array, "_"]:
            first, second, third = at_corners(planes)
            return barycentric[0] * first + barycentric[1] * second + barycentric[2] * third

        material = self.face_material[triangle]

        def constant(planes: Planes) -> Float[Array, "3"]:
            return jnp.stack([plane[material] for plane in planes])

        albedo = constant(self.base_colour)
        if self.colours is not None:
            albedo = albedo * blend(self.colours)
        if self.texturing is not None:
            look_up = self.texturing
            footprint = extent * look_up.texels_per_metre[triangle]
            albedo = albedo * look_up.look_up(material, blend(look_up.uv), footprint)
        own = jnp.zeros_like(albedo) if self.emission is None else constant(self.emission)
        first, second, third = at_corners(self.positions)
        point = barycentric[0] * first + barycentric[1] * second + barycentric[2] * third
        to_eye = unit(self.eye - point, otherwise=jnp.asarray([0.0, 0.0, 1.0], dtype=point.dtype))
        if self.normals is None:
            return SurfacePoint(own + albedo, point, None, to_eye, material)

        flat = jnp.cross(second - first, third - first)
        normal = unit(blend(self.normals), otherwise=to_eye)
        # The flat side decides, not the shading normal itself: near the outline of a smooth object
        # that one points a little away from the eye, and turning it there would flash.
        agrees = jnp.where(dot(normal, flat) < 0.0, -1.0, 1.0)
        faces_eye = jnp.where(dot(to_eye, flat) < 0.0, -1.0, 1.0)
        normal = normal * agrees * faces_eye

        diffuse = self.ambient
        for light in self.lights:
            to_light, arriving = light.arriving(point)
            diffuse = diffuse + arriving * jnp.maximum(dot(normal, to_light), 0.0)
        return SurfacePoint(own + albedo * diffuse, point, normal, to_eye, material)
