"""What a solve minimises, in closed form: quick enough to try many starts."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax._entries import entries
from focusjax.focus._image_points import AT_LEAST, AT_MOST, SAME, ImagePoints, one_sided
from focusjax.focus._parameters import BlurModel, Parameters, Start, blur_models, scales, with_free
from focusjax.focus._priors import PriorRows

# Rounding steps that a computed blur may be off by, relative to its largest term.
_ROUNDING = 4.0


class Objective(eqx.Module):
    """Errors in pixels of all rows, for given sides, as a function of the free parameters.

    A point's side is the sign that its blur is assumed to have; for a `SAME` row, that of the product
    with its reference's blur. With the right sides the errors are the true ones, with wrong ones they are no
    smaller, and each is a convex function of the blur.

    Attributes:
        points: the wishes, of which disparities and positions are in the models.
        own: blur of every point, or the place where it is shown.
        other: blur of every point's reference, when there are any.
        priors: expectations.
        start: all parameters, of which the free ones are replaced.
        scale: pixels per unit of every free parameter (see `scales`).
        columns: positions of the free parameters (static).
    """

    points: ImagePoints
    own: BlurModel
    other: BlurModel | None
    priors: PriorRows
    start: Parameters
    scale: Float[Array, "k"]
    columns: tuple[int, ...] = eqx.field(static=True)

    @property
    def relation(self) -> Int[Array, "n"] | None:
        """What every row wishes; None when all wish for a value."""
        return self.points.relation

    @property
    def counted(self) -> Bool[Array, "n"]:
        """Rows that have a say."""
        return self.points.weight > 0

    @property
    def share(self) -> Float[Array, "n"]:
        """Every row's part of all weight."""
        return self.points.weight / jnp.sum(self.points.weight)

    @property
    def prior_share(self) -> Float[Array, ""]:
        """Weight of the expectations in the unit of `share`."""
        return 1.0 / jnp.sum(self.points.weight)

    @property
    def two_sided(self) -> Bool[Array, "n"]:
        """Rows that leave their side open, and for which it makes a difference."""
        open_ = ~self.points.signed & self.counted
        return open_ if self.relation is None else open_ & (self.relation != AT_MOST)

    def parameters(self, value: Float[Array, "k"]) -> Parameters:
        """All parameters, with `value` for the free ones."""
        return with_free(self.start, self.columns, value)

    def natural_side(self, value: Float[Array, "k"]) -> Float[Array, "n"]:
        """The sides on which the points are with `value`; 1 for those whose side is wished for."""
        parameters = self.parameters(value)
        sign = jnp.where(self.own.value(parameters) >= 0, 1.0, -1.0)
        if self.other is not None:
            other = jnp.where(self.other.value(parameters) >= 0, 1.0, -1.0)
            sign = jnp.where(self.relation == SAME, sign * other, sign)
        return jnp.where(self.points.signed, 1.0, sign)

    def excess(self, value: Float[Array, "k"], side: Float[Array, "n"]) -> Float[Array, "n"]:
        """Blur, or place, over what is wished, in pixels, also where that is allowed."""
        parameters = self.parameters(value)
        own = self.own.value(parameters)
        led = side * own
        if self.relation is not None:
            # Not `jnp.abs`, which has no slope at 0.
            size = jnp.where(own >= 0.0, own, -own)
            led = jnp.where((self.relation == AT_MOST) & ~self.points.signed, size, led)
        led = led - self.points.target
        if self.other is not None:
            led = led - jnp.where(self.relation == SAME, self.other.value(parameters), 0.0)
        return led

    def errors(self, value: Float[Array, "k"], side: Float[Array, "n"]) -> Float[Array, "n"]:
        """Errors in pixels, for given sides."""
        return one_sided(self.excess(value, side), self.relation)

    def noise(self, value: Float[Array, "k"]) -> Float[Array, "n"]:
        """How much of the errors can be rounding, in pixels."""
        parameters = self.parameters(value)
        size = self.own.size(parameters) + jnp.abs(self.points.target)
        if self.other is not None:
            size = size + self.other.size(parameters)
        return _ROUNDING * jnp.finfo(size.dtype).eps * size

    def cost(self, value: Float[Array, "k"], side: Float[Array, "n"]) -> Float[Array, ""]:
        """Weighted mean of squared errors plus expectations, in px^2."""
        return self._cost_of(self.errors(value, side), value)

    def cost_and_slack(
        self, value: Float[Array, "k"], side: Float[Array, "n"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The cost, and how much of it can be rounding."""
        error, noise = self.errors(value, side), self.noise(value)
        return self._cost_of(error, value), self.share @ ((2.0 * jnp.abs(error) + noise) * noise)

    def _cost_of(self, error: Float[Array, "n"], value: Float[Array, "k"]) -> Float[Array, ""]:
        return self.share @ error**2 + self.prior_share * jnp.sum(self.priors(value) ** 2)

    def change(self, value: Float[Array, "k"], start: Float[Array, "k"]) -> Float[Array, ""]:
        """How much a picture changes from `start` to `value`, in pixels."""
        return jnp.linalg.norm(self.scale * (value - start))

    def slopes(
        self, value: Float[Array, "k"], side: Float[Array, "n"]
    ) -> tuple[Float[Array, "n"], Float[Array, "n k"]]:
        """Errors in pixels, and their slopes."""
        return with_slopes(lambda at: self.errors(at, side), value)

    def on(self, value: Float[Array, "k"], side: Float[Array, "n"]) -> Bool[Array, "n"]:
        """Rows whose wish holds the solution: all but limits that are kept with room to spare."""
        if self.relation is None:
            return jnp.ones_like(self.points.signed)
        excess = self.excess(value, side)
        near = 32.0 * jnp.sqrt(jnp.finfo(excess.dtype).eps)
        return jnp.where(
            self.relation == AT_MOST,
            excess > -near,
            jnp.where(self.relation == AT_LEAST, excess < near, True),
        )


def with_slopes(function: Callable[[Float[Array, "k"]], Any], value: Float[Array, "k"]) -> tuple[Any, Any]:
    """What a function returns, and its slopes on a last axis, in one pass."""
    slopes, found = jax.jacfwd(lambda at: (function(at),) * 2, has_aux=True)(value)
    return found, slopes


def make_objective(points: ImagePoints, start: Start, priors: PriorRows) -> Objective:
    """The objective of a solve from `start`."""
    own, other = blur_models(points, start)
    scale = entries(scales(start), start.columns)
    return Objective(points, own, other, priors, start.parameters(), scale, start.columns)
