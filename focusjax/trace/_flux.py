"""How fast a picture changes as its lens moves: light that enters and leaves pixels and opening.

The sum of `_motion`, with the integrals as means over traced rays: some through points of every border
between two pixels, and some through the rim of the opening, each beside one from within the opening, on
the way from its middle to there. Radiances are taken relative to that of the pixel, and where the rim
brings what the opening brings nothing changes, so that noise is left only where the picture is about to
change. What leaves a pixel enters its neighbour by the same rays, so that noise cancels over regions, too.
"""

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._motion import LEAST_PLACE, divergence, film_flow, gain, hole_flow, rim_flow
from focusjax.trace._radiances import TracedScene, radiances
from focusjax.trace._samples import chances, spread_points, tile_edge, z_order

_Values = TypeVar("_Values", Array, tuple[Array, Array])
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
        picture: radiance [p, 3] of each pixel, by other rays; only what differs from it makes noise.
        rays: which rays.
    """

    scene: TracedScene
    lens: AbstractLens
    least: Float[Array, " p"]
    largest: Float[Array, " p"]
    picture: Float[Array, "p 3"]
    rays: Rays

    @property
    def tile(self) -> int:
        """Edge in pixels of the tile of ray starts."""
        return tile_edge(self.rays.number)

    def along(
        self, pixel: Int[Array, " b"], tile: Int[Array, " b"], film: Float[Array, "b s 2"], pupil: Array
    ) -> Float[Array, "b s 3"]:
        """Radiances along rays whose film points lie in or on the borders of the given pixels."""
        chance = None
        if self.scene.volume.opacity is not None:
            table = jnp.asarray(chances(self.tile, self.rays.number, self.rays.seed))
            chance = jnp.tile(table[tile], (1, film.shape[1] // self.rays.number))
        ends = self.least[pixel], self.largest[pixel]
        return radiances(self.scene, self.lens, film, pupil, chance, *ends, depth=self.scene.volume.layers)[0]


def picture_flow(still: Still, moved: AbstractLens) -> Float[Array, "h w 3"]:
    """The picture's change from the lens that is traced to `moved`, to first order.

    `moved` is to be equal, so that this is 0, and to be differentiated by.
    """

    def flow(lens: AbstractLens, moved: AbstractLens) -> Float[Array, "h w 3"]:
        return _flow(dataclasses.replace(still, lens=lens), moved)

    return in_colour(flow, still.lens, moved)


def _flow(still: Still, moved: AbstractLens) -> Float[Array, "h w 3"]:
    """As `picture_flow`, for lenses that treat all colours alike."""
    camera = still.scene.camera
    before, after = _through_borders(still, moved)
    width, height = camera.width, camera.height
    upright = (width + 1) * height

    def grids(flux: Float[Array, "n 3"]) -> tuple[Array, Array]:
        return flux[:upright].reshape(height, width + 1, 3), flux[upright:].reshape(height + 1, width, 3)

    (right, bottom), (left, top) = grids(before), grids(after)
    film = right[:, 1:] - left[:, :-1] + bottom[1:] - top[:-1]
    return film + _through_rim(still, moved).reshape(height, width, 3)


def in_blocks(
    function: Callable[[Int[Array, " b"]], _Values], column: np.ndarray, row: np.ndarray, size: int
) -> _Values:
    """A function of site numbers, for all sites at the given places, `size` at a time, in bounded memory.

    Sites of one block lie together, so that rays read few places of the layers. When differentiated in
    reverse each block is worked out again instead of being remembered.
    """
    count = len(column)
    size = min(size, count)
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
    points = np.stack([spread_points(3, edge, rays.number, rays.seed + k).astype(real) for k in (1, 2)])
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
        pupil = jax.vmap(jax.vmap(still.lens.opening().at))(place)
        brought = still.along(after, tile, film, pupil)

        def crossing(side: float, pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
            def one(film: Array, place: Array, normal: Array) -> Array:
                return film_flow(still.lens, moved, camera, film + side * normal, place) @ normal

            flow = jax.vmap(jax.vmap(one, in_axes=(0, 0, None)))(film, place, normal)
            return jnp.einsum("bs,bsc->bc", flow, brought - still.picture[pixel][:, None]) / rays.number

        return crossing(-_ASIDE, before), crossing(_ASIDE, after)

    return in_blocks(block, column, row, max(1, rays.at_once // rays.number))


def _through_rim(still: Still, moved: AbstractLens) -> Float[Array, "p 3"]:
    """What each pixel gains at the rim of the opening and within it."""
    camera, lens, rays, edge = still.scene.camera, still.lens, still.rays, still.tile
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    points = spread_points(4, edge, rays.number, rays.seed + 3).astype(still.least.dtype)
    points = jnp.asarray(np.maximum(points, LEAST_PLACE))
    # Where the opening ends, and what flows out of it there.
    edges = [(1.0, rim_flow)] + ([] if lens.opening().hole() is None else [(0.0, hole_flow)])

    def block(pixel: Int[Array, " b"]) -> Float[Array, "b 3"]:
        column, row = pixel % camera.width, pixel // camera.width
        tile = row % edge * edge + column % edge
        film = jnp.stack([column, row], axis=-1)[:, None] + points[tile][..., :2]
        within = points[tile][..., 2:]
        places = jnp.concatenate([within, *(within.at[..., 0].set(s) for s, _ in edges)], axis=1)
        pupil = jax.vmap(jax.vmap(lens.opening().at))(places)
        films = jnp.concatenate([film] * (1 + len(edges)), axis=1)
        brought = still.along(pixel, tile, films, pupil)

        def over(function: Callable[..., Array], where: Array) -> Float[Array, "b s"]:
            return jax.vmap(jax.vmap(lambda p, s: function(lens, moved, camera, p, s)))(film, where)

        lost, gained = over(divergence, within), over(gain, within)
        through = [over(flow, within[..., 1]) for _, flow in edges]
        flow = jnp.concatenate([-lost, *through], axis=1)
        changed = jnp.einsum("bs,bsc->bc", flow, brought - still.picture[pixel][:, None])
        return (changed + jnp.einsum("bs,bsc->bc", gained, brought[:, : rays.number])) / rays.number

    return in_blocks(block, column, row, max(1, rays.at_once // ((1 + len(edges)) * rays.number)))
