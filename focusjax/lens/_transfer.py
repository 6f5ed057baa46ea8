"""What a lens does to rays as polynomials: fitted to traced ones, and quick to evaluate.

Let t be a film point and T the point of the last vertex plane that a ray from there is aimed at, less what
the middles of openings lean by, both as shares of their largest. A lens that is the same all around its axis
makes of them vectors and numbers that depend on

    u = t . t,        v = t . T,        w = T . T

only: the slope with which a ray leaves is A t + B T, the place where it crosses the entrance pupil is
C t + D T, and the square of its distance from the axis on a surface is a number, all of them functions of
u, v and w (Hopkins 1950). These functions are smooth, also where rims cut light off: a rim passes a ray where
that square is less than its own. So they are fitted by polynomials of a total degree n, which is the
aberrations of order 2 n + 1, of (n + 1) (n + 2) (n + 3) / 6 terms each, by least squares over rays that are
traced through the glass.

Of a lens that is not the same all around, slope, crossing and the squares at rims are functions of the four
numbers t_x, t_y, T_x and T_y, with no symmetry to relate them: polynomials of total degree n in all four,
which is the aberrations of order n, of (n + 1) (n + 2) (n + 3) (n + 4) / 24 terms each.
"""

import functools
import itertools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.lens._length import Pair

_LEAST_SQUARE = 1e-3
"""Squares below it are taken for it: the root is steep there, and everything open."""

_Scales = tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]
"""The first three attributes of `Transfer`."""


class Transfer(eqx.Module):
    """Polynomials that a lens's rays are traced by.

    Attributes:
        film: 1 over the largest tangent of film points.
        lean: mm by which the openings of the outermost film points are off the axis.
        pupil: 1 over the largest distance in mm of a target from there.
        lines: coefficients [4, m] of A and B, in tangents, and of C and D, in mm; of a lens that is not round
            those of the slopes along x and y, and of where in mm a ray crosses the pupil.
        rims: coefficients [k, m] of the squares, over those of the rims that cut rays off.
        degree: the total degree n (static).
        is_round: whether the lens is the same all around its axis (static).
    """

    film: Float[Array, ""]
    lean: Float[Array, ""]
    pupil: Float[Array, ""]
    lines: Float[Array, "4 m"]
    rims: Float[Array, "k m"]
    degree: int = eqx.field(static=True)
    is_round: bool = eqx.field(static=True)

    def __call__(self, tangents: Pair, target: Pair) -> tuple[Pair, Pair, Float[Array, ""]]:
        """Where the ray from a film point to a target goes.

        Returns:
            its slopes beyond those of the pinhole's ray, where in mm it crosses the entrance pupil, and its
            least clearance of the rims.
        """
        t, T = shares((self.film, self.lean, self.pupil), tangents, target)
        variables = invariants(t, T) if self.is_round else (*t, *T)
        # One after the other: XLA for CPU would else work each out anew for every number that it is part of,
        # and compile as many.
        rows = jnp.concatenate([self.lines, self.rims])
        *lines, squares = jnp.split(
            jax.lax.map(lambda row: polynomial(row, self.degree, *variables), rows), [1, 2, 3, 4]
        )
        farthest = jnp.full_like(variables[0], _LEAST_SQUARE)
        for square in squares:
            farthest = jnp.maximum(farthest, square)
        clearance = 1.0 - jnp.sqrt(farthest)
        A, B, C, D = (line[0] for line in lines)
        if not self.is_round:
            return (A, B), (C, D), clearance
        (x, y), (X, Y) = t, T
        return (A * x + B * X, A * y + B * Y), (C * x + D * X, C * y + D * Y), clearance


class TracedRays(eqx.Module):
    """Rays through the glass that polynomials are fitted to.

    Attributes:
        tangents: film points, x and y [r].
        target: where they are aimed, x and y [r] in mm.
        slope: beyond the pinhole's ray [r, 2].
        crossing: of the entrance pupil [r, 2] in mm.
        squares: of distances from the axis [r, k] on surfaces, over those of their rims.
        line_weight: how much [r] slope and crossing count.
        rim_weight: how much [r] the squares count.
    """

    tangents: tuple[Float[Array, "*r"], Float[Array, "*r"]]
    target: tuple[Float[Array, "*r"], Float[Array, "*r"]]
    slope: Float[Array, "*r 2"]
    crossing: Float[Array, "*r 2"]
    squares: Float[Array, "*r k"]
    line_weight: Float[Array, "*r"]
    rim_weight: Float[Array, "*r"]


def shares(scales: _Scales, tangents: Pair, target: Pair) -> tuple[Pair, Pair]:
    """The vectors t and T."""
    film, lean, pupil = scales
    x, y = tangents[0] * film, tangents[1] * film
    return (x, y), ((target[0] - lean * x) * pupil, (target[1] - lean * y) * pupil)


def placed(
    scales: _Scales, rays: TracedRays
) -> tuple[_Scales, TracedRays, tuple[tuple[Array, Array], tuple[Array, Array]]]:
    """The scales, and the rays with their vectors t and T, without derivatives by where rays are."""
    rays = eqx.tree_at(
        lambda r: (r.tangents, r.target, r.line_weight, r.rim_weight),
        rays,
        replace_fn=jax.lax.stop_gradient,
    )
    scales = jax.lax.stop_gradient(scales)
    return scales, rays, jax.vmap(lambda a, b: shares(scales, a, b))(rays.tangents, rays.target)


def invariants(t: Pair, T: Pair) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """2 u - 1, v and 2 w - 1: each between -1 and 1."""
    (x, y), (X, Y) = t, T
    return 2.0 * (x * x + y * y) - 1.0, x * X + y * Y, 2.0 * (X * X + Y * Y) - 1.0


def terms(degree: int, variables: int = 3) -> list[tuple[int, ...]]:
    """Exponents of the variables in the order of coefficients: lower total degrees first."""
    powers = itertools.product(range(degree + 1), repeat=variables)
    return sorted((each for each in powers if sum(each) <= degree), key=lambda each: (sum(each), each))


def polynomial(
    coefficients: Float[Array, " m"], degree: int, *variables: Float[Array, ""]
) -> Float[Array, ""]:
    """By Horner's rule in the first variable, for each power of it in the next, and so on.

    That is one multiplication for each term.
    """
    number = {each: place for place, each in enumerate(terms(degree, len(variables)))}

    def along(fixed: tuple[int, ...], variables: tuple[Array, ...]) -> Array:
        if not variables:
            return coefficients[number[fixed]]
        highest = degree - sum(fixed)
        total = along((*fixed, highest), variables[1:])
        for power in range(highest - 1, -1, -1):
            total = total * variables[0] + along((*fixed, power), variables[1:])
        return total

    return along((), variables)


def fit_transfers(
    scales: _Scales, rays: TracedRays, degrees: Sequence[int]
) -> list[tuple[Transfer, Float[Array, "r 2"], Float[Array, "r 2"]]]:
    """Polynomials of least squares for some increasing `degrees`, with what is left of slopes and crossings.

    Differentiable by what the rays do; where they are, and what counts how much, is taken as it is.
    """
    scales, rays, (t, T) = placed(scales, rays)
    place = jnp.stack(jax.vmap(invariants)(t, T), axis=1)
    table = jax.vmap(lambda each: monomials(each, degrees[-1]))(place)
    # Columns of A and of B in turns, those of lower degrees first: then the first few columns are those of
    # the lower degrees, and one factorisation serves for all.
    along = [
        jnp.stack([t[k][:, None] * table, T[k][:, None] * table], axis=2).reshape(len(table), -1)
        for k in range(2)
    ]
    wanted = jnp.concatenate([jnp.stack([rays.slope[:, k], rays.crossing[:, k]], axis=1) for k in range(2)])
    sizes = [len(terms(degree)) for degree in degrees]
    weight = jnp.concatenate([rays.line_weight] * 2)
    lines = least_squares(jnp.concatenate(along), wanted, weight, [2 * size for size in sizes])
    rims = least_squares(table, rays.squares, rays.rim_weight, sizes)
    found = []
    for degree, (line, line_rest), (rim, _) in zip(degrees, lines, rims, strict=True):
        columns = line.T.reshape(2, -1, 2).swapaxes(1, 2).reshape(4, -1)
        made = Transfer(*scales, columns, rim.T, degree, is_round=True)
        slope_rest, crossing_rest = jnp.moveaxis(line_rest.reshape(2, -1, 2), 2, 0)
        found.append((made, slope_rest.T, crossing_rest.T))
    return found


def fit_uneven_transfers(
    scales: _Scales, rays: TracedRays, degrees: Sequence[int]
) -> list[tuple[Transfer, Float[Array, "r 2"], Float[Array, "r 2"]]]:
    """As `fit_transfers`, of a lens that is not round, by rays over all of the film and the opening."""
    scales, rays, (t, T) = placed(scales, rays)
    table = jax.vmap(lambda *place: monomials(jnp.stack(place), degrees[-1]))(*t, *T)
    sizes = [len(terms(degree, 4)) for degree in degrees]
    wanted = jnp.concatenate([rays.slope, rays.crossing], axis=1)
    lines = least_squares(table, wanted, rays.line_weight, sizes)
    rims = least_squares(table, rays.squares, rays.rim_weight, sizes)
    return [
        (Transfer(*scales, line.T, rim.T, degree, is_round=False), rest[:, :2], rest[:, 2:])
        for degree, (line, rest), (rim, _) in zip(degrees, lines, rims, strict=True)
    ]


def monomials(place: Float[Array, " v"], degree: int) -> Float[Array, " m"]:
    """All terms in the variables of a `place`, without coefficients."""
    powers = [jnp.ones_like(place)]
    for _ in range(degree):
        powers.append(powers[-1] * place)
    table, exponents = jnp.stack(powers), np.asarray(terms(degree, len(place))).T
    factors = (table[power, variable] for variable, power in enumerate(exponents))
    return functools.reduce(jnp.multiply, factors)


def least_squares(
    matrix: Float[Array, "r m"], wanted: Float[Array, "r k"], weight: Float[Array, " r"], sizes: list[int]
) -> list[tuple[Float[Array, "_ k"], Float[Array, "r k"]]]:
    """The solution by the first columns alone, for some numbers of them, and what it leaves."""
    q, r = jnp.linalg.qr(weight[:, None] * matrix)
    projected = q.T @ (weight[:, None] * wanted)
    found = []
    for size in sizes:
        answer = jax.scipy.linalg.solve_triangular(r[:size, :size], projected[:size])
        found.append((answer, matrix[:, :size] @ answer - wanted))
    return found
