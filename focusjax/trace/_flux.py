"""How fast a picture changes as its lens moves: light that enters and leaves pixels and opening.

The sum of `_motion`, with the integrals as means over traced rays: some through points of every border
between two pixels, some through the rim of the opening, and a few from within it. Radiances are taken
relative to that of the pixel, and where the rim brings what the opening brings nothing changes, so that
noise is left only where the picture is about to change. What leaves a pixel enters its neighbour by the
same rays, so that noise cancels over regions, too: what is left is that of the borders around one, whose
rays are spread evenly along whole lines of borders.
"""

import math
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.lens import AbstractLens
from focusjax.trace._motion import LEAST_PLACE, divergence, film_flow, gain, opening_point, rim_flow
from focusjax.trace._radiances import TracedScene, radiances
from focusjax.trace._samples import chances, line_points, spread_points, tile_edge, z_order

_Values = TypeVar("_Values", Array, tuple[Array, Array])
_WITHIN = 4
"""Rays of a border or rim for each from within the opening, of which there are as many at least."""
_ASIDE = 2.0**-8
"""Pixels beside a border at which the flow is taken: that of a lens may differ from pixel to pixel."""


class Rays(eqx.Module):
    """What decides which rays a picture is made of.

    Attributes:
        number: rays per pixel, and per border (static).
        seed: chooses them (static).
        at_once: rays traced at a time (static).
    """

    number: int = eqx.field(static=True)
    seed: int = eqx.field(static=True)
    at_once: int = eqx.field(static=True)


class Still(eqx.Module):
    """What is traced, none of which moves.

    Attributes:
        scene: what rays go through.
        lens: where they come from.
        least: least disparity [p] that the rays of each pixel can meet, row-major.
        largest: largest one [p].
        picture: radiance [p, 3] of each pixel; only what differs from it makes noise.
        beside: that of the picture's first rays, whose film points [t, s, 2] the rim's rays share.
        film: those points in their pixel, for each of a tile.
        rays: which rays.
    """

    scene: TracedScene
    lens: AbstractLens
    least: Float[Array, " p"]
    largest: Float[Array, " p"]
    picture: Float[Array, "p 3"]
    beside: Float[Array, "p 3"]
    film: Float[Array, "t s 2"]
    rays: Rays

    @property
    def tile(self) -> int:
        """Edge in pixels of the tile of ray starts."""
        return tile_edge(self.rays.number)

    def along(
        self,
        pixel: Int[Array, " b"],
        tile: Int[Array, " b"],
        edge: int,
        film: Float[Array, "b s 2"],
        pupil: Array,
    ) -> Float[Array, "b s 3"]:
        """Radiances along rays whose film points lie in or on the borders of the given pixels.

        `tile` is each pixel's place in tiles of a given edge.
        """
        chance = None
        if self.scene.volume.opacity is not None:
            chance = jnp.asarray(chances(edge, film.shape[1], self.rays.seed))[tile]
        ends = self.least[pixel], self.largest[pixel]
        return radiances(self.scene, self.lens, film, pupil, chance, *ends, depth=self.scene.volume.layers)[0]


def picture_flow(still: Still, moved: AbstractLens) -> Float[Array, "h w 3"]:
    """The picture's change from the lens that is traced to `moved`, to first order.

    `moved` is to be equal, so that this is 0, and to be differentiated by.
    """
    camera = still.scene.camera
    before, after = _through_borders(still, moved)
    width, height = camera.width, camera.height
    upright = (width + 1) * height

    def grids(flux: Float[Array, "n 3"]) -> tuple[Array, Array]:
        return flux[:upright].reshape(height, width + 1, 3), flux[upright:].reshape(height + 1, width, 3)

    (right, bottom), (left, top) = grids(before), grids(after)
    film = right[:, 1:] - left[:, :-1] + bottom[1:] - top[:-1]
    opening = _through_rim(still, moved) + _within_opening(still, moved)
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
    """What crosses every border towards larger x or y, as the pixel before it and the one after it tell.

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
    upright, level = (line_points(edge, rays.number, rays.seed + k).astype(real) for k in (1, 2))
    points = np.stack([upright.swapaxes(0, 1), level]).reshape(2, edge**2, rays.number, 3)
    along = jnp.asarray(points[..., 0])
    places = jnp.asarray(np.maximum(points[..., 1:], LEAST_PLACE))
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
        pupil = jax.vmap(jax.vmap(lambda place: opening_point(still.lens, place)))(place)
        brought = still.along(after, tile, edge, film, pupil)

        def crossing(side: float, pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
            def one(film: Array, place: Array, normal: Array) -> Array:
                return film_flow(still.lens, moved, camera, film + side * normal, place) @ normal

            flow = jax.vmap(jax.vmap(one, in_axes=(0, 0, None)))(film, place, normal)
            return jnp.einsum("bs,bsc->bc", flow, brought - still.picture[pixel][:, None]) / rays.number

        return crossing(-_ASIDE, before), crossing(_ASIDE, after)

    return in_blocks(block, column, row, max(1, rays.at_once // rays.number))


def _through_rim(still: Still, moved: AbstractLens) -> Float[Array, "p 3"]:
    """What each pixel gains at the rim of the opening.

    Where things are in focus, or the opening is small, rays of one film point bring much the same: there the
    opening's mean is that of rays with the rim's own film points. Elsewhere that of all rays is better.
    """
    camera, lens, seed = still.scene.camera, still.lens, still.rays.seed
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    number, edge = still.film.shape[1], math.isqrt(still.film.shape[0])
    turns = jnp.asarray(spread_points(1, edge, number, seed + 3)[..., 0].astype(still.least.dtype))

    def sharp(pixel: Int[Array, ""]) -> Float[Array, ""]:
        film = jnp.stack([pixel % camera.width, pixel // camera.width]) + 0.5
        ends = jnp.stack([still.least[pixel], still.largest[pixel]])
        radius = jax.vmap(lambda w: lens.footprint(camera, film, w)[1])(ends).max()
        return 1.0 / (1.0 + radius**2)

    def block(pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
        column, row = pixel % camera.width, pixel // camera.width
        tile = row % edge * edge + column % edge
        film, turn = jnp.stack([column, row], axis=-1)[:, None] + still.film[tile], turns[tile]
        brought = still.along(pixel, tile, edge, film, jax.vmap(jax.vmap(lens.rim_point))(turn))
        own, beside = still.picture[pixel], still.beside[pixel]
        mean = own + jax.vmap(sharp)(pixel)[:, None] * (beside - own)
        flow = jax.vmap(jax.vmap(lambda p, t: rim_flow(lens, moved, camera, p, t)))(film, turn)
        return jnp.einsum("bs,bsc->bc", flow, brought - mean[:, None]) / number

    return in_blocks(block, column, row, max(1, still.rays.at_once // number))


def _within_opening(still: Still, moved: AbstractLens) -> Float[Array, "p 3"]:
    """What each pixel gains where rays move apart or carry more light.

    The picture is the mean of what rays bring, so that only a rate that differs from ray to ray needs rays of
    its own, and few of them: no such rate is large.
    """
    camera, lens, edge = still.scene.camera, still.lens, still.tile
    number = max(_WITHIN, still.rays.number // _WITHIN)
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    points = spread_points(4, edge, number, still.rays.seed + 4).astype(still.least.dtype)
    points = jnp.asarray(np.maximum(points, LEAST_PLACE))

    def block(pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
        column, row = pixel % camera.width, pixel // camera.width
        tile = row % edge * edge + column % edge
        film = jnp.stack([column, row], axis=-1)[:, None] + points[tile][..., :2]
        place = points[tile][..., 2:]
        pupil = jax.vmap(jax.vmap(lambda place: opening_point(lens, place)))(place)
        brought = still.along(pixel, tile, edge, film, pupil)
        own = still.picture[pixel]

        def over(function: Callable[..., Array]) -> Float[Array, "b s"]:
            return jax.vmap(jax.vmap(lambda p, s: function(lens, moved, camera, p, s)))(film, place)

        gained = over(gain)
        rate = gained - over(divergence)
        uneven = rate - rate.mean(axis=1, keepdims=True)
        changed = jnp.einsum("bs,bsc->bc", uneven, brought - own[:, None]) / number
        return changed + gained.mean(axis=1, keepdims=True) * own

    return in_blocks(block, column, row, max(1, still.rays.at_once // number))
