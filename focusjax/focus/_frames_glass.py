"""The blur of a real lens at the places of wishes, over all frames of a shot."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax.focus._glass_blur import GlassBlur, Sensed, sensed
from focusjax.focus._glass_search import rows_and_references
from focusjax.focus._image_points import SAME, ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, SettableLens, pupil_radius, settable

_ROWS = 8
"""Of a frame, looked at together."""


class FramesGlass(eqx.Module):
    """The glass of every frame with its rays aimed about one focus each. Arrays have a leading axis t.

    Attributes:
        aimed: the glass.
        camera: that it is made for.
        widest: radius in metres of its entrance pupil when it is open.
    """

    aimed: SettableLens
    camera: Camera
    widest: Float[Array, "t"]

    def look(self, points: ImagePoints, settings: Float[Array, "t 2"], wanted: Bool[Array, "t m"]) -> Sensed:
        """The blur of rows and, after them, of their references; 1 px of some that are not `wanted`.

        Rows are looked at by eights, those that are wanted first, and of repeated ones the first: what pads
        frames, and wishes that do not count in a frame, cost little.

        Args:
            points: of every frame.
            settings: focus disparity in 1/m and aperture radius in metres.
            wanted: rows, and references, to look at.
        """
        count, rows = wanted.shape
        blocks = -(-rows // _ROWS)
        xy, disparity = jax.vmap(rows_and_references)(points)
        place = jnp.concatenate([xy, disparity[..., None]], axis=-1)
        repeats = jnp.all(place[:, 1:] == place[:, :-1], axis=-1)
        own = jnp.concatenate(
            [jnp.zeros((count, 1), dtype=int), jnp.where(repeats, 0, jnp.arange(1, rows)[None])], 1
        )
        source = jax.lax.cummax(own, axis=1)
        wanted = jax.vmap(lambda at, each: jnp.zeros_like(each).at[at].max(each))(source, wanted)
        order = jnp.argsort(~wanted, axis=1)
        used = jnp.arange(blocks)[None] * _ROWS < jnp.sum(wanted, axis=1)[:, None]
        units = jnp.argsort(~used.ravel())

        def one(number: Array, found: Sensed) -> Sensed:
            frame, block = units[number] // blocks, units[number] % blocks
            at = order[frame, jnp.minimum(block * _ROWS + jnp.arange(_ROWS), rows - 1)]
            glass, camera, widest = jax.tree.map(
                lambda leaf: leaf[frame], (self.aimed, self.camera, self.widest)
            )
            new = sensed(glass, camera, widest, xy[frame, at], disparity[frame, at], settings[frame][None])
            return jax.tree.map(lambda whole, part: whole.at[frame, at].set(part[0]), found, new)

        none = jnp.zeros((count, rows), dtype=disparity.dtype)
        steep = jnp.zeros((count, rows, 2), dtype=disparity.dtype)
        # A blur of 0 has no slope.
        blank = Sensed(GlassBlur(none, none + 1.0, none), GlassBlur(steep, steep, steep))
        found = jax.lax.fori_loop(0, jnp.sum(used), one, blank)
        return jax.tree.map(lambda leaf: jax.vmap(lambda row, at: row[at])(leaf, source), found)


def frames_glass(glass: AbstractLens, camera: Camera, focus_disparity: Float[Array, "t"]) -> FramesGlass:
    """The glass with its rays aimed for a focus in 1/m; everything has a leading axis t."""
    aimed = eqx.filter_vmap(settable)(glass, camera, focus_disparity)
    return FramesGlass(aimed, camera, frames_radius(glass))


def frames_radius(glass: AbstractLens) -> Float[Array, "t"]:
    """Radius in metres of every frame's entrance pupil, as the glass is opened."""
    return eqx.filter_vmap(pupil_radius)(glass)


def with_references(points: ImagePoints, own: Bool[Array, "t n"]) -> Bool[Array, "t m"]:
    """Some rows, and the references that these are compared with."""
    if points.reference is None:
        return own
    return jnp.concatenate([own, own & (points.relation == SAME)], axis=1)
