"""The shape of the lens opening, and how much light passes where.

An opening is an outline around the middle, perhaps with a hole of the same shape in it, and a density of
light between the two. Rays are drawn with that density, so that each carries the same light and a bright
opening never brightens the picture: exposure is that of the f-number, whatever the shape.
"""

import abc
import math
import operator
from typing import Any, SupportsFloat, SupportsIndex

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax._arguments import real_number
from focusjax._device import device_array
from focusjax._few import largest_of_few
from focusjax.lens._length import root


class AbstractAperture(eqx.Module):
    """An opening inside the unit disk (x right, y down)."""

    @abc.abstractmethod
    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        """The point of the opening for a uniform `sample` of the unit square, spread as its `density` is."""

    @abc.abstractmethod
    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        """The point of the outline at `turn`, 0 to 1 once around. Equal turns sweep equal areas."""

    def hole(self) -> Float[Array, ""] | None:
        """The size of the hole, a share of the outline around it; None, as here, where there is none."""
        return None

    @abc.abstractmethod
    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        """Whether a point lies between hole and outline."""

    def density(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """Light per area at a point between hole and outline, relative to its mean there; here 1."""
        return jnp.ones_like(point[0])

    @abc.abstractmethod
    def finest(self) -> Float[Array, ""]:
        """Half the width of the narrowest part of its light, in aperture radii; less is on the safe side.

        Points out of focus become pictures of the opening, in which nothing is finer than that.
        """

    def at(self, place: Float[Array, "2"]) -> Float[Array, "2"]:
        """The point at a place (s, t) of the unit square, uniform by area whatever the density.

        The outline is s = 1, and s = 0 the hole's edge, or the middle where there is no hole; t turns.
        """
        hole = self.hole()
        share = place[0] if hole is None else hole**2 + (1.0 - hole**2) * place[0]
        return root(share) * self.rim(place[1])

    def share(self, point: Float[Array, "2"]) -> Float[Array, ""]:
        """Light per area at any point, as a share of all of it; 0 beside the opening."""
        # One number, not one of each point.
        turn = jnp.full((), 0.1, dtype=point.dtype)
        outline, along = jax.jvp(self.rim, (turn,), (jnp.ones_like(turn),))
        # Equal turns sweep equal areas, so that the rate at any turn is the area of the whole outline.
        area = 0.5 * (outline[0] * along[1] - outline[1] * along[0])
        hole = self.hole()
        if hole is not None:
            area *= 1.0 - hole**2
        return jnp.where(self.holds(point), self.density(point) / area, 0.0)


class Disk(AbstractAperture):
    """The full unit disk, by the concentric map of Shirley and Chiu.

    The map keeps neighbours together, so well-spread samples of the square stay well spread.

    Example:
        >>> lens = fj.thin_lens(focus_distance=2, aperture_radius=0.01, aperture=fj.Disk())
        >>> on_rim = lens.aperture.point(jnp.array([1.0, 0.5]))
        >>> round(float(jnp.hypot(*on_rim)), 6)
        1.0
    """

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        x, y = 2.0 * sample - 1.0
        wide = jnp.abs(x) > jnp.abs(y)
        radius = jnp.where(wide, x, y)
        safe = jnp.where(radius == 0.0, 1.0, radius)
        angle = jnp.where(wide, jnp.pi / 4 * y / safe, jnp.pi / 2 - jnp.pi / 4 * x / safe)
        return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        angle = 2.0 * jnp.pi * turn
        return jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        return point[0] ** 2 + point[1] ** 2 <= 1.0

    def finest(self) -> Float[Array, ""]:
        return jnp.ones(())


class Polygon(AbstractAperture):
    """Blades that form a regular polygon inscribed in the unit disk, with bulging sides.

    In the sector of one blade, at angle t from the middle of its side, the edge is at

        R(t)^2 = (1 - roundness) (cos(pi / n) / cos t)^2 + roundness,

    a straight blade at roundness 0 and the circle at 1. Its area up to t is then
    C(t) / 2 with C(t) = (1 - roundness) cos(pi / n)^2 tan t + roundness t, which Newton's
    method inverts to sample the shape uniformly.

    Attributes:
        rotation: angle in radians of the first corner, from +x towards +y (clockwise on screen).
        roundness: 0 for straight blades, 1 for a circle.
        blades: number of sides (static).
    """

    rotation: Float[Array, ""]
    roundness: Float[Array, ""]
    blades: int = eqx.field(static=True)

    def point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        return jnp.sqrt(sample[1]) * self.rim(sample[0])

    def rim(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        half = jnp.pi / self.blades
        straight = (1.0 - self.roundness) * jnp.cos(half) ** 2
        position = turn * self.blades
        sector = jnp.floor(position)
        share = 2.0 * (position - sector) - 1.0
        target = share * (straight * jnp.tan(half) + self.roundness * half)

        def newton(_: Any, t: Float[Array, ""]) -> Float[Array, ""]:
            value = straight * jnp.tan(t) + self.roundness * t
            slope = straight / jnp.cos(t) ** 2 + self.roundness
            return jnp.clip(t - (value - target) / slope, -half, half)

        t = jax.lax.fori_loop(0, 6, newton, share * half)
        edge = jnp.sqrt(straight / jnp.cos(t) ** 2 + self.roundness)
        angle = self.rotation + (2.0 * sector + 1.0) * half + t
        return edge * jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    def holds(self, point: Float[Array, "2"]) -> Bool[Array, ""]:
        # With h = |p| cos t, the largest of its coordinates across the sides, |p|^2 <= R(t)^2 needs no angle.
        middles = self.rotation + jnp.pi / self.blades * (2.0 * jnp.arange(self.blades) + 1.0)
        across = point[0] * jnp.cos(middles) + point[1] * jnp.sin(middles)
        square, height = point[0] ** 2 + point[1] ** 2, largest_of_few(across) ** 2
        straight = (1.0 - self.roundness) * jnp.cos(jnp.pi / self.blades) ** 2
        # Far beyond the rim products would overflow.
        return (square < 2.0) & (square * height <= straight * square + self.roundness * height)

    def finest(self) -> Float[Array, ""]:
        straight = (1.0 - self.roundness) * jnp.cos(jnp.pi / self.blades) ** 2
        return jnp.sqrt(straight + self.roundness)


def polygon(blades: int, *, rotation: SupportsFloat = 0.0, roundness: SupportsFloat = 0.0) -> Polygon:
    """A `Polygon` with checked values.

    Args:
        blades: number of sides, 3 or more.
        rotation: radians, clockwise on screen.
        roundness: 0 (straight blades) to 1 (circle).

    Raises:
        ValueError: fewer than 3 blades, or a roundness outside 0 to 1.

    Example:
        >>> square = fj.polygon(4)
        >>> lens = fj.thin_lens(focus_distance=2, aperture_radius=0.01, aperture=square)
        >>> lens.aperture.blades, bool(lens.aperture.holds(jnp.array([0.6, 0.6])))
        (4, False)
    """
    if isinstance(blades, bool) or not isinstance(blades, SupportsIndex) or operator.index(blades) < 3:
        raise ValueError(f"an aperture has {blades!r} blades; expected a whole number, at least 3, or a disk")
    if not 0.0 <= real_number(roundness, "blade roundness", "between 0 (straight) and 1 (round)") <= 1.0:
        raise ValueError(f"blade roundness is {roundness}; expected between 0 (straight) and 1 (round)")
    if not math.isfinite(real_number(rotation, "blade rotation", "a finite angle in radians")):
        raise ValueError(f"blade rotation is {rotation}; expected a finite angle in radians")
    return Polygon(
        rotation=device_array(float(rotation), dtype=float),
        roundness=device_array(float(roundness), dtype=float),
        blades=blades,
    )
