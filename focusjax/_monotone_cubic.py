"""Curves through tables that rise and fall only where the table does (Fritsch and Carlson 1980)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


def monotone_cubic(
    places: Float[Array, " k"],
    values: Float[Array, " k"],
    x: Float[Array, "*n"],
    *,
    level_start: bool = False,
) -> Float[Array, "*n"]:
    """The monotone cubic through values at places, constant beyond them.

    Its slope is continuous between the ends, and it is straight where the table is. Differentiable in `x` and
    `values`.

    Args:
        places: rising.
        values: there.
        x: where to look.
        level_start: let it start with the slope 0 instead of the first line's.
    """
    number, t = place_in_table(places, x.astype(values.dtype))
    c0, c1, c2, c3 = jnp.moveaxis(monotone_pieces(places, values, level_start=level_start)[number], -1, 0)
    return c0 + t * (c1 + t * (c2 + t * c3))


def place_in_table(
    places: Float[Array, " k"], x: Float[Array, "*n"]
) -> tuple[Int[Array, "*n"], Float[Array, "*n"]]:
    """The piece that `x` is in, the first or the last if beyond them, and where in it, from 0 to 1."""
    x = jnp.clip(x, places[0], places[-1])
    inner = places[1:-1].reshape((1,) * x.ndim + (-1,))
    # Tables are short: comparing with all of them is quicker than a search.
    number = (jax.lax.stop_gradient(x)[..., None] > inner).sum(axis=-1)
    return number, (x - places[number]) / (places[number + 1] - places[number])


def monotone_pieces(
    places: Float[Array, " k"], values: Float[Array, " k"], *, level_start: bool = False
) -> Float[Array, "pieces 4"]:
    """Coefficients of 1, t, t^2 and t^3 of each piece, t going from 0 to 1; arguments as above."""
    gaps, steps = jnp.diff(places), jnp.diff(values)
    secants = steps / gaps
    before, after, near, far = secants[:-1], secants[1:], gaps[:-1], gaps[1:]
    # The harmonic mean of the secants, weighted by the gaps, where both go one way; else 0.
    one_way = before * after > 0.0
    first, second = jnp.where(one_way, before, 1.0), jnp.where(one_way, after, 1.0)
    a, b = 2.0 * far + near, far + 2.0 * near
    inner = jnp.where(one_way, (a + b) / (a / first + b / second), 0.0)
    start = jnp.zeros_like(secants[:1]) if level_start else secants[:1]
    slopes = jnp.concatenate([start, inner, secants[-1:]])
    out, arriving = gaps * slopes[:-1], gaps * slopes[1:]
    return jnp.stack(
        [values[:-1], out, 3.0 * steps - 2.0 * out - arriving, out + arriving - 2.0 * steps], axis=-1
    )
