"""How much of a surface is there: panes that let light through, pictures that cut leaves out."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.scene._atlas import Atlas, pyramid

_NO_CUTOFF = -1.0


class Opacity(eqx.Module):
    """The share of a small patch of surface that is there, 0 to 1; the rest shows what is behind it.

    It is the material's factor times the vertices' opacity times the mean of the opacity picture over the
    patch. Where the picture cuts the surface out, at the cutoff c, it is the share of the patch where the
    picture holds at least c. A patch smaller than a texel sees the interpolated picture as a plane of
    value p and slope g over its width f, so that share is

        min(max((p - c) / (f (|g_x| + |g_y|)) + 1/2, 0), 1);

    a larger one sees the mean of the texels' own yes and no, which keeps far leaves as dense as near ones
    (cutting an averaged picture would thin them out; Castano 2010). Both are exact for straight outlines
    along the texels. It says nothing about colour; light that is reflected counts as much as light the
    surface gives off.

    Attributes:
        faces: vertex numbers of the faces' corners, three times [t].
        face_material: material number of each face [t].
        factor: of each material [m].
        vertex: of each vertex [v], or None.
        pictures: what textured materials add, or None.
    """

    faces: tuple[Int[Array, "_"], ...]
    face_material: Int[Array, "_"]
    factor: Float[Array, "_"]
    vertex: Float[Array, "_"] | None
    pictures: "OpacityPictures | None"

    def __call__(
        self, triangle: Int[Array, ""], barycentric: Float[Array, "3"], extent: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Opacity around one point.

        Args:
            triangle: face number.
            barycentric: weights [3] of that face's vertices.
            extent: width of the patch in metres.
        """
        corners = [corner[triangle] for corner in self.faces]

        def blend(plane: Float[Array, "_"]) -> Float[Array, ""]:
            first, second, third = (plane[corner] for corner in corners)
            return barycentric[0] * first + barycentric[1] * second + barycentric[2] * third

        material = self.face_material[triangle]
        share = self.factor[material]
        if self.vertex is not None:
            share = share * blend(self.vertex)
        if self.pictures is not None:
            uv = jnp.stack([blend(plane) for plane in self.pictures.uv])
            footprint = extent * self.pictures.texels_per_metre[triangle]
            share = share * self.pictures(material, uv, footprint)
        return share


class OpacityPictures(eqx.Module):
    """Opacity pictures, and where triangles lie in them.

    Attributes:
        atlas: one channel; texture 0 is opaque, for materials without one.
        texture: picture of each material [m].
        cutoff: of each material [m]; negative where its picture blends.
        uv: texture coordinates of the vertices, u and v each [v].
        texels_per_metre: level-0 texels along a metre of each face [t].
    """

    atlas: Atlas
    texture: Int[Array, "_"]
    cutoff: Float[Array, "_"]
    uv: tuple[Float[Array, "_"], ...]
    texels_per_metre: Float[Array, "_"]

    def __call__(
        self, material: Int[Array, ""], uv: Float[Array, "2"], footprint: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Opacity of `material` around `uv` over a square of `footprint` texels."""
        texture, cutoff = self.texture[material], self.cutoff[material]
        number, coarser, share = self.atlas.levels(texture, footprint)
        (near,), (slope,) = self.atlas.bilinear(number, uv)
        (far,), _ = self.atlas.bilinear(coarser, uv)
        width = jnp.maximum(footprint * jnp.abs(slope).sum(), 1e-6)
        cut = jnp.clip((near - cutoff) / width + 0.5, 0.0, 1.0)
        # Only level 0 holds the picture itself; in the others the cut is made already.
        finest = (number == self.atlas.first_level[texture]) & (cutoff > _NO_CUTOFF)
        near = jnp.where(finest, cut, near)
        return near + share * (far - near)


def opacity_levels(
    picture: Float[np.ndarray, "h w"], cutoff: float | None
) -> list[Float[np.ndarray, "_ _ 1"]]:
    """Level 0 as it is, and the means of it or, with a `cutoff`, of where it is reached."""
    if cutoff is None:
        return pyramid(picture[..., None])
    reached = (picture >= cutoff).astype(np.float32)[..., None]
    return [picture[..., None], *pyramid(reached)[1:]]


def cutoff_code(cutoff: float | None) -> float:
    """How `OpacityPictures` holds a cutoff."""
    return _NO_CUTOFF if cutoff is None else cutoff
