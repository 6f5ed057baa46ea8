"""Light that falls off towards the corners, whatever point of the opening it comes through."""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any, SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import real_number
from focusjax._programs import jit
from focusjax.geometry import Camera, LensRay
from focusjax.lens._base import AbstractLens
from focusjax.lens._height_curve import checked_table
from focusjax.lens._length import length
from focusjax.lens._wrapper import AbstractDimmedLens


class AbstractFalloff(eqx.Module):
    """The share of the axis's light that a film point gets."""

    @abc.abstractmethod
    def share(self, camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, ""]:
        """At a film point in pixels: 1 on the axis."""


class CosineFalloff(AbstractFalloff):
    """Natural vignetting, the cosine of the angle to the axis to the fourth power (Kyaw 2013 eq. 4.14).

    Attributes:
        power: 4, as of a lens whose pupils look the same from everywhere; below it for many wide lenses.
    """

    power: Float[Array, ""]

    def share(self, camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, ""]:
        tangents = (film_point - camera.principal_point) / camera.focal_px
        return (1.0 + tangents @ tangents) ** (-0.5 * self.power)


class TableFalloff(AbstractFalloff):
    """Shares measured at heights on the film, with straight lines between. `table_falloff` makes one.

    Attributes:
        heights: [k] metres from the axis, the first 0.
        shares: [k] of the light on the axis.
    """

    heights: Float[Array, " k"]
    shares: Float[Array, " k"]

    def share(self, camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, ""]:
        pixel = camera.sensor_width / camera.width
        height = length(film_point - camera.principal_point) * pixel
        number = jnp.searchsorted(self.heights, jax.lax.stop_gradient(height)) - 1
        number = jnp.clip(number, 0, len(self.heights) - 2)
        slope = (self.shares[number + 1] - self.shares[number]) / (
            self.heights[number + 1] - self.heights[number]
        )
        # The last line goes on beyond the table, but never below darkness.
        return jnp.maximum(self.shares[number] + slope * (height - self.heights[number]), 0.0)


class DarkenedLens(AbstractDimmedLens):
    """A lens with light that falls off towards the corners. Blur and its shape stay as they are.

    Rays of a film point are weighted by its share. The axis is the camera's, also of a tilted lens. Lenses
    made of real glass have their falloff by themselves.

    Attributes:
        lens: the lens without it.
        falloff: how much light there is where.
    """

    lens: AbstractLens
    falloff: AbstractFalloff

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        ray = self.lens.ray(camera, film_point, pupil_point)
        return dataclasses.replace(ray, weight=ray.weight * self.falloff.share(camera, film_point))


def cosine_falloff(power: SupportsFloat = 4.0) -> CosineFalloff:
    """A `CosineFalloff` with a checked power.

    Raises:
        ValueError: a power below 0, or one that is not finite.
    """
    if not 0.0 <= real_number(power, "the power of the cosine", "0 or more, such as 4") < float("inf"):
        raise ValueError(f"the power of the cosine is {float(power):g}; expected 0 or more, such as 4")
    return CosineFalloff(jnp.asarray(float(power), dtype=float))


def table_falloff(
    camera: Camera,
    heights: ArrayLike | Sequence[float],
    shares: ArrayLike | Sequence[float],
    *,
    extrapolate: bool = False,
) -> TableFalloff:
    """A `TableFalloff` with checked values.

    Args:
        camera: whose frame the table has to cover.
        heights: metres on the film from the axis, rising from 0.
        shares: of the light on the axis, from 1.
        extrapolate: let the table's last line go on to the corner that it does not reach.

    Raises:
        ValueError: numbers that do not match, heights that do not rise from 0, shares below 0, or a table
            that ends before the picture does, unless it is to be extrapolated.
    """
    places, values = checked_table(heights, shares, "a falloff table")
    if (values < 0).any() or not values[0] > 0:
        raise ValueError(
            f"a falloff table has shares {values.tolist()}; expected 0 or more, and 1 on the axis"
        )
    if not extrapolate:
        require_reach("the falloff table", float(places[-1]), camera, slack=1e-6)
    return TableFalloff(jnp.asarray(places, dtype=float), jnp.asarray(values / values[0], dtype=float))


def require_reach(what: str, reach: float, camera: Camera, *, slack: float) -> None:
    """Refuse a table `what` that ends, `reach` metres from the axis, before the picture's farthest corner.

    A share `slack` of the way there may be missing.
    """
    corner = corner_height(camera)
    if reach < corner * (1.0 - slack):
        raise ValueError(
            f"{what} reaches {1e3 * reach:.2f} mm from the axis, and the picture's farthest corner is"
            f" {1e3 * corner:.2f} mm away; add the {1e3 * (corner - reach):.2f} mm that are missing, or ask"
            " for extrapolation"
        )


def corner_height(camera: Camera) -> float:
    """Metres on the film from the axis to the picture's farthest corner."""
    middle = np.asarray(camera.principal_point, dtype=float)
    farthest = np.maximum(middle, np.array([camera.width, camera.height]) - middle)
    return float(np.hypot(*farthest) * float(camera.sensor_width) / camera.width)


@jit
def illumination(
    lens: AbstractLens, camera: Camera, film_points: Float[Array, "n 2"], *, side: int = 64
) -> Float[Array, "n"]:
    """The light that each film point gets of a uniform scene of radiance 1: the mean weight of its rays.

    1 where nothing is lost. A lens that treats colours differently is taken at a colour between them.

    Args:
        lens: any lens.
        camera: the camera it stands in.
        film_points: places in the picture, in pixels.
        side: the square root of the number of rays, which lie on a grid over the opening.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.lens import thin_lens
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=36, height=24, focal_length=0.018)
        >>> lens = DarkenedLens(thin_lens(focus_distance=2, aperture_radius=0.01), cosine_falloff())
        >>> round(float(illumination(lens, camera, jnp.array([[36.0, 12.0]]))[0]), 6)
        0.25
    """
    along = (jnp.arange(side, dtype=film_points.dtype) + 0.5) / side
    grid = jnp.stack(jnp.meshgrid(along, along), axis=-1).reshape(-1, 2)
    pupil = jax.vmap(lens.pupil_point)(grid)

    def one(film_point: Any) -> Float[Array, ""]:
        return jnp.mean(jax.vmap(lambda point: lens.ray(camera, film_point, point).weight)(pupil))

    return jax.lax.map(one, film_points)
