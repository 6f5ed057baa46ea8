"""A large picture in bands of rows, which needs the sums over rays of few rows at a time.

Sums are kept apart by circle of confusion, so that they take ten times as much memory as the picture itself.
The denoiser looks at some rows around each pixel, its apron. So a window of a band and the aprons on both
sides is held, and moves down the picture:

    | rows that the last window had | new rows, whose rays are traced |
    |   apron   |        rows of this band, which are developed  | apron |

Each ray is traced once. The windows are of one size; at the picture's upper and lower border they stay inside
of it, as the denoiser treats the border otherwise than what goes on.
"""

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax._at_once import at_once
from focusjax._zeros import zeros_after
from focusjax.trace._accumulate import PixelSums

_T = TypeVar("_T")

_LEAST_ROWS = 16
"""Rows of a band, however wide the picture."""


@dataclasses.dataclass(frozen=True)
class Bands:
    """How a picture is divided.

    Attributes:
        width: pixels per row of the picture.
        height: rows of the picture.
        rows: rows of each band; the last one shares some with the one before.
        apron: rows above and below that count for them.
    """

    width: int
    height: int
    rows: int
    apron: int

    @property
    def window(self) -> int:
        """Rows of a band with its aprons."""
        return self.rows + 2 * self.apron


def bands_of(width: int, height: int, apron: int) -> Bands | None:
    """The bands of a picture; None where it is small enough to be held as a whole.

    A window has so many pixels; a picture of up to twice as many is held.
    """
    pixels = at_once(cpu=1 << 18, gpu=1 << 22)
    rows = max(pixels // width - 2 * apron, _LEAST_ROWS)
    whole = width * height <= 2 * pixels or rows + 2 * apron >= height
    return None if whole else Bands(width, height, rows, apron)


class Window(eqx.Module):
    """Rows of the picture that are held.

    Attributes:
        first: number of the first one.
        done: rows of the picture before this one have their sums.
        bands: of the picture (static).
    """

    first: Int[Array, ""]
    done: Int[Array, ""]
    bands: Bands = eqx.field(static=True)

    def of(self, planes: _T) -> _T:
        """The part of planes [p, ...] of the picture, row-major, that lies in the window."""
        width, rows = self.bands.width, self.bands.window
        return jax.tree.map(
            lambda plane: jax.lax.dynamic_slice_in_dim(plane, self.first * width, rows * width), planes
        )

    def is_new(self, pixels: int) -> Bool[Array, " n"]:
        """Which of the window's pixels have no sums yet."""
        row = self.first + jnp.arange(pixels, dtype=jnp.int32) // self.bands.width
        return row >= self.done


def picture_in_bands(
    bands: Bands,
    nothing: PixelSums,
    traced: Callable[[Window, PixelSums], PixelSums],
    developed: Callable[[Window, PixelSums], Float[Array, "n 3"]],
) -> Float[Array, "p 3"]:
    """The picture, row-major.

    Args:
        bands: how it is divided.
        nothing: sums of a window without any rays.
        traced: from the sums of a window's rows that are done, those of all of its rows.
        developed: from the sums of a window, its part of the picture; true but for its aprons.
    """
    width, last = bands.width, bands.height - bands.rows

    def add(state: tuple[Array, PixelSums, Window], number: Array) -> tuple[tuple, None]:
        image, sums, before = state
        begin = jnp.minimum(number * bands.rows, last)
        first = jnp.clip(begin - bands.apron, 0, bands.height - bands.window)
        window = Window(first, before.done, bands)
        sums = traced(window, _moved(sums, (first - before.first) * width))
        found = developed(window, sums)
        mine = jax.lax.dynamic_slice_in_dim(found, (begin - first) * width, bands.rows * width)
        image = jax.lax.dynamic_update_slice_in_dim(image, mine, begin * width, axis=0)
        return (image, sums, Window(first, first + bands.window, bands)), None

    image = zeros_after(nothing.over, (bands.height * width, 3), nothing.over.dtype)
    start = image, nothing, Window(jnp.int32(0), jnp.int32(0), bands)
    count = -(-bands.height // bands.rows)
    return jax.lax.scan(add, start, jnp.arange(count, dtype=jnp.int32))[0][0]


def _moved(sums: PixelSums, pixels: Int[Array, ""]) -> PixelSums:
    """The sums of a window so many pixels further on, of which the last ones have none yet."""

    def along(plane: Array, axis: int) -> Array:
        longer = jnp.concatenate([plane, jnp.zeros_like(plane)], axis=axis)
        return jax.lax.dynamic_slice_in_dim(longer, pixels, plane.shape[axis], axis=axis)

    return PixelSums(along(sums.binned, 1), along(sums.over, 0))
