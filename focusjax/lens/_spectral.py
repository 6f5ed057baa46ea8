"""Real lenses for light of several wavelengths, with the colour that their glass makes."""

from collections.abc import Sequence
from typing import SupportsFloat

from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens, Channel
from focusjax.lens._coloured import AbstractColouredLens
from focusjax.lens._focused import at_wavelength
from focusjax.lens._prescription import PrescriptionLens
from focusjax.optics import RGB_WAVELENGTHS

_COLOURS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class SpectralLens(AbstractColouredLens):
    """A real lens that refracts red, green and blue light each by its own indices.

    Attributes:
        lens: for the one wavelength that it was focused with, a `PrescriptionLens` or `FittedLens`.
        bands: the same lens for red, green and blue, its film in the same place.
    """

    lens: AbstractLens
    bands: tuple[AbstractLens, AbstractLens, AbstractLens]

    def channels(self) -> tuple[Channel, ...]:
        return tuple(Channel(band, colour) for band, colour in zip(self.bands, _COLOURS, strict=True))


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
