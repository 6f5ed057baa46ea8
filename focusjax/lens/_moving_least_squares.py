r"""Moving least squares: a smooth surface through scattered control points, evaluated one place at a time.

At a place x a polynomial in t = (position - x) is fitted to the control values by weighted least squares,

    minimise  sum_i omega_i (c_0 + c_1 . t_i + c_2 . (t_i t_i) - v_i)^2,

with omega_i proportional to alpha_i k(|t_i|), and c_0 is the surface there (Lee10 section 5.2; Lancaster
and Salkauskas 1981). The kernel k grows without bound towards a control point, so the surface meets it.

The polynomial is built up by degree. What a lower degree explains is taken out of the terms of the next
one, A, and of the values, v; their coefficients then solve (A' Omega A) c = A' Omega v. Few or collinear
points leave A without one direction or all of them. There is no case to tell apart: with

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
    Places close together are best: first moments are taken about their middle, and rounded there.

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

    def total(u: Float[Array, "k *_"]) -> Float[Array, "1 *_"]:
        return jnp.sum(omega * u, axis=0, keepdims=True)

    count = values.shape[1]
    # What has one value per point is summed by a product of matrices, which is quicker than a sum.
    middle = jax.lax.stop_gradient(jnp.mean(at.reshape(2, -1), axis=1))
    ones = jnp.ones_like(xy[:, :1])
    table = jnp.concatenate([ones, xy - middle[None], values, *([] if levels is None else [levels])], axis=1)
    means = _products(table, omega)[:, None]
    answer = [*means[3 : 3 + count]]
    rest = [values[:, number][along] - mean for number, mean in enumerate(answer)]
    # Terms are scaled such that the squares of each degree sum to |t|^(2 n) in every direction. Beside
    # each column of what is not explained yet at the points is the same at x, where t = 0.
    degrees = [[x, y], [x * x, 2.0**0.5 * x * y, y * y]][: DEGREES[basis]]
    here = [[-total(term) for term in terms] for terms in degrees]
    degrees = [
        [term + mean for term, mean in zip(terms, means, strict=True)]
        for terms, means in zip(degrees, here, strict=True)
    ]
    size = squared + SOFTENING_PX**2
    for number, (A, a) in enumerate(zip(degrees, here, strict=True)):
        ridge = _ETA * total((1.0 - omega + _DELTA) * size ** (number + 1))
        weighted = jax.lax.optimization_barrier(tuple(omega * term for term in A))

        def against(column: Float[Array, "k *_"], weighted=weighted) -> list[Array]:
            return [jnp.sum(row * column, axis=0, keepdims=True) for row in weighted]

        if number == 0:
            normal, right = _first_moments(weighted, table[:, : 3 + count], means)
        else:
            normal, right = [against(term) for term in A], [against(column) for column in rest]
        solve = _iterated_tikhonov(normal, ridge)
        for index, column in enumerate(rest):
            c = solve(right[index])
            rest[index] = column - _combined(c, A)
            answer[index] = answer[index] + _combined(c, a)
        for later in range(number + 1, len(degrees)):
            for index, column in enumerate(degrees[later]):
                c = solve(against(column))
                degrees[later][index] = column - _combined(c, A)
                here[later][index] = here[later][index] - _combined(c, a)
            # The sums to come would work them out again and again.
            degrees[later] = list(jax.lax.optimization_barrier(tuple(degrees[later])))
    return jnp.concatenate([*answer, *means[3 + count :]])


def _first_moments(
    weighted: Sequence[Array], table: Float[Array, "k n"], means: Float[Array, "columns 1 *p"]
) -> tuple[list[list[Array]], list[list[Array]]]:
    """Normal equations and right sides of degree 1.

    Args:
        weighted: omega times the terms of that degree.
        table: 1, x, y and values of every point.
        means: of its columns, weighted by omega; what is summed is a column less its mean.
    """

    def about_means(row: Array) -> list[Array]:
        sums = _products(table, row)[:, None]
        return [sums[number] - means[number] * sums[0] for number in range(1, table.shape[1])]

    products = [about_means(row) for row in weighted]
    return [sums[:2] for sums in products], [list(sums) for sums in zip(*products, strict=True)][2:]


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
