"""Rays aimed at highlights: what small bright parts bring to each pixel that may see them.

For a film point p, the pupil point v and the place q where its ray passes the part's disparity are, for all
lenses here nearly and for most exactly, one affine map of each other. Places spread evenly over a box around
the part, instead of pupil points over the opening, change the mean over the opening into

    (1 / A) integral of W L dv = (1 / A) integral over the box of W L / |det dq/dv| dq,

with A the opening's area and L the excess radiance that the ray brings from that part; v beside the opening
count 0. Whether the ray gets there the same walk tells as for all others. What varies over the box is only
what hides the part, so a few rays do. The mean does not depend on where the box ends, as long as all rays
that meet the part pass it.
"""

import functools
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

from focusjax.geometry import Camera, LensRay, film_offsets
from focusjax.lens import AbstractLens, in_colour
from focusjax.trace._colour import corners_at
from focusjax.trace._devices import Workforce
from focusjax.trace._highlights import Highlights, towards
from focusjax.trace._radiances import TracedScene, first_met
from focusjax.trace._samples import chances, spread_points, tile_edge
from focusjax.trace._sight import who_sees

_RAYS_AT_ONCE = {"cpu": 1 << 16, "gpu": 1 << 22}
_FEWEST_RAYS = 1 << 13
"""In a block: fewer would need other programs, and save next to nothing."""
_SHARE = 0.5
"""Most aimed rays, of all."""


class Aimed:
    """All pairs of a pixel and a part of a highlight that it may see.

    Attributes:
        highlights: what is aimed at.
        pixels: row-major number [q] of each pair's pixel.
        parts: number [q] of its part.
    """

    def __init__(
        self, highlights: Highlights, scene: TracedScene, lens: AbstractLens, pixel_filter: str
    ) -> None:
        self.highlights, self._scene, self._lens, self._filter = highlights, scene, lens, pixel_filter
        self.pixels, self.parts = who_sees(highlights, lens, scene.camera, pixel_filter)

    def rays(self, rays: int) -> int:
        """Rays of each pair in a picture of so many per pixel: a power of two."""
        pixels = self._scene.camera.width * self._scene.camera.height
        most = min(2 * rays, int(_SHARE * rays * pixels / max(len(self.pixels), 1)))
        return 1 << max(most.bit_length() - 1, 0)

    def add_to(
        self,
        picture: Float[np.ndarray, "p 3"],
        wanted: Bool[np.ndarray, " p"],
        ends: tuple[Float[Array, " p"], Float[Array, " p"]],
        rays: int,
        seed: int,
        workforce: Workforce,
    ) -> None:
        """Add to the wanted pixels what highlights bring, by `rays` for each part that a pixel may see.

        `ends` are the least and largest disparity that the rays of each pixel can meet. Of several processes
        each adds its part.
        """
        mine = np.flatnonzero(wanted[self.pixels])
        if not len(mine):
            return
        starts = _starts(self._filter, rays, seed, self._scene.volume.opacity is not None, picture.dtype)
        size = max(1, _RAYS_AT_ONCE.get(jax.default_backend(), 1 << 20) // rays)
        size = min(size, max(1 << (len(mine) - 1).bit_length(), _FEWEST_RAYS // rays))
        blocks = [mine[k : k + size] for k in range(0, len(mine), size)]

        def trace(number: int, shared: _Shared) -> tuple[Int[np.ndarray, " b"], Float[np.ndarray, "b 3"]]:
            block = blocks[number]
            whole = np.pad(block, (0, size - len(block)), mode="edge")
            pair = jnp.asarray(self.pixels[whole]), jnp.asarray(self.parts[whole])
            return block, np.asarray(_aimed_block(*shared, *pair))[: len(block)]

        shared = self._scene, self._lens, self.highlights, starts, ends
        for (block, value), _ in workforce.each(trace, len(blocks), shared):
            np.add.at(picture, self.pixels[block], value)


class Starts(eqx.Module):
    """Where in the pixel and in a part's box each ray passes, for the pixels of a tile; see `RaySamples`."""

    offset: Float[Array, "t s 2"]
    share: Float[Array, "t s 2"]
    chance: UInt[Array, "t s"] | None


def _starts(pixel_filter: str, rays: int, seed: int, with_chances: bool, real: np.dtype) -> Starts:
    edge = tile_edge(rays)
    points = spread_points(4, edge, rays, seed)
    return Starts(
        jnp.asarray(film_offsets(pixel_filter, points[..., 2:]), dtype=real),
        jnp.asarray(points[..., :2], dtype=real),
        jnp.asarray(chances(edge, rays, seed)) if with_chances else None,
    )


_Shared: TypeAlias = tuple[
    TracedScene, AbstractLens, Highlights, Starts, tuple[Float[Array, " p"], Float[Array, " p"]]
]


@eqx.filter_jit
def _aimed_block(
    scene: TracedScene,
    lens: AbstractLens,
    highlights: Highlights,
    starts: Starts,
    ranges: tuple[Float[Array, " p"], Float[Array, " p"]],
    pixels: Int[Array, " q"],
    parts: Int[Array, " q"],
) -> Float[Array, "q 3"]:
    """What each of some parts brings to a pixel."""
    camera = scene.camera
    edge = tile_edge(starts.share.shape[1])
    column, row = pixels % camera.width, pixels // camera.width
    tile = row % edge * edge + column % edge
    film = jnp.stack([column, row], axis=-1)[:, None] + starts.offset[tile]
    chance = None if starts.chance is None else starts.chance[tile]
    ends = ranges[0][pixels], ranges[1][pixels]

    def seen(lens: AbstractLens) -> Float[Array, "q 3"]:
        over_rays = jax.vmap(functools.partial(_aim, camera, lens), in_axes=(0, 0, None, None, None))
        box = highlights.low[parts], highlights.high[parts], highlights.disparity[parts]
        pupil, weight = jax.vmap(over_rays)(film, starts.share[tile], *box)
        rays, hits = first_met(scene, lens, film, pupil, chance, *ends, depth=scene.volume.layers)

        def excess(ray: LensRay, hit: Int[Array, ""], part: Int[Array, ""]) -> Float[Array, "3"]:
            total = jnp.zeros(3, dtype=weight.dtype)
            for number, share in corners_at(scene.surface, ray, hit)[0]:
                slot = highlights.slot[number]
                mine = (hit >= 0) & (slot >= 0) & (highlights.part[slot] == part)
                total += jnp.where(mine, share, 0.0) * highlights.excess[slot]
            return total

        brought = jax.vmap(jax.vmap(excess, in_axes=(0, 0, None)))(rays, hits, parts)
        weight = weight * rays.weight
        # Each colour for itself, as in `trace_block`.
        return jnp.stack([(weight * brought[..., k]).mean(axis=1) for k in range(3)], axis=-1)

    return in_colour(seen, lens)


def _aim(
    camera: Camera,
    lens: AbstractLens,
    film: Float[Array, "2"],
    share: Float[Array, "2"],
    low: Float[Array, "2"],
    high: Float[Array, "2"],
    disparity: Float[Array, ""],
) -> tuple[Float[Array, "2"], Float[Array, ""]]:
    """The pupil point of a ray to a place in a box, by its `share` of the way; and what the ray counts.

    Points beside the opening count 0, and are put into its middle.
    """
    middle, slope = towards(camera, lens, film, disparity)
    (a, b), (c, d) = slope
    area = a * d - b * c
    x, y = low + share * (high - low) - middle
    safe = jnp.where(area == 0, 1.0, area)
    pupil = jnp.stack([d * x - b * y, a * y - c * x]) / safe
    density = jnp.where(area == 0, 0.0, lens.opening().share(pupil) / jnp.abs(safe))
    return jnp.where(density > 0, pupil, 0.0), density * (high - low).prod()
