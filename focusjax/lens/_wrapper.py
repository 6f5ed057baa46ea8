"""What lenses around another lens have in common: those that dim its rays, those that see colours apart."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._counts import require_counts
from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens, Channel
from focusjax.lens._length import length

RGB = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""What channels that are red, green and blue count in these."""


class AbstractLensWrapper(AbstractLens):
    """A lens with the opening and the blur of another one.

    Attributes:
        lens: the other one.
    """

    lens: eqx.AbstractVar[AbstractLens]

    def opening(self) -> AbstractAperture:
        return self.lens.opening()

    def vignettes(self) -> bool:
        return self.lens.vignettes()

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        return self.lens.blur(camera, film_point, disparity)


class AbstractDimmedLens(AbstractLensWrapper):
    """A lens whose rays are those of another one with other weights, all else being that lens's own.

    Attributes:
        lens: the other one.
    """

    def channels(self) -> tuple[Channel, ...]:
        return tuple(
            Channel(dataclasses.replace(self, lens=each.lens), each.colour) for each in self.lens.channels()
        )

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        return self.lens.footprint(camera, film_point, disparity)

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.lens.reach(camera, disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return self.lens.parallax(camera)


class AbstractColouredLens(AbstractLensWrapper):
    """A lens that each of its `channels` sees differently.

    It is looked through once for each channel, so that a picture takes so many times as long to trace. `ray`
    and `blur` are those of `lens`; the bounds hold for it and for all channels.

    Attributes:
        lens: the lens for a colour between, or with no colour of its own.
    """

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        return self.lens.ray(camera, film_point, pupil_point)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        disks = [each.footprint(camera, film_point, disparity) for each in self._all()]
        middle = sum((centre for centre, _ in disks), jnp.zeros_like(film_point)) / len(disks)
        return middle, jnp.stack([length(centre - middle) + radius for centre, radius in disks]).max()

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.stack([each.reach(camera, disparity) for each in self._all()]).max()

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return jnp.stack([each.parallax(camera) for each in self._all()]).max()

    def _all(self) -> list[AbstractLens]:
        return [self.lens, *(channel.lens for channel in self.channels())]


def colour_bands(number: int) -> tuple[Float[np.ndarray, " n"], tuple[tuple[float, float, float], ...]]:
    """Places of bands from red (0) over green (1) to blue (2), and how much each counts for the three.

    A band counts for the two colours that it lies between, the more the nearer it is.

    Raises:
        ValueError: an even number, or fewer than 3.
    """
    require_counts(bands=number)
    if number < 3 or number % 2 == 0:
        raise ValueError(f"there are {number} bands; expected 3, 5, 7 or another odd number")
    places = np.linspace(0.0, 2.0, number)
    shares = np.maximum(1.0 - np.abs(places[:, None] - np.arange(3.0)), 0.0)
    shares /= shares.sum(axis=0)
    return places, tuple((float(r), float(g), float(b)) for r, g, b in shares)
