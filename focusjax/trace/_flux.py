"""How fast a picture changes as its lens moves: light that enters and leaves pixels and opening.

The sum of `_motion`, with the integrals as means over traced rays: some through points of every border
between two pixels, and some through the rim of the opening, each beside one from the middle of the opening to
the same place of the rim. Where they bring the same nothing changes, so that noise is left only where the
picture is about to change. What leaves a pixel enters its neighbour: over a region the borders within it
cancel, ray by ray.
"""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax.lens import AbstractLens
from focusjax.trace._motion import LEAST_PLACE, film_flow, opening_point, rim_flow, source
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


def picture_flow(
    scene: TracedScene,
    lens: AbstractLens,
    moved: AbstractLens,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    rays: Rays,
) -> Float[Array, "h w 3"]:
    """The picture's change from `lens` to `moved`, to first order: 0, with the right derivatives by `moved`.

    Args:
        scene: what rays go through.
        lens: whose rays are traced.
        moved: equal to `lens`, and to be differentiated by.
        least: least disparity that the rays of each pixel can meet, row-major.
        largest: largest one.
        rays: which rays.
    """
    camera = scene.camera
    before, after = _through_borders(scene, lens, moved, least, largest, rays)
    width, height = camera.width, camera.height
    upright = (width + 1) * height

    def grids(flux: Float[Array, "n 3"]) -> tuple[Array, Array]:
        return flux[:upright].reshape(height, width + 1, 3), flux[upright:].reshape(height + 1, width, 3)

    (right, bottom), (left, top) = grids(before), grids(after)
    film = right[:, 1:] - left[:, :-1] + bottom[1:] - top[:-1]
    return film + _through_rim(scene, lens, moved, least, largest, rays).reshape(height, width, 3)


def in_blocks(
    function: Callable[[Int[Array, " b"]], _Values], column: np.ndarray, row: np.ndarray, size: int
) -> _Values:
    """A function of site numbers, for all sites at the given places, `size` at a time, in bounded memory.

    Sites of one block lie together, so that rays read few places of the layers. When differentiated in
    reverse each block is worked out again instead of being remembered.
    """
    count = len(column)
    size = min(size, count)
    order = np.argsort(z_order(column, row), kind="stable").astype(np.int32)
    blocks = order[np.minimum(np.arange(-(-count // size) * size), count - 1)].reshape(-1, size)
    values = jax.lax.map(jax.checkpoint(function), jnp.asarray(blocks))
    place = np.argsort(order, kind="stable")
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[place], values)


def _through_borders(
    scene: TracedScene,
    lens: AbstractLens,
    moved: AbstractLens,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    rays: Rays,
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """What crosses every border towards larger x or y, as the pixel before it and the one after it tell.

    Upright borders [h, w + 1] first, then level ones [h + 1, w].
    """
    camera, real = scene.camera, least.dtype
    rows, columns = zip(
        np.divmod(np.arange((camera.width + 1) * camera.height), camera.width + 1),
        np.divmod(np.arange(camera.width * (camera.height + 1)), camera.width),
        strict=True,
    )
    level = np.repeat([0, 1], [len(row) for row in rows])
    row, column = np.concatenate(rows), np.concatenate(columns)
    edge = tile_edge(rays.number)
    points = [spread_points(3, edge, rays.number, rays.seed + k).astype(real) for k in (1, 2)]
    along = jnp.asarray(np.concatenate([p[..., 0] for p in points]))
    places = jnp.asarray(np.concatenate([np.maximum(p[..., 1:], LEAST_PLACE) for p in points]))
    chance = _chances(scene, edge, rays)
    at = [jnp.asarray(a, dtype=jnp.int32) for a in (column, row, level)]

    def block(sites: Int[Array, " b"]) -> tuple[Array, Array]:
        column, row, level = (a[sites] for a in at)
        pixel = jnp.minimum(row, camera.height - 1) * camera.width + jnp.minimum(column, camera.width - 1)
        tile = row % edge * edge + column % edge
        normal = jax.nn.one_hot(level, 2, dtype=real)
        t = along[level * edge**2 + tile]
        film = jnp.stack([column, row], axis=-1)[:, None] + (1.0 - normal)[:, None] * t[..., None]
        place = places[level * edge**2 + tile]
        pupil = jax.vmap(jax.vmap(lambda s: opening_point(lens, s)))(place)
        options = None if chance is None else chance[tile]
        brought = radiances(
            scene, lens, film, pupil, options, least[pixel], largest[pixel], depth=scene.volume.layers
        )

        def crossing(side: float) -> Array:
            def one(film: Array, place: Array, normal: Array) -> Array:
                return film_flow(lens, moved, camera, film + side * normal, place) @ normal

            flow = jax.vmap(jax.vmap(one, in_axes=(0, 0, None)))(film, place, normal)
            return jnp.einsum("bs,bsc->bc", flow, jax.lax.stop_gradient(brought)) / rays.number

        return crossing(-_ASIDE), crossing(_ASIDE)

    return in_blocks(block, column, row, max(1, rays.at_once // rays.number))


def _through_rim(
    scene: TracedScene,
    lens: AbstractLens,
    moved: AbstractLens,
    least: Float[Array, " p"],
    largest: Float[Array, " p"],
    rays: Rays,
) -> Float[Array, "p 3"]:
    """What each pixel gains at the rim of the opening and within it."""
    camera, real = scene.camera, least.dtype
    row, column = np.divmod(np.arange(camera.width * camera.height), camera.width)
    edge = tile_edge(rays.number)
    points = np.maximum(spread_points(4, edge, rays.number, rays.seed + 3).astype(real), LEAST_PLACE)
    offsets, places = jnp.asarray(points[..., :2]), jnp.asarray(points[..., 2:])
    chance = _chances(scene, edge, rays)

    def block(pixel: Int[Array, " b"]) -> Array:
        column, row = pixel % camera.width, pixel // camera.width
        tile = row % edge * edge + column % edge
        film = jnp.stack([column, row], axis=-1)[:, None] + offsets[tile]
        inner, turn = places[tile], places[tile][..., 1]
        place = jnp.concatenate([inner, inner.at[..., 0].set(1.0)], axis=1)
        films = jnp.concatenate([film, film], axis=1)
        pupil = jax.vmap(jax.vmap(lambda s: opening_point(lens, s)))(place)
        options = None if chance is None else jnp.tile(chance[tile], (1, 2))
        brought = radiances(
            scene, lens, films, pupil, options, least[pixel], largest[pixel], depth=scene.volume.layers
        )
        gathering = jax.vmap(jax.vmap(lambda p, s: source(lens, moved, camera, p, s)))(film, inner)
        entering = jax.vmap(jax.vmap(lambda p, t: rim_flow(lens, moved, camera, p, t)))(film, turn)
        flow = jnp.concatenate([gathering, entering], axis=1)
        return jnp.einsum("bs,bsc->bc", flow, jax.lax.stop_gradient(brought)) / rays.number

    return in_blocks(block, column, row, max(1, rays.at_once // (2 * rays.number)))


def _chances(scene: TracedScene, edge: int, rays: Rays) -> UInt[Array, "t s"] | None:
    if scene.volume.opacity is None:
        return None
    return jnp.asarray(chances(edge, rays.number, rays.seed))
