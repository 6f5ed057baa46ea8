"""Real lenses for light of several wavelengths, with the colour that their glass makes."""

from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import numpy as np

from focusjax._arguments import require_kind
from focusjax.lens._base import AbstractLens, Channel
from focusjax.lens._focused import at_wavelength
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._wrapper import RGB, AbstractColouredLens, colour_bands
from focusjax.optics import RGB_WAVELENGTHS


class SpectralLens(AbstractColouredLens):
    """A real lens that refracts light of several wavelengths each by its own indices.

    Attributes:
        lens: for the one wavelength that it was focused with, a `PrescriptionLens` or `FittedLens`.
        bands: the same lens for each wavelength, red, green and blue if there are three, its film in the same
            place.
        colours: how much each counts in red, green and blue (static).
    """

    lens: AbstractLens
    bands: tuple[AbstractLens, ...]
    colours: tuple[tuple[float, float, float], ...] = eqx.field(static=True, default=RGB)

    def channels(self) -> tuple[Channel, ...]:
        return tuple(Channel(band, colour) for band, colour in zip(self.bands, self.colours, strict=True))


def spectral_lens(
    lens: PrescriptionLens,
    wavelengths: Sequence[SupportsFloat] = RGB_WAVELENGTHS,
    *,
    bands: int = 3,
) -> SpectralLens:
    """A real lens with its colour: axial, which tints what is out of focus, and lateral, towards the corners.

    Args:
        lens: focused for one wavelength, and level: turn what this makes (`tilted_lens`).
        wavelengths: of red, green and blue in nm; those of Lee10 if not given.
        bands: wavelengths from red to blue, odd: 3, or more of them between, which count for the two colours
            that they lie between. Fringes are then smooth, and take as many times the rays.

    Raises:
        ValueError: not three wavelengths, or one for which glass has no index; an even number of bands.

    Example:
        >>> camera = fj.look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> lens = fj.prescription_lens(fj.lens_preset("cooke_triplet_50mm_f4"), camera, focus_distance=2.0)
        >>> len(fj.spectral_lens(lens, bands=5).channels())
        5
    """
    remedy = "`prescription_lens` makes one; tilt it afterwards"
    require_kind(lens, PrescriptionLens, "spectral_lens(lens)", remedy, "lens")
    numbers = [float(each) for each in wavelengths]
    if len(numbers) != 3:
        raise ValueError(f"wavelengths are {numbers} nm; expected three, of red, green and blue")
    places, colours = colour_bands(bands)
    middle = np.interp(places, np.arange(3.0), numbers)
    return SpectralLens(lens, tuple(at_wavelength(lens, each) for each in middle), colours)
