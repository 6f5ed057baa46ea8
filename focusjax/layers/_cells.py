"""What one sample of a layer occupies, packed into 32 bits for the walk to read at once.

From the highest bit down:

- 13 bits: the largest disparity of its interval, rounded up to whole steps, at least 1;
- 6 bits: the interval's length, rounded up to (4 + m) 2^e - 4 steps, e before m;
- 13 bits: the straight line that bounds the surface inside the square of the sample.

A line is a dx + b dy + c / 2 >= 0 for offsets (dx, dy), in samples, from the sample's centre. The larger of
|a| and |b| is 7; four bits each hold a + 8 and b + 8, five hold c + 16. A whole square has a = b = 0, c = 15.

A word of 0 holds nothing: its largest disparity is 0, which no ray meets.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt

STEPS = (1 << 13) - 2
"""Steps from infinity to the nearest disparity of all."""
BELOW_MOST = (1 << 19) - 1
"""The bits of a word below its largest disparity."""
WHOLE = (8 << 9) | (8 << 5) | 31
"""Line of a sample whose square is covered whole."""
_SLOPES = 7


def in_steps(
    low: Float[np.ndarray, " n"], high: Float[np.ndarray, " n"]
) -> tuple[UInt[np.ndarray, " n"], UInt[np.ndarray, " n"], float]:
    """Intervals of disparities above 0 in whole steps, rounded outwards; and dioptres per step."""
    scale = max(float(high.max(initial=0.0)), 2.0**-100) / STEPS
    most = np.clip(np.ceil(high / scale), 1, STEPS).astype(np.uint32)
    return np.minimum(np.floor(low / scale).astype(np.uint32), most), most, scale


def pack_cells(
    least: UInt[np.ndarray, " n"], most: UInt[np.ndarray, " n"], line: UInt[np.ndarray, " n"]
) -> UInt[np.ndarray, " n"]:
    """The words of samples that span the steps `least` to `most` and are bounded by `line`."""
    word = np.take(_length_codes(), most - least)
    word |= most << np.uint32(19)
    word |= line
    return word


@functools.cache
def _length_codes() -> UInt[np.ndarray, " lengths"]:
    """The bits of a word for an interval's length of each number of steps."""
    length = np.arange(STEPS + 1, dtype=np.uint32)
    # Three significant bits of length + 4, rounded up.
    power = (np.frexp(length.astype(np.float32) + 4)[1] - 3).astype(np.uint32)
    rounded = (length + np.uint32(3) + (np.uint32(1) << power)) >> power
    return ((power << np.uint32(2)) + rounded - np.uint32(4)) << np.uint32(13)


def interval(word: UInt[Array, "*n"]) -> tuple[Int[Array, "*n"], Int[Array, "*n"]]:
    """Least and largest disparity in steps."""
    most = (word >> 19).astype(jnp.int32)
    length = ((word >> 13) & 3 | 4) << ((word >> 15) & 15)
    return most + 4 - length.astype(jnp.int32), most


def covered(word: UInt[Array, "*n"], dx: Float[Array, "*n"], dy: Float[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether the surface extends to the offset (dx, dy), in samples, from the sample's centre."""
    a, b, c = ((word >> shift & mask).astype(dx.dtype) for shift, mask in ((9, 15), (5, 15), (0, 31)))
    return a * dx + b * dy + 0.5 * c >= 8.0 * (dx + dy) + 8.0


def line_code(towards: Float[np.ndarray, "n 2"], area: Float[np.ndarray, " n"]) -> UInt[np.ndarray, " n"]:
    """Code of the line that leaves the share `area` of the square on the side `towards`.

    With a normal (1, t), |t| <= 1, the distance n . d of a point of the square has a trapezoid for its
    density: 1 up to (1 - |t|) / 2 on both sides of 0, then falling to 0 at (1 + |t|) / 2. The line lies
    where its integral reaches `area`.
    """
    longest = np.abs(towards).max(axis=1, keepdims=True)
    normal = np.where(
        longest > 0, np.round(_SLOPES * towards / np.where(longest > 0, longest, 1)), (_SLOPES, 0)
    )
    t = np.abs(normal).min(axis=1) / _SLOPES
    rest = np.minimum(area, 1 - area)
    corner = (1 + t) / 2 - np.sqrt(2 * t * rest)
    size = np.where(0.5 - rest <= (1 - t) / 2, 0.5 - rest, corner)
    offset = np.round(2 * _SLOPES * np.where(area >= 0.5, size, -size)).astype(np.int32)
    a, b = normal.astype(np.int32).T + 8
    return ((a << 9) | (b << 5) | (offset + 16)).astype(np.uint16)
