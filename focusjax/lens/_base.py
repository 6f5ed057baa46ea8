"""What every lens answers: rays for a film point and a pupil point, and the blur they make."""

import abc
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture

_Picture = TypeVar("_Picture", Float[Array, "*n 3"], Float[np.ndarray, "*n 3"])


class AbstractLens(eqx.Module):
    """A source of lens rays. One ray, one film point, one pupil point: callers vmap.

    The picture is the mean over rays of the radiance along each times its weight: rays through points of
    the opening that are drawn with the density of its light, so that a weight is only what is lost beyond
    it (vignetting), 1 where nothing is.
    """

    @abc.abstractmethod
    def opening(self) -> AbstractAperture:
        """The shape of the opening, in units of the aperture radius."""

    def pupil_point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        """Map a uniform `sample` of the unit square to a point of the opening, spread as its light is.

        The point is in units of the aperture radius, in picture axes (x right, y down), so its
        norm is at most 1.
        """
        return self.opening().point(sample)

    def channels(self) -> "tuple[Channel, ...]":
        """The lenses that light of different colours sees; none where it makes no difference.

        Each treats all colours alike and has the same `opening`. The bounds (`footprint`, `reach`,
        `parallax`) of this lens hold for all of them; its `ray` and `blur` are those of a colour between.
        """
        return ()

    def vignettes(self) -> bool:
        """Whether some rays of a film point may arrive with less of their light than others.

        Where they do not, all of a film point have one weight, whatever it is, and no ray is spent on it.
        """
        return False

    @abc.abstractmethod
    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        """The ray that carries light from the scene through `pupil_point` to `film_point`.

        `film_point` is in output pixels: the place in the picture that receives the light.
        """

    @abc.abstractmethod
    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Signed circle-of-confusion diameter in pixels: positive behind the focus, else negative."""

    @abc.abstractmethod
    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        """Centre [2] and radius in pixels of a disk that holds all rays of `film_point` at `disparity`.

        Rays are linear in disparity, so the disks at both ends of a disparity interval bound all
        those between. The disks of a pixel's corners bound, in the same sense, those of the film points
        within it, to a thousandth of a pixel.
        """

    @abc.abstractmethod
    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        """How far in pixels, along x or y, rays are at most from their film points at `disparity`.

        A bound over all film points of the picture, and convex in the disparity.
        """

    @abc.abstractmethod
    def parallax(self, camera: Camera) -> Float[Array, ""]:
        """Largest |b| of any ray: pixels that the lens's rim moves per dioptre."""


class Channel(eqx.Module):
    """Light of one colour.

    Attributes:
        lens: what it sees of the lens.
        colour: how much it counts in red, green and blue (static); each sums to 1 over a lens's channels.
    """

    lens: AbstractLens
    colour: tuple[float, float, float] = eqx.field(static=True)


def in_colour(seen: Callable[..., _Picture], *lenses: AbstractLens) -> _Picture | Array:
    """What is `seen` through lenses by all colours: that of each channel, in its share.

    Lenses that treat all colours alike are looked through once, others once for each channel.

    Args:
        seen: a function of as many lenses, that treat all colours alike.
        lenses: one, or several of the same channels.
    """
    channels = list(zip(*(lens.channels() for lens in lenses), strict=True))
    if not channels:
        return seen(*lenses)
    pictures = [seen(*(channel.lens for channel in each)) for each in channels]
    mixed = []
    for number in range(3):
        shares = [each[0].colour[number] for each in channels]
        parts = [
            share * picture[..., number] for share, picture in zip(shares, pictures, strict=True) if share
        ]
        mixed.append(sum(parts[1:], parts[0]))
    return jnp.stack(mixed, axis=-1)


def frame_corners(camera: Camera, dtype: jnp.dtype) -> Float[Array, "4 2"]:
    """The corners of the frame in pixels."""
    return jnp.array([(x, y) for x in (0, camera.width) for y in (0, camera.height)], dtype=dtype)
