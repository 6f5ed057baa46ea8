"""How many rays each pixel of a picture has, and the groups of them that are traced together."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.geometry import Camera
from focusjax.trace._allocate import FEWEST, allocated, counts_for, least_through
from focusjax.trace._groups import RayGroups, groups_of
from focusjax.trace._known_light import KnownLight
from focusjax.trace._ranges import DisparityRanges

_TOGETHER = 4
_SLACK = 16


class RayCounts(eqx.Module):
    """Rays of the pixels of a picture.

    Attributes:
        of_pixel: number [p] of each, row-major.
        numbers: all that may occur, increasing (static).
        mean: of all pixels (static).
        together: rays of a group (static).
    """

    of_pixel: Int[Array, " p"]
    numbers: tuple[int, ...] = eqx.field(static=True)
    mean: int = eqx.field(static=True)
    together: int = eqx.field(static=True)

    def groups(self, count: Int[Array, " n"], width: int, height: int) -> RayGroups:
        """Groups of a part of the picture with so many rays for each of its pixels, row-major.

        Args:
            count: some of `of_pixel`, or 0 for pixels without rays.
            width: pixels per row of the part.
            height: rows of the part.
        """
        pixels = len(self.of_pixel)
        # As many as the picture may have, if all of them lie in the part; sums of float32 are off by less.
        all_rays = self.mean * pixels + (self.mean * pixels >> _SLACK)
        most = min(all_rays, self.numbers[-1] * width * height)
        nested = 0 if len(self.numbers) == 1 else FEWEST
        return groups_of(count, width, height, self.together, most=-(-most // self.together), nested=nested)


def ray_group(rays: int, *, even: bool) -> int:
    """How many rays of a pixel are traced together, where all pixels have as many if `even`."""
    return max(k for k in range(1, _TOGETHER + 1) if rays % k == 0) if even or rays < FEWEST else _TOGETHER


def even_counts(camera: Camera, rays: int) -> RayCounts:
    """The same number of rays in every pixel."""
    # XLA would work out at length, while it compiles, what follows from known numbers.
    count = jax.lax.optimization_barrier(jnp.full(camera.width * camera.height, rays, dtype=jnp.int32))
    return RayCounts(count, (rays,), rays, ray_group(rays, even=True))


def adaptive_counts(
    variance: Float[Array, " q"],
    camera: Camera,
    ranges: DisparityRanges,
    known: KnownLight | None,
    rays: int,
) -> RayCounts:
    """Rays by what differs in each pixel: `rays` of them on the average; `variance` is by `contrast`."""
    row, column = jnp.divmod(jnp.arange(camera.width * camera.height, dtype=jnp.int32), camera.width)
    square = ranges.square(column, row)
    if known is None:
        pixels = ranges.pixels(camera.width, camera.height)
        count = allocated(variance, rays, rays, pixels=pixels)[square]
    else:
        least = least_through(known.share[:, 1], rays)
        count = allocated(variance[square], rays, rays, least=least)
    return RayCounts(count, counts_for(rays), rays, _TOGETHER)
