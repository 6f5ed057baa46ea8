"""Points that follow a density given by a table, by inverting its cumulative sums."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax.lens._length import root


class Density(eqx.Module):
    """A density over the unit square, bilinear between its values on a grid of nodes.

    Attributes:
        values: not negative; [j, i] is at x = i / (columns - 1), y = j / (rows - 1).
    """

    values: Float[Array, "rows columns"]

    def mean(self) -> Float[Array, ""]:
        """The mean over the square."""
        return _trapezoids(_trapezoids(self.values))

    def at(self, place: Float[Array, "2"]) -> Float[Array, ""]:
        """The density at (x, y); beyond the square as on its nearest border."""
        rows, columns = self.values.shape
        (i, u), (j, v) = (cell(place[k] * last, last) for k, last in ((0, columns - 1), (1, rows - 1)))
        near, far = self.values[j], self.values[j + 1]
        return (1.0 - v) * ((1.0 - u) * near[i] + u * near[i + 1]) + v * ((1.0 - u) * far[i] + u * far[i + 1])

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        """The point (x, y) for a uniform `sample`: y by the density of whole rows, then x along its row.

        Where a density is linear from p to q across a cell, the share c of it lies before t with
        p t + (q - p) t^2 / 2 = c, exactly. Differentiable in the values.
        """
        rows = _running(self.values)
        y_cell, y = _inverse(_running(rows[:, -1]), rows[:, -1], sample[1])
        mix = (1.0 - y, y_cell), (y, y_cell + 1)

        def along(table: Float[Array, "rows columns"], i: Int[Array, ""]) -> Float[Array, ""]:
            return sum((share * table[j, i] for share, j in mix), jnp.zeros_like(y))

        last = self.values.shape[1] - 1
        wanted = sample[0] * along(rows, jnp.asarray(last))

        # By halves instead of at once, so that a million samples need no million rows of memory.
        def halve(_: Int[Array, ""], ends: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = ends
            middle = (low + high) // 2
            before = along(rows, middle) <= wanted
            return jnp.where(before, middle, low), jnp.where(before, high, middle)

        start = jnp.zeros_like(y_cell), jnp.full_like(y_cell, last)
        x_cell = jax.lax.fori_loop(0, last.bit_length(), halve, start)[0]
        left = wanted - along(rows, x_cell)
        x = _share(along(self.values, x_cell), along(self.values, x_cell + 1), left)
        columns, count = last, self.values.shape[0] - 1
        return jnp.stack([(x_cell.astype(x.dtype) + x) / columns, (y_cell.astype(y.dtype) + y) / count])


def _running(values: Float[Array, "*n m"]) -> Float[Array, "*n m"]:
    """The integral up to each node, in cells."""
    sums = jnp.cumsum(0.5 * (values[..., 1:] + values[..., :-1]), axis=-1)
    return jnp.concatenate([jnp.zeros_like(sums[..., :1]), sums], axis=-1)


def _trapezoids(values: Float[Array, "*n m"]) -> Float[Array, "*n"]:
    return _running(values)[..., -1] / (values.shape[-1] - 1)


def _inverse(
    running: Float[Array, " n"], values: Float[Array, " n"], sample: Float[Array, ""]
) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """The cell that holds the share `sample` of an integral, and how far into it that is."""
    wanted = sample * running[-1]
    cell = jnp.clip(jnp.searchsorted(running, wanted, side="right") - 1, 0, len(values) - 2)
    return cell, _share(values[cell], values[cell + 1], wanted - running[cell])


def _share(p: Float[Array, ""], q: Float[Array, ""], c: Float[Array, ""]) -> Float[Array, ""]:
    """The t with p t + (q - p) t^2 / 2 = c; 0 where there is nothing."""
    square = p**2 + 2.0 * (q - p) * c
    below = p + root(square)
    some = below > 0.0
    return jnp.clip(jnp.where(some, 2.0 * c / jnp.where(some, below, 1.0), 0.0), 0.0, 1.0)


def cell(x: Float[Array, ""], count: int) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """Which of `count` unit intervals holds x, and how far into it x is, 0 to 1."""
    x = jnp.clip(x, 0.0, float(count))
    index = jnp.minimum(jnp.floor(x), count - 1.0)
    return index.astype(int), x - jax.lax.stop_gradient(index)
