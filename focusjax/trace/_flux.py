"""How fast a picture changes as its lens moves: light that enters and leaves pixels and opening.

The sum of `_motion`, with the integrals as means over traced rays: some through points of every border
between two pixels, as many through the rim of the opening and from within it, none of them the picture's own.
Radiances are taken relative to that of the pixel, and where the rim sees the same radiance as the opening
nothing changes, so that noise is left only where the picture is about to change. What leaves a pixel enters
its neighbour by the same rays, so that noise cancels over regions, too: what is left is that of the borders
around one, whose rays are spread evenly along whole lines of borders.
"""

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._motion import (
    LEAST_PLACE,
    divergence,
    film_flow,
    gain,
    hole_flow,
    light,
    rim_flow,
    spreading,
)
from focusjax.trace._radiances import TracedScene, seen_along
from focusjax.trace._samples import Starts, line_points, pixel_chances, pixel_points, tile_edge, z_order
from focusjax.trace._sobol import stirred

_Values = TypeVar("_Values", Array, tuple[Array, Array])
_WITHIN = 4
"""Rays of a border or rim for each from within the opening, of which there are as many at least."""
_ASIDE = 2.0**-8
"""Pixels beside a border at which the flow is taken: that of a lens may differ from pixel to pixel."""
_MIDWAY = 0.5, 0.37
"""A place of the opening that stands for all, on no corner of blades."""


class Rays(eqx.Module):
    """What decides which rays a picture is made of.

    Attributes:
        number: rays per pixel, and per border (static).
        seed: chooses them.
        at_once: rays traced at a time (static).
    """

    number: int = eqx.field(static=True)
    seed: UInt[Array, ""]
    at_once: int = eqx.field(static=True)


class Still(eqx.Module):
    """What is traced, none of which moves.

    Attributes:
        scene: what rays go through.
        lens: where they come from.
        least: least disparity [p] that the rays of each pixel can meet, row-major.
        largest: largest one [p].
        radiance: mean [p, 3] along rays through the opening that start as those through the rim do. Only what
            differs from it makes noise.
        film: where these rays start [t, s, 2] in their pixel, for each of a tile.
        rays: which rays derivatives are made of.
    """

    scene: TracedScene
    lens: AbstractLens
    least: Float[Array, " p"]
    largest: Float[Array, " p"]
    radiance: Float[Array, "p 3"]
    film: Float[Array, "t s 2"]
    rays: Rays

    @property
    def tile(self) -> int:
        """Edge in pixels of the tile of ray starts."""
        return tile_edge(self.rays.number)

    def chance(self, tile: Int[Array, " b"], edge: int, number: int) -> UInt[Array, "b s"] | None:
        """What decides where so many rays of pixels at places of a tile stop, if anything has to."""
        if self.scene.volume.opacity is None:
            return None
        return pixel_chances(edge, number, self.rays.seed)[tile]

    def along(
        self,
        pixel: Int[Array, " b"],
        film: Float[Array, "b s 2"],
        pupil: Float[Array, "b s 2"],
        chance: UInt[Array, "b s"] | None,
    ) -> Float[Array, "b s 3"]:
        """Radiances along rays whose film points lie in or on the borders of the given pixels."""
        shape = film.shape[:2]
        flat = [points[..., axis].reshape(-1) for points in (film, pupil) for axis in range(2)]
        starts = Starts(*flat, chance=None if chance is None else chance.reshape(-1))
        ends = (jnp.repeat(end[pixel], shape[1]) for end in (self.least, self.largest))
        seen = seen_along(self.scene, self.lens, starts, *ends)
        return jnp.stack(seen.radiance, axis=-1).reshape(*shape, 3)


def picture_flow(still: Still, moved: AbstractLens) -> Float[Array, "h w 3"]:
    """The picture's change from the lens that is traced to `moved`, to first order.

    `moved` is to be equal, so that this is 0, and to be differentiated by.
    """
    evenly = _evenly(still, moved)

    def flow(lens: AbstractLens, moved: AbstractLens) -> Float[Array, "h w 3"]:
        return _flow(dataclasses.replace(still, lens=lens), moved, evenly)

    return in_colour(flow, still.lens, moved)


def _evenly(still: Still, moved: AbstractLens) -> Float[Array, " p"]:
    """How fast rays move apart midway in each pixel and in the opening, by all colours."""
    camera, place = still.scene.camera, jnp.asarray(_MIDWAY, dtype=still.least.dtype)
    row, column = jnp.divmod(jnp.arange(camera.width * camera.height), camera.width)
    middle = jnp.stack([column, row], axis=-1) + jnp.asarray(0.5, dtype=place.dtype)
    return jax.vmap(lambda film: spreading(still.lens, moved, camera, film, place))(middle)


def _flow(still: Still, moved: AbstractLens, evenly: Float[Array, " p"]) -> Float[Array, "h w 3"]:
    """As `picture_flow`, for lenses that treat all colours alike."""
    camera = still.scene.camera
    before, after = _through_borders(still, moved)
    width, height = camera.width, camera.height
    upright = (width + 1) * height

    def grids(flux: Float[Array, "n 3"]) -> tuple[Array, Array]:
        return flux[:upright].reshape(height, width + 1, 3), flux[upright:].reshape(height + 1, width, 3)

    (right, bottom), (left, top) = grids(before), grids(after)
    film = right[:, 1:] - left[:, :-1] + bottom[1:] - top[:-1]
    opening = _through_rim(still, moved) + _within_opening(still, moved, evenly)
    return film + opening.reshape(height, width, 3)


def in_blocks(
    function: Callable[[Int[Array, " b"]], _Values], column: np.ndarray, row: np.ndarray, size: int
) -> _Values:
    """A function of site numbers, for all sites at the given places, `size` at a time, in bounded memory.

    Sites of one block lie together, so that rays read few places of the layers. When differentiated in
    reverse each block is worked out again instead of being remembered.
    """
    count = len(column)
    # All of one size, so that filling up the last one adds little.
    size = -(-count // -(-count // size))
    order = np.argsort(z_order(column, row), kind="stable")
    blocks = order[np.minimum(np.arange(-(-count // size) * size), count - 1)].reshape(-1, size)
    values = jax.lax.map(jax.checkpoint(function), jnp.asarray(blocks))
    place = np.argsort(order, kind="stable")
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[place], values)


def _through_borders(still: Still, moved: AbstractLens) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """What crosses every border towards larger x or y, for the pixel before it and for the one after it.

    Upright borders [h, w + 1] first, then level ones [h + 1, w].
    """
    camera, real, rays, edge = still.scene.camera, still.least.dtype, still.rays, still.tile
    rows, columns = zip(
        np.divmod(np.arange((camera.width + 1) * camera.height), camera.width + 1),
        np.divmod(np.arange(camera.width * (camera.height + 1)), camera.width),
        strict=True,
    )
    axis = np.repeat([0, 1], [len(row) for row in rows])
    row, column = np.concatenate(rows), np.concatenate(columns)
    upright, level = (line_points(edge, rays.number, stirred(rays.seed, k)) for k in (1, 2))
    points = jnp.stack([upright.swapaxes(0, 1), level]).reshape(2, edge**2, rays.number, 3)
    along, places = points[..., 0], jnp.maximum(points[..., 1:], LEAST_PLACE)
    sites = [jnp.asarray(a) for a in (column, row, axis)]

    def block(number: Int[Array, " b"]) -> tuple[Array, Array]:
        column, row, axis = (a[number] for a in sites)
        after = jnp.minimum(row, camera.height - 1) * camera.width + jnp.minimum(column, camera.width - 1)
        # Beyond the frame there is no pixel; what is worked out for it is not used.
        before = jnp.maximum(
            after - jnp.where(axis == 0, column < camera.width, (row < camera.height) * camera.width), 0
        )
        tile = row % edge * edge + column % edge
        normal = jax.nn.one_hot(axis, 2, dtype=real)
        place, on_border = places[axis, tile], along[axis, tile]
        film = jnp.stack([column, row], axis=-1)[:, None] + (1.0 - normal)[:, None] * on_border[..., None]
        pupil = jax.vmap(jax.vmap(still.lens.opening().at))(place)
        brought = still.along(after, film, pupil, still.chance(tile, edge, rays.number))

        def crossing(side: float, pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
            def one(film: Array, place: Array, normal: Array) -> Array:
                return film_flow(still.lens, moved, camera, film + side * normal, place) @ normal

            flow = jax.vmap(jax.vmap(one, in_axes=(0, 0, None)))(film, place, normal)
            differs = brought - still.radiance[pixel][:, None]
            return jnp.einsum("bs,bsc->bc", flow, differs) / rays.number

        return crossing(-_ASIDE, before), crossing(_ASIDE, after)

    return in_blocks(block, column, row, max(1, rays.at_once // rays.number))


def _through_rim(still: Still, moved: AbstractLens) -> Float[Array, "p 3"]:
    """What each pixel gains at the rim of the opening, and at that of a hole.

    Where things are in focus, or the opening is small, rays of one film point carry much the same: the mean
    within the opening is that of rays with the same film points, so that only their difference is noise.
    """
    camera, lens = still.scene.camera, still.lens
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    number, edge = still.rays.number, still.tile
    # A fifth dimension beside the four of rays within, so that turns and film points spread together.
    turns = pixel_points(5, edge, (number,), stirred(still.rays.seed, 3)[None])[4].reshape(-1, number)
    # Where the opening ends, and what flows out of it there.
    edges = [(1.0, rim_flow)] + ([] if lens.opening().hole() is None else [(0.0, hole_flow)])

    def block(pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
        column, row = pixel % camera.width, pixel // camera.width
        tile = row % edge * edge + column % edge
        film, turn = jnp.stack([column, row], axis=-1)[:, None] + still.film[tile], turns[tile]
        chance = still.chance(tile, edge, number)
        mean = still.radiance[pixel]
        total = jnp.zeros_like(mean)
        for end, through in edges:
            places = jnp.stack([jnp.full_like(turn, end), turn], axis=-1)
            brought = still.along(pixel, film, jax.vmap(jax.vmap(lens.opening().at))(places), chance)
            over = jax.vmap(jax.vmap(lambda p, t, through=through: through(lens, moved, camera, p, t)))
            total += jnp.einsum("bs,bsc->bc", over(film, turn), brought - mean[:, None]) / number
        return total

    return in_blocks(block, column, row, max(1, still.rays.at_once // number))


def _within_opening(still: Still, moved: AbstractLens, evenly: Float[Array, " p"]) -> Float[Array, "p 3"]:
    """What each pixel gains where rays move apart or carry more light.

    The picture is a mean over rays, so that only a rate that differs from ray to ray needs rays of
    its own, and few of them: what it differs by from the rate midway is not large.
    """
    camera, lens, edge = still.scene.camera, still.lens, still.tile
    number = max(_WITHIN, still.rays.number // _WITHIN)
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    points = jnp.stack(pixel_points(4, edge, (number,), stirred(still.rays.seed, 4)[None]), axis=-1)
    points = jnp.maximum(points.reshape(edge**2, number, 4), LEAST_PLACE)

    def block(pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
        column, row = pixel % camera.width, pixel // camera.width
        tile = row % edge * edge + column % edge
        film = jnp.stack([column, row], axis=-1)[:, None] + points[tile][..., :2]
        place = points[tile][..., 2:]
        pupil = jax.vmap(jax.vmap(lens.opening().at))(place)
        brought = still.along(pixel, film, pupil, still.chance(tile, edge, number))
        own = still.radiance[pixel]

        def over(function: Callable[..., Array]) -> Float[Array, "b s"]:
            return jax.vmap(jax.vmap(lambda p, s: function(lens, moved, camera, p, s)))(film, place)

        stands = jax.vmap(jax.vmap(lambda p, u: light(lens, camera, p, u)))(film, pupil)
        gained = over(gain)
        # Of what differs from the picture's radiance, its rays' light makes nothing on the average.
        uneven = gained - over(divergence) + evenly[pixel][:, None] * stands
        changed = jnp.einsum("bs,bsc->bc", uneven, brought - own[:, None]) / number
        return changed + gained.mean(axis=1, keepdims=True) * own

    return in_blocks(block, column, row, max(1, still.rays.at_once // number))
