"""Real lenses for light of several wavelengths, with the colour that their glass makes."""

from collections.abc import Sequence
from typing import SupportsFloat

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens, Channel
from focusjax.lens._prescription import PrescriptionLens, at_wavelength
from focusjax.optics import RGB_WAVELENGTHS

_COLOURS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class SpectralLens(AbstractLens):
    """A real lens that refracts red, green and blue light each by its own indices.

    It is looked through once for each, so that a picture takes three times as long to trace. `ray` and `blur`
    are those of the lens for the one wavelength that it was made for.

    Attributes:
        lens: for that wavelength.
        bands: the same lens for red, green and blue, its film in the same place.
    """

    lens: PrescriptionLens
    bands: tuple[PrescriptionLens, PrescriptionLens, PrescriptionLens]

    def opening(self) -> AbstractAperture:
        return self.lens.opening()

    def channels(self) -> tuple[Channel, ...]:
        return tuple(Channel(band, colour) for band, colour in zip(self.bands, _COLOURS, strict=True))

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        return self.lens.ray(camera, film_point, pupil_point)

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        return self.lens.blur(camera, film_point, disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        centres, radii = zip(
            *(each.footprint(camera, film_point, disparity) for each in (self.lens, *self.bands)), strict=True
        )
        middle = centres[0]
        square = jnp.stack([((centre - middle) ** 2).sum() for centre in centres])
        away = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
        return middle, (away + jnp.stack(radii)).max()

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return jnp.stack([each.reach(camera, disparity) for each in (self.lens, *self.bands)]).max()

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return jnp.stack([each.parallax(camera) for each in (self.lens, *self.bands)]).max()


def spectral_lens(
    lens: PrescriptionLens, camera: Camera, wavelengths: Sequence[SupportsFloat] = RGB_WAVELENGTHS
) -> SpectralLens:
    """A real lens with its colour: axial, which tints what is out of focus, and lateral, towards the corners.

    Args:
        lens: focused for one wavelength.
        camera: whose frame it was made for.
        wavelengths: of red, green and blue in nm; those of Lee10 if not given.

    Raises:
        ValueError: not three wavelengths, or one that is not positive.
    """
    numbers = [float(each) for each in wavelengths]
    if len(numbers) != 3 or not all(0.0 < each < float("inf") for each in numbers):
        raise ValueError(f"wavelengths are {numbers} nm; expected three, of red, green and blue")
    red, green, blue = (at_wavelength(lens, camera, each) for each in numbers)
    return SpectralLens(lens, (red, green, blue))
