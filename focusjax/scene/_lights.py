"""Lights that shine on surfaces. Their light does not pass through the lens by itself."""

import abc
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import real_numbers
from focusjax._device import device_array
from focusjax.scene._vectors import norm, unit


class AbstractLight(eqx.Module):
    """A source without extent; shadows are not cast."""

    @abc.abstractmethod
    def arriving(self, point: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Unit direction towards the light [3], and the linear RGB light [3] that falls in there.

        The light is scaled so that a white Lambert surface facing it has that radiance; the
        factor pi between irradiance and radiance is thus part of it.
        """


class DirectionalLight(AbstractLight):
    """Parallel light, as from the sun.

    Attributes:
        direction: where the light travels, in world axes [3]; any length but zero.
        colour: radiance [3] of a white Lambert surface that faces the light.
    """

    direction: Float[Array, "3"]
    colour: Float[Array, "3"]

    def arriving(self, point: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        del point
        return unit(-self.direction, otherwise=jnp.zeros_like(self.direction)), self.colour


class PointLight(AbstractLight):
    """A small lamp whose light falls off with the square of the distance.

    Attributes:
        position: world metres [3].
        intensity: radiance [3] of a white Lambert surface that faces the lamp from 1 m.
    """

    position: Float[Array, "3"]
    intensity: Float[Array, "3"]

    def arriving(self, point: Float[Array, "3"]) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        offset = self.position - point
        distance = norm(offset)
        # A point in the lamp itself gets no direction, hence no light, rather than infinitely much.
        inside = distance == 0.0
        falloff = 1.0 / jnp.where(inside, 1.0, distance) ** 2
        return unit(offset, otherwise=jnp.zeros_like(offset)), self.intensity * falloff


def directional_light(
    direction: ArrayLike | Sequence[float], colour: ArrayLike | Sequence[float] = 1.0
) -> DirectionalLight:
    """A `DirectionalLight` with checked values; a single number for `colour` is a grey.

    Raises:
        ValueError: a direction of length zero, a negative colour, or a value that is not finite.

    Example:
        >>> sun = fj.directional_light((0, -1, 0), colour=0.5)
        >>> sun.direction.tolist(), sun.colour.tolist()
        ([0.0, -1.0, 0.0], [0.5, 0.5, 0.5])
    """
    travel = _vector(direction, "direction of a directional light")
    if not np.asarray(travel).any():
        raise ValueError("the direction of a directional light is zero; expected where its light travels")
    return DirectionalLight(travel, light_colour(colour, "colour of a directional light"))


def point_light(
    position: ArrayLike | Sequence[float], intensity: ArrayLike | Sequence[float] = 1.0
) -> PointLight:
    """A `PointLight` with checked values; a single number for `intensity` is a grey.

    Raises:
        ValueError: a negative intensity, or a value that is not finite.

    Example:
        >>> bulb = fj.point_light((0, 2, 0), intensity=0.5)
        >>> bulb.position.tolist(), bulb.intensity.tolist()
        ([0.0, 2.0, 0.0], [0.5, 0.5, 0.5])
    """
    return PointLight(
        _vector(position, "position of a point light"), light_colour(intensity, "intensity of a point light")
    )


def light_colour(value: ArrayLike | Sequence[float], what: str) -> Float[Array, "3"]:
    """Three linear values of at least zero, from three or from one for all.

    Raises:
        ValueError: another number of values, a negative one, or one that is not finite.
    """
    expected = "one number or three (red, green, blue)"
    colour = _known(real_numbers(value, f"the {what}", expected))
    if colour.shape not in ((), (3,)):
        raise ValueError(f"the {what} is {value}; expected {expected}")
    if not np.isfinite(colour).all() or not (colour >= 0).all():
        raise ValueError(f"the {what} is {value}; expected finite values of at least 0")
    return device_array(np.broadcast_to(colour, (3,)))


def _vector(value: ArrayLike | Sequence[float], what: str) -> Float[Array, "3"]:
    vector = _known(real_numbers(value, f"the {what}", "three finite numbers"))
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"the {what} is {value}; expected three finite numbers")
    return device_array(vector)


def _known(values: ArrayLike) -> Float[np.ndarray, "*shape"]:
    """Known numbers in the precision of the device, in which what is too large is infinite."""
    with np.errstate(over="ignore"):
        return np.asarray(values, dtype=jax.dtypes.canonicalize_dtype(float))
