"""What a lens that is not the same all around its axis does to rays, as polynomials fitted to traced ones.

With t and T as in `_transfer`, slope, crossing and the squares at rims are functions of the four numbers t_x,
t_y, T_x and T_y, with no symmetry to relate them: polynomials of total degree n in all four, which is the
aberrations of order n, of (n + 1) (n + 2) (n + 3) (n + 4) / 24 terms each.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.lens._length import Pair
from focusjax.lens._transfer import (
    AbstractTransfer,
    TracedRays,
    least_squares,
    monomials,
    placed,
    shares,
    terms,
)


class UnevenTransfer(AbstractTransfer):
    """The polynomials of a lens with any surfaces, in t_x, t_y, T_x and T_y.

    Attributes:
        film: as of `AbstractTransfer`.
        lean: likewise.
        pupil: likewise.
        lines: coefficients [4, m] of the slopes along x and y, and of where in mm a ray crosses the pupil.
        rims: as of `AbstractTransfer`.
        degree: likewise (static).
    """

    film: Float[Array, ""]
    lean: Float[Array, ""]
    pupil: Float[Array, ""]
    lines: Float[Array, "4 m"]
    rims: Float[Array, "k m"]
    degree: int = eqx.field(static=True)

    def __call__(self, tangents: Pair, target: Pair) -> tuple[Pair, Pair, Float[Array, ""]]:
        t, T = shares(self.film, self.lean, self.pupil, tangents, target)
        (x, y, X, Y), clearance = self.functions(*t, *T)
        return (x, y), (X, Y), clearance


def fit_uneven_transfers(
    film: Float[Array, ""],
    lean: Float[Array, ""],
    pupil: Float[Array, ""],
    rays: TracedRays,
    degrees: Sequence[int],
) -> list[tuple[UnevenTransfer, Float[Array, "r 2"], Float[Array, "r 2"], Float[Array, "r k"]]]:
    """As `fit_transfers`, of rays over all of the film and the opening."""
    scales, rays, (t, T) = placed(film, lean, pupil, rays)
    table = jax.vmap(lambda *place: monomials(jnp.stack(place), degrees[-1]))(*t, *T)
    sizes = [len(terms(degree, 4)) for degree in degrees]
    wanted = jnp.concatenate([rays.slope, rays.crossing], axis=1)
    lines = least_squares(table, wanted, rays.line_weight, sizes)
    rims = least_squares(table, rays.squares, rays.rim_weight, sizes)
    return [
        (UnevenTransfer(*scales, line.T, rim.T, degree), line_rest[:, :2], line_rest[:, 2:], rim_rest)
        for degree, (line, line_rest), (rim, rim_rest) in zip(degrees, lines, rims, strict=True)
    ]
