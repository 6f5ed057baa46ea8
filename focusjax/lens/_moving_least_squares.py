r"""Moving least squares: a smooth surface through scattered control points, evaluated one place at a time.

At a place x a polynomial in t = (position - x) is fitted to the control values by weighted least squares,

    minimise  sum_i omega_i (c_0 + c_1 . t_i + c_2 . (t_i t_i) - v_i)^2,

with omega_i proportional to alpha_i k(|t_i|), and c_0 is the surface there (Lee10 section 5.2; Lancaster
and Salkauskas 1981). The kernel k grows without bound towards a control point, so the surface meets it.

The polynomial is built up by degree. What a lower degree explains is taken out of the terms of the next
one, A, and of the values, v; their coefficients then solve (A' Omega A) c = A' Omega v. Few or collinear
points leave A without one direction or all of them. No case distinction is needed: with

    lambda = eta (sum_i omega_i (1 - omega_i) |t_i|^(2 n) + delta sum_i omega_i |t_i|^(2 n))

for degree n, the normal equations are solved by iterated Tikhonov regularisation:
c <- (A' Omega A + lambda)^-1 (A' Omega v + lambda c), three times from 0. A direction of eigenvalue
sigma keeps the share 1 - (lambda / (sigma + lambda))^3 of its plain solution: all but 3e-5 where points
surround x, nothing where they do not reach, and everything between where they begin to.

- The first sum is what sigma would be if the points around x lay in all directions; it vanishes like
  sigma when x comes to a control point, where that one point has nearly all the weight. So the slope
  persists there, and the surface has no flat spots.
- The second sum keeps lambda above 0 for a single point, and lets the slope fade with a point
  that fades (alpha going to 0), for which the first would shrink like sigma, too.
- From points within h of each other, seen from a distance D, slopes are believed while h / D is well
  above sqrt(eta), and the surface levels off farther out: by Cauchy and Schwarz, a degree adds no more than
  about sqrt(3 / eta) times the spread of the values, however the points lie.
"""

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.lens._kernels import SOFTENING_PX, AbstractKernel

Basis: TypeAlias = Literal["constant", "affine", "quadratic"]
DEGREES: dict[Basis, int] = {"constant": 0, "affine": 1, "quadratic": 2}

_ETA = 1e-2
_DELTA = 0.1
_ITERATIONS = 3
_LARGEST_LOG = 60.0


def moving_least_squares(
    at: Float[Array, "2 *p"],
    xy: Float[Array, "k 2"],
    values: Float[Array, "k m"],
    weight: Float[Array, "k"],
    kernel: AbstractKernel,
    basis: Basis,
    levels: Float[Array, "k l"] | None = None,
) -> Float[Array, "surfaces *p"]:
    """The surfaces through `values` at one place, or at many along trailing axes.

    Linear in `values`, and differentiable in everything, at control points too. At a place shared by
    several control points the surface takes the mean of their values weighted by `weight`.

    Places are the last axis, not a batch of their own, since sums over points are then four times as quick.
    Places close together are best: sums over points are taken about their middle, and rounded there.

    Args:
        at: x and y of the place in pixels.
        xy: control points in pixels, inside the picture or not.
        values: m values at each of them, such as focal disparity and aperture scale.
        weight: alpha of Lee10, not negative, at least one above 0; larger weights widen the region where
            a control point rules. A point of weight 0 has no influence.
        kernel: fall-off with distance.
        basis: degree of the polynomial: "constant" stays within the range of the values, "affine" and
            "quadratic" go on with the trend.
        levels: values of more surfaces, whose basis is constant.

    Returns:
        The surfaces through `values`, then those through `levels`.
    """
    along = (slice(None), *[None] * (at.ndim - 1))
    x, y = (xy[:, axis][along] - at[axis][None] for axis in (0, 1))
    squared = x * x + y * y
    omega = _shares(squared + SOFTENING_PX**2, weight[along], kernel)
    # What has one value per point is summed by a product of matrices, which is quicker than a sum: the
    # polynomial's terms, about the middle of the places, and the values.
    middle = jax.lax.stop_gradient(jnp.mean(at.reshape(2, -1), axis=1))
    place = [(at[axis] - middle[axis])[None] for axis in (0, 1)]
    number = DEGREES[basis]
    right, down = (xy - middle[None]).T
    terms = [term for degree in _terms(right, down, number) for term in degree]
    table = jnp.stack([jnp.ones_like(xy[:, 0]), *terms, *values.T], axis=1)
    columns = range(len(terms) + 1, table.shape[1])

    def sums(row: Float[Array, "k *p"], table: Float[Array, "k n"] = table) -> list[Array]:
        found = [*_products(table, row)[:, None]]
        return _about_place(found[: len(terms) + 1], place) + found[len(terms) + 1 :]

    means = sums(omega, table if levels is None else jnp.concatenate([table, levels], axis=1))
    # Of each column of the table, what is not explained yet is the column less its mean and, for every
    # degree so far, less some coefficients times what that degree's own terms then had left.
    explained: dict[int, list[tuple[list[int], list[Array]]]] = {}

    def left(row_sums: list[Array], column: int) -> Array:
        """The sum of a row times what is not explained of a column."""
        out = row_sums[column] - means[column] * row_sums[0]
        for by, c in explained.get(column, []):
            out = out - _combined(c, [left(row_sums, one) for one in by])
        return out

    answer = [means[column] for column in columns]
    # What is left of each term at the points, and at x, where t = 0.
    A: dict[int, Array] = {}
    here: dict[int, Array] = {}
    first = 1
    size = squared + SOFTENING_PX**2
    for degree, own_terms in enumerate(_terms(x, y, number), start=1):
        own = [*range(first, first + len(own_terms))]
        first += len(own)
        for one, term in zip(own, own_terms, strict=True):
            # About the middle of the places it would not come down to 0 at a control point.
            mean = jnp.sum(omega * term, axis=0, keepdims=True)
            A[one], here[one] = term - mean, -mean
            for by, c in explained.get(one, []):
                A[one] = A[one] - _combined(c, [A[other] for other in by])
                here[one] = here[one] - _combined(c, [here[other] for other in by])
        # The sums would work them out again and again.
        weighted = jax.lax.optimization_barrier([omega * A[one] for one in own])
        row_sums = [sums(row) for row in weighted]
        ridge = _ETA * jnp.sum(omega * (1.0 - omega + _DELTA) * size**degree, axis=0, keepdims=True)
        solve = _iterated_tikhonov([[left(row, one) for one in own] for row in row_sums], ridge)
        found = {
            column: solve([left(row, column) for row in row_sums]) for column in range(first, table.shape[1])
        }
        for column, c in found.items():
            explained.setdefault(column, []).append((own, c))
        at_x = [here[one] for one in own]
        answer = [
            value + _combined(found[column], at_x) for value, column in zip(answer, columns, strict=True)
        ]
    return jnp.concatenate([*answer, *means[table.shape[1] :]])


def _terms(x: Array, y: Array, degrees: int) -> list[list[Array]]:
    """The terms of degree 1 and up; the squares of each degree sum to |t|^(2 n) in every direction."""
    return [[x, y], [x * x, 2.0**0.5 * x * y, y * y]][:degrees]


def _about_place(sums: Sequence[Array], place: Sequence[Array]) -> list[Array]:
    """Sums times 1 and the terms about `place`, from those about the origin."""
    x, y = place
    out = [*sums[:1]]
    if len(sums) > 1:
        out += [sums[1] - x * sums[0], sums[2] - y * sums[0]]
    if len(sums) > 3:
        # t t = T T - x T - x t, where T = t + x.
        root = 2.0**0.5
        out += [
            sums[3] - x * (sums[1] + out[1]),
            sums[4] - root * (x * sums[2] + y * out[1]),
            sums[5] - y * (sums[2] + out[2]),
        ]
    return out


def _products(table: Float[Array, "k n"], omega: Float[Array, "k *p"]) -> Float[Array, "n *p"]:
    """Sums over the control points of each column times omega, in full precision on every machine."""
    flat = omega.reshape(omega.shape[0], -1)
    return jnp.matmul(table.T, flat, precision=jax.lax.Precision.HIGHEST).reshape(-1, *omega.shape[1:])


def _shares(
    squared: Float[Array, "k *p"], weight: Float[Array, "k *_"], kernel: AbstractKernel
) -> Float[Array, "k *p"]:
    """Weights omega, whose sum over the control points is 1."""
    log_kernel = kernel.log_weight(squared)
    counts = weight > 0
    log_all = jnp.where(counts, log_kernel + jnp.log(jnp.where(counts, weight, 1.0)), -jnp.inf)
    largest = jax.lax.stop_gradient(jnp.max(log_all, axis=0, keepdims=True))
    # Only a point of nearly no weight can be above the bound, which keeps 0 times it a number.
    influence = weight * jnp.exp(jnp.minimum(log_kernel - largest, _LARGEST_LOG))
    # Every sum over points would otherwise work the kernel out again, which takes half as long once more.
    return jax.lax.optimization_barrier(influence / jnp.sum(influence, axis=0, keepdims=True))


def _combined(coefficients: Sequence[Array], columns: Sequence[Array]) -> Array:
    """The sum of coefficient times column."""
    return sum(
        (c * column for c, column in zip(coefficients[1:], columns[1:], strict=True)),
        start=coefficients[0] * columns[0],
    )


def _iterated_tikhonov(
    normal: Sequence[Sequence[Array]], ridge: Array
) -> Callable[[Sequence[Array]], list[Array]]:
    """A solver of `normal` c = right, regularised, for lists of arrays [*p].

    Cholesky's method written out: the matrices are of size 2 and 3, and there are millions.
    """
    size = len(normal)
    L: list[list[Array]] = [[ridge] * size for _ in range(size)]
    for i in range(size):
        for j in range(i + 1):
            entry = normal[i][j]
            for k in range(j):
                entry = entry - L[i][k] * L[j][k]
            # Rounding may take a pivot below the ridge, which in exact arithmetic it never is.
            L[i][j] = jnp.sqrt(jnp.maximum(entry, 0.0) + ridge) if i == j else entry / L[j][j]

    def once(right: Sequence[Array]) -> list[Array]:
        out = list(right)
        for i in range(size):
            for k in range(i):
                out[i] = out[i] - L[i][k] * out[k]
            out[i] = out[i] / L[i][i]
        for i in reversed(range(size)):
            for k in range(i + 1, size):
                out[i] = out[i] - L[k][i] * out[k]
            out[i] = out[i] / L[i][i]
        return out

    def solve(right: Sequence[Array]) -> list[Array]:
        found = once(right)
        for _ in range(_ITERATIONS - 1):
            found = once([r + ridge * c for r, c in zip(right, found, strict=True)])
        return found

    return solve
