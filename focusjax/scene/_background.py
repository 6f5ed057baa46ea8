"""What is seen where no surface is: light from infinity, at disparity 0."""

import abc
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from focusjax.scene._images import read_image
from focusjax.scene._lights import light_colour
from focusjax.scene._vectors import unit


class AbstractBackground(eqx.Module):
    """Radiance that depends on direction only, as of things infinitely far away."""

    @abc.abstractmethod
    def radiance(self, direction: Float[Array, "3"]) -> Float[Array, "3"]:
        """Linear RGB radiance seen along the world `direction` [3] of any length."""


class ConstantBackground(AbstractBackground):
    """The same radiance [3] all around."""

    colour: Float[Array, "3"]

    def radiance(self, direction: Float[Array, "3"]) -> Float[Array, "3"]:
        del direction
        return self.colour


class GradientBackground(AbstractBackground):
    """A sky: linear in the elevation angle from straight down over the horizon to straight up.

    Attributes:
        bottom: radiance [3] straight down (-y).
        horizon: radiance [3] at elevation 0.
        top: radiance [3] straight up (+y).
    """

    bottom: Float[Array, "3"]
    horizon: Float[Array, "3"]
    top: Float[Array, "3"]

    def radiance(self, direction: Float[Array, "3"]) -> Float[Array, "3"]:
        share = _elevation(_direction(direction)) / (jnp.pi / 2)
        end = jnp.where(share < 0.0, self.bottom, self.top)
        return self.horizon + jnp.abs(share) * (end - self.horizon)


class ImageBackground(AbstractBackground):
    """An equirectangular picture of the whole surroundings, sampled bilinearly.

    Its middle is seen along world -z, its right half towards +x, its top row towards +y.

    Attributes:
        pixels: linear radiance [h, w, 3].
        turn: radians by which the surroundings are turned to the right (clockwise from above).
    """

    pixels: Float[Array, "h w 3"]
    turn: Float[Array, ""]

    def radiance(self, direction: Float[Array, "3"]) -> Float[Array, "3"]:
        height, width = self.pixels.shape[:2]
        x, y, z = _direction(direction)
        upright = (x == 0.0) & (z == 0.0)
        azimuth = jnp.arctan2(x, jnp.where(upright, 1.0, -z)) - self.turn
        column = (0.5 + azimuth / (2 * jnp.pi)) * width - 0.5
        row = (0.5 - _elevation(jnp.stack([x, y, z])) / jnp.pi) * height - 0.5
        left, above = jnp.floor(column), jnp.floor(row)
        columns = (left[None].astype(int) + jnp.arange(2)) % width
        # Half a pixel at each pole lies beyond the middle of the last row, which is all there is.
        rows = jnp.clip(above[None].astype(int) + jnp.arange(2), 0, height - 1)
        four = self.pixels[rows[:, None], columns[None, :]]
        across, down = column - left, row - above
        upper, lower = four[:, 0] + across * (four[:, 1] - four[:, 0])
        return upper + down * (lower - upper)


def constant_background(colour: ArrayLike | Sequence[float] = 0.0) -> ConstantBackground:
    """A `ConstantBackground`; a single number is a grey.

    Raises:
        ValueError: a negative value, or one that is not finite.

    Example:
        >>> fj.constant_background(0.5).radiance(jnp.array([0.0, 0.0, -1.0])).tolist()
        [0.5, 0.5, 0.5]
    """
    return ConstantBackground(light_colour(colour, "background colour"))


def gradient_background(
    bottom: ArrayLike | Sequence[float],
    horizon: ArrayLike | Sequence[float],
    top: ArrayLike | Sequence[float],
) -> GradientBackground:
    """A `GradientBackground`; single numbers are greys.

    Raises:
        ValueError: a negative value, or one that is not finite.

    Example:
        >>> sky = fj.gradient_background(bottom=0.1, horizon=0.5, top=1.0)
        >>> directions = jnp.array([(0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
        >>> [round(float(sky.radiance(direction)[0]), 6) for direction in directions]
        [0.1, 0.5, 1.0]
    """
    return GradientBackground(
        light_colour(bottom, "bottom colour of the background"),
        light_colour(horizon, "horizon colour of the background"),
        light_colour(top, "top colour of the background"),
    )


def image_background(path: str | Path, *, gain: float = 1.0, turn: float = 0.0) -> ImageBackground:
    """An `ImageBackground` from a file, OpenEXR (linear) or an sRGB picture.

    Args:
        path: equirectangular image, twice as wide as high.
        gain: factor on the radiance, at least 0.
        turn: degrees by which the surroundings are turned to the right.

    Raises:
        ValueError: the file cannot be read or holds values that are not finite; a bad gain.

    Example:
        >>> fj.save_exr("sky.exr", np.full((4, 8, 3), 0.25))
        >>> sky = fj.image_background("sky.exr", gain=2.0)
        >>> sky.radiance(jnp.array([0.0, 0.0, -1.0])).tolist()
        [0.5, 0.5, 0.5]
    """
    if not 0.0 <= gain < float("inf"):
        raise ValueError(f"the gain of the background image is {gain}; expected a finite value of at least 0")
    pixels = gain * jnp.asarray(read_image(path), dtype=float)
    if not bool(jnp.all(jnp.isfinite(pixels))):
        raise ValueError(f"background image {path} has values that are not finite; replace these pixels")
    return ImageBackground(pixels, jnp.deg2rad(jnp.asarray(turn, dtype=float)))


def _direction(direction: Float[Array, "3"]) -> Float[Array, "3"]:
    return unit(direction, otherwise=jnp.asarray([0.0, 0.0, -1.0], dtype=direction.dtype))


def _elevation(direction: Float[Array, "3"]) -> Float[Array, ""]:
    """Angle above the horizon in radians of a unit direction."""
    # An arcsine has no derivative at the poles; this form loses it there to zero instead of infinity.
    flat_square = direction[0] ** 2 + direction[2] ** 2
    upright = flat_square == 0.0
    flat = jnp.where(upright, 0.0, jnp.sqrt(jnp.where(upright, 1.0, flat_square)))
    return jnp.arctan2(direction[1], flat)
