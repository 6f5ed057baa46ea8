"""What the solved parameters are expected to be, besides the wishes."""

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._arguments import ArgumentError, real_number, require_kind
from focusjax._words import kind_of, shown
from focusjax.focus._parameters import PARAMETERS
from focusjax.geometry import Camera

_STOP = math.log(2.0) / 2.0
"""Relative change of the aperture radius per stop."""


@dataclasses.dataclass(frozen=True)
class Prior:
    """An expectation: adds ((parameter - value) / sigma)^2 to what the solve minimises.

    One sigma costs as much as a wish of weight 1 that is missed by one pixel.

    Attributes:
        value: focus distance in metres, f-number, tilt or swing in radians, focal length, shift or rise in
            metres.
        sigma: in dioptres for the focus, in stops for the f-number, else in the unit of `value`. Stops
            and angles are taken as proportional to the aperture's radius and to the plane's slope, as
            they are near `value`.

    Example:
        >>> Prior(2.8, sigma=1.0).sigma
        1.0
    """

    value: float
    sigma: float

    def __post_init__(self) -> None:
        real_number(self.value, "a prior's value", "a number")
        if not 0 < real_number(self.sigma, "a prior's sigma", "a positive finite number") < math.inf:
            raise ValueError(f"a prior's sigma is {shown(self.sigma)}; expected a positive finite number")
        if math.isnan(self.value):
            raise ValueError("a prior's value is nan; expected a number")


class PriorRows(eqx.Module):
    """Expectations as residuals (value - centre) / scale, of the free parameters.

    Attributes:
        centre: where each free parameter is expected.
        inverse: 1 / scale, 0 where nothing is expected.
    """

    centre: Float[Array, "k"]
    inverse: Float[Array, "k"]

    def __call__(self, value: Float[Array, "k"]) -> Float[Array, "k"]:
        """The residuals."""
        return (value - self.centre) * self.inverse


Numbers = Mapping[str, tuple[Float[Array, "*p"], Float[Array, "*p"]]]
"""Value and 1 / sigma of every free parameter by name; 0 of those of which nothing is expected.

Of many problems with a leading axis.
"""


def checked_priors(priors: Mapping[str, Prior], free: tuple[str, ...]) -> Numbers:
    """The priors as arrays for all free parameters, so that other priors do not compile the solve again.

    Raises:
        ArgumentError: a prior of something that is not free, one that no lens has, or what is no prior.
    """
    require_kind(priors, Mapping, "solve", "as in {'f_number': Prior(2.8, sigma=1)}", "priors")
    for name, prior in priors.items():
        key = f"priors.{name}"
        if name not in free:
            raise ArgumentError(
                f"there is a prior for {name!r}, which is not free; expected one of {list(free)}", key
            )
        if not isinstance(prior, Prior):
            raise ArgumentError(
                f"the prior of {name} is {kind_of(prior)}; expected a Prior with a value and a sigma, which"
                " says how far off it may be, as in Prior(2.8, sigma=1)",
                key,
            )
        if name in ("focus", "f_number", "focal_length") and not prior.value > 0:
            raise ArgumentError(
                f"the prior of {name} is {shown(prior.value)}; expected a positive number", key
            )
        if name != "focus" and not math.isfinite(prior.value):
            raise ArgumentError(f"the prior of {name} is {shown(prior.value)}; expected a finite number", key)
    return {name: _numbers(priors.get(name)) for name in free}


def _numbers(prior: Prior | None) -> tuple[Float[Array, ""], Float[Array, ""]]:
    value, inverse = (1.0, 0.0) if prior is None else (prior.value, 1.0 / float(prior.sigma))
    return jnp.asarray(value, dtype=float), jnp.asarray(inverse, dtype=float)


def prior_rows(priors: Numbers, free: tuple[str, ...], camera: Camera) -> PriorRows:
    """The expectations in the solve's own parameters (see `_parameters`)."""
    length = camera.focal_length
    rows = [_row(name, *priors[name], length) for name in free]
    centre, inverse = zip(*rows, strict=True)
    return PriorRows(jnp.stack(centre), jnp.stack(inverse))


def _row(
    name: str, value: Float[Array, ""], inverse: Float[Array, ""], length: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Centre and 1 / scale of one parameter."""
    assert name in PARAMETERS
    if name == "focus":
        return 1.0 / value, inverse
    if name == "f_number":
        radius = length / (2.0 * value)
        return radius, inverse / (_STOP * radius)
    if name == "focal_length":
        return value / length, length * inverse
    if name in ("shift", "rise"):
        return value, inverse
    slope = jnp.sin(value) / length
    return (-slope if name == "tilt" else slope), length * inverse / jnp.cos(value)
