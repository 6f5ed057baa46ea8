"""Scrambled Sobol points, made on the device from a traced seed.

A Sobol point is an exclusive or of direction numbers, one for each bit of its index. Nested uniform (Owen)
scrambling flips each of its bits by a hash of the bits above it: the points stay a (0, m, s)-net, are uniform
on the average, and those of two seeds are independent. The hash is Laine's and Karras's (2011), with the
constants of Vegdahl (2021); it works from the lowest bit up, so bits are reversed before and after it.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt

from focusjax._whole import taken

_BITS = 32
_POLYNOMIALS = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)))
"""Degree, inner coefficients and first numbers of dimensions 2 to 5 (Joe and Kuo 2008)."""


def sobol_points(
    index: Int[Array, "..."], seed: UInt[Array, "..."], dimensions: int, *, most: int
) -> list[Float[Array, "..."]]:
    """Coordinates in [0, 1), one array a dimension, of the scrambled Sobol points at `index`.

    Args:
        index: from 0 to below `most`.
        seed: chooses the scrambling; one, or one for each of them.
        dimensions: 1 to 5 (static).
        most: bound on the indices (static), which says how many bits they have.
    """
    bits = max(most - 1, 1).bit_length()
    half = bits // 2
    low, high = (index & ((1 << half) - 1)), index >> half
    words = [index.astype(jnp.uint32)]
    for dimension in range(1, dimensions):
        # Of each half of its bits by a table: one exclusive or for each bit takes far longer to compile.
        tables = jnp.asarray(_words(dimension, 0, half)), jnp.asarray(_words(dimension, half, bits))
        words.append(taken(tables[0], low) ^ taken(tables[1], high))
    seeds = jnp.stack([jnp.broadcast_to(stirred(seed, k), index.shape) for k in range(dimensions)])
    words = reversed_bits(_scrambled(jnp.stack(words), seeds))
    # In 24 bits, so that single precision stays below 1.
    return list((words >> 8).astype(jnp.zeros(()).dtype) * 2.0**-24)


def shuffled(index: Int[Array, "..."], count: int, seed: UInt[Array, "..."]) -> Int[Array, "..."]:
    """The numbers from 0 to below `count`, a power of two, in another order, halves and their halves swapped.

    Runs of 2^k numbers that begin at a multiple of it stay together.
    """
    bits = count.bit_length() - 1
    if bits == 0:
        return index
    word = reversed_bits(index.astype(jnp.uint32)) >> (_BITS - bits)
    return (reversed_bits(_scrambled(word, seed)) >> (_BITS - bits)).astype(index.dtype)


def stirred(seed: UInt[Array, "*n"], number: int) -> UInt[Array, "*n"]:
    """A seed that looks independent of `seed` for each `number`."""
    word = seed ^ jnp.uint32((0x9E3779B9 * (number + 1)) & 0xFFFFFFFF)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        word = (word ^ (word >> shift)) * jnp.uint32(factor)
    return word ^ (word >> 16)


def reversed_bits(word: UInt[Array, "*n"]) -> UInt[Array, "*n"]:
    """The 32 bits of each word in reverse order."""
    for shift, mask in ((1, 0x55555555), (2, 0x33333333), (4, 0x0F0F0F0F), (8, 0x00FF00FF)):
        word = ((word >> shift) & jnp.uint32(mask)) | ((word & jnp.uint32(mask)) << shift)
    return (word >> 16) | (word << 16)


def _scrambled(word: UInt[Array, "..."], seed: UInt[Array, "..."]) -> UInt[Array, "..."]:
    """Each bit flipped by a hash of the lower ones."""
    word = word ^ (word * jnp.uint32(0x3D20ADEA))
    word = (word + seed) * ((seed >> 16) | 1)
    word ^= word * jnp.uint32(0x05526C56)
    return word ^ (word * jnp.uint32(0x53A22864))


@functools.cache
def _words(dimension: int, first: int, end: int) -> UInt[np.ndarray, " k"]:
    """What bits `first` to `end` of an index add to its point, bits reversed as the scrambling takes them."""
    number = np.arange(1 << (end - first))
    words = np.zeros(number.shape, dtype=np.uint32)
    for bit in range(first, end):
        words ^= np.where(number >> (bit - first) & 1, _directions()[dimension, bit], 0).astype(np.uint32)
    return words


@functools.cache
def _directions() -> UInt[np.ndarray, "d 32"]:
    """Direction numbers, each with its bits reversed: the highest of the fraction is the lowest here."""
    rows = [[1] * _BITS]
    for degree, inner, first in _POLYNOMIALS:
        numbers = list(first)
        for k in range(degree, _BITS):
            new = numbers[k - degree] ^ (numbers[k - degree] << degree)
            for j in range(1, degree):
                if inner >> (degree - 1 - j) & 1:
                    new ^= numbers[k - j] << j
            numbers.append(new)
        rows.append(numbers)
    # Number k has k + 1 bits, of which the highest is the first of the fraction.
    return np.array(
        [[int(f"{m:0{k + 1}b}"[::-1], 2) for k, m in enumerate(row)] for row in rows], dtype=np.uint32
    )
