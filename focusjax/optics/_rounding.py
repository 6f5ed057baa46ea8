"""Heights that were rounded to whole steps, as in pictures of 16 bits, made smooth again.

Light is bent by slopes, and a step of 40 nm between samples 0.1 mm apart turns it by some tenths of a pixel.
But where a surface is smooth, neighbours show where within a step a height was. Of the heights that may have
been rounded to these the smoothest are taken: those p + q with the least sum over rows and columns of

    |p + q - heights|^2 + lambda |D q|^2,

p the polynomial of least squares of degree 8 along either axis, and D third differences (Whittaker 1923,
Eilers 2003). Lambda is the largest for which what is changed is no more than rounding changes:
step / sqrt(12) as root mean square, and a step anywhere. So a relief as fine as its samples is left as it is.
"""

import numpy as np
import scipy.linalg
from jaxtyping import Float

_DEGREE = 8
_STRENGTHS = 10.0 ** np.arange(-1.0, 8.5, 0.5)
"""Lambda, in units of one step between samples; the largest averages over some hundred of them."""
_ROOM = 1.02
"""Of the root of the mean square of rounding, which is a step / sqrt(12) on average."""


def without_rounding(heights: Float[np.ndarray, "n n"], step: float) -> Float[np.ndarray, "n n"]:
    """The smoothest heights that may have been rounded to these.

    Heights are finite, in any unit, at least 4 rows of them and as many columns; `step` is what they are
    multiples of.

    Example:
        >>> x = np.linspace(-1.0, 1.0, 129)
        >>> bowl = x[:, None] ** 2 + x[None] ** 2
        >>> rounded = np.round(bowl * 1000) / 1000
        >>> found = without_rounding(rounded, 1e-3)
        >>> bool(np.std(found - bowl) < 0.1 * np.std(rounded - bowl))
        True
    """
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(*_axis(len(heights))))
    trend = basis @ (basis.T @ heights @ basis) @ basis.T
    rest, best = heights - trend, heights
    low, high = 0, len(_STRENGTHS)
    while low < high:
        middle = (low + high) // 2
        tried = trend + _smoothed(_smoothed(rest, _STRENGTHS[middle]).T, _STRENGTHS[middle]).T
        off = np.abs(tried - heights)
        if off.max() <= step and np.sqrt(np.mean(off**2)) <= _ROOM * step / np.sqrt(12.0):
            best, low = tried, middle + 1
        else:
            high = middle
    return best


def _axis(count: int) -> tuple[Float[np.ndarray, " n"], int]:
    """Places of samples from -1 to 1, and the degree that they can have."""
    return np.linspace(-1.0, 1.0, count), min(_DEGREE, count - 2)


def _smoothed(values: Float[np.ndarray, "n m"], strength: float) -> Float[np.ndarray, "n m"]:
    """(1 + strength D^T D)^-1 of each column, D third differences."""
    count = len(values)
    third = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((4, count))
    for offset in range(4):
        products = third[: 4 - offset] * third[offset:]
        bands[offset, : count - offset] = strength * np.convolve(np.ones(count - 3), products)
    bands[0] += 1.0
    return scipy.linalg.solveh_banded(bands, values, lower=True)
