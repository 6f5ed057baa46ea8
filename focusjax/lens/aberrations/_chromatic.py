"""Lenses that treat colours differently, and lateral colour: a picture of another size for each channel."""

from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number, real_numbers
from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens, Channel, frame_corners
from focusjax.lens._wrapper import AbstractColouredLens, colour_bands
from focusjax.lens.aberrations._base import AberratedLens, AbstractAberration, Bounds
from focusjax.lens.aberrations._focus_offsets import FocusOffset
from focusjax.optics import FRAUNHOFER, RGB_WAVELENGTHS, AbstractGlass


class Magnification(AbstractAberration):
    """A picture larger about the principal point than that of the lens, in focus and out of it.

    Attributes:
        scale: how many times larger, near 1.
    """

    scale: Float[Array, ""]

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        # The film point gets what the lens alone would have sent nearer the middle.
        del pupil_point, b
        return (film_point - camera.principal_point) * (1.0 / self.scale - 1.0)

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        del parallax
        none = jnp.zeros_like(film_point[0])
        return Bounds(none, none, self.offset(camera, film_point, film_point, film_point), none)

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        del parallax
        away = jnp.abs(frame_corners(camera, self.scale.dtype) - camera.principal_point[None]).max()
        none = jnp.zeros_like(away)
        return Bounds(none, none, jnp.stack([none, none]), away * jnp.abs(1.0 / self.scale - 1.0))

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        del camera, parallax
        return jnp.zeros_like(film_point[0])


class ChromaticLens(AbstractColouredLens):
    """A lens with aberrations that each colour has for itself.

    Attributes:
        lens: the lens that they come on top of; it treats all colours alike.
        aberrations: those of each channel, one or more.
        colours: what each channel counts in red, green and blue (static); each sums to 1 over the channels.
    """

    lens: AbstractLens
    aberrations: tuple[tuple[AbstractAberration, ...], ...]
    colours: tuple[tuple[float, float, float], ...] = eqx.field(static=True)

    def channels(self) -> tuple[Channel, ...]:
        return tuple(
            Channel(AberratedLens(self.lens, own), colour)
            for own, colour in zip(self.aberrations, self.colours, strict=True)
        )

    def __check_init__(self) -> None:
        if self.lens.channels():
            raise ValueError("a chromatic lens was given a lens that is chromatic itself; give all at once")
        if len(self.aberrations) != len(self.colours):
            raise ValueError(
                f"{len(self.aberrations)} channels have {len(self.colours)} colours; give one each"
            )
        totals = np.sum(self.colours, axis=0)
        if not np.allclose(totals, 1.0):
            raise ValueError(
                f"the channels' shares of red, green and blue sum to {totals.tolist()}; expected 1"
            )


def chromatic_lens(
    lens: AbstractLens,
    *,
    focus_offset: Sequence[SupportsFloat] = (0.0, 0.0, 0.0),
    magnification: Sequence[SupportsFloat] = (1.0, 1.0, 1.0),
    bands: int = 3,
) -> ChromaticLens:
    """A `ChromaticLens` with axial and lateral colour.

    Args:
        lens: any lens that treats all colours alike.
        focus_offset: 1/m added to the focal disparity of red, green and blue. A simple lens bends blue more:
            (-c, 0, c), which gives what is behind the focus a blue rim and what is before it a red one.
        magnification: size of the red, green and blue pictures, near 1.
        bands: channels from red to blue, odd: 3, or more of them between, for which offset and size are
            interpolated and which count for the two colours that they lie between. Fringes are then smooth.

    Raises:
        ValueError: not three numbers, or not finite; a size that is not positive; an even number of bands.

    Example:
        >>> from focusjax.lens import thin_lens
        >>> thin = thin_lens(focus_distance=2, aperture_radius=0.02)
        >>> len(chromatic_lens(thin, focus_offset=(-0.02, 0, 0.02)).channels())
        3
    """
    focus, size = (
        real_numbers(values, name, "finite numbers for red, green and blue")
        for name, values in (("focus offset", focus_offset), ("magnification", magnification))
    )
    for name, values in (("focus offset", focus), ("magnification", size)):
        if values.shape != (3,) or not np.isfinite(values).all():
            raise ValueError(f"{name} is {values.tolist()}; expected finite numbers for red, green and blue")
    if not (size > 0).all():
        raise ValueError(f"magnification is {size.tolist()}; expected positive numbers near 1")
    primaries, (places, colours) = np.arange(3.0), colour_bands(bands)

    def terms(at: float) -> tuple[AbstractAberration, ...]:
        offset: Float[Array, ""] = jnp.asarray(np.interp(at, primaries, focus), dtype=float)
        scale: Float[Array, ""] = jnp.asarray(np.interp(at, primaries, size), dtype=float)
        return FocusOffset(offset), Magnification(scale)

    return ChromaticLens(lens, tuple(terms(at) for at in places), colours)


def thin_lens_dispersion(
    glass: AbstractGlass, focal_length: SupportsFloat, wavelengths: Sequence[SupportsFloat] = RGB_WAVELENGTHS
) -> tuple[float, ...]:
    """By how many dioptres a thin lens of one glass focuses some colours nearer (Lee10 section 4).

    Its power is proportional to n - 1. With the film where it is, a colour of index n focuses nearer by the
    power that it has more, (n - n_d) / ((n_d - 1) f): the `focus_offset` of `chromatic_lens`.

    Args:
        glass: what it is made of.
        focal_length: f in metres at the yellow line d.
        wavelengths: of the colours in nm; red, green and blue if not given.

    Raises:
        ValueError: a focal length that is not positive, or glass whose index at d is not above 1.

    Example:
        >>> from focusjax.optics import find_glass
        >>> red, green, blue = thin_lens_dispersion(find_glass("N-BK7"), 0.05)
        >>> round(red, 3), round(green, 3), round(blue, 3)
        (-0.088, 0.154, 0.248)
    """
    length = real_number(focal_length, "the focal length in metres", "a positive one, such as 0.05")
    if not 0 < length < float("inf"):
        raise ValueError(f"the focal length is {length:g} m; expected a positive one, such as 0.05")
    at = [FRAUNHOFER["d"], *(float(each) for each in wavelengths)]
    n_d, *others = (float(glass.index(jnp.asarray(each, dtype=float))) for each in at)
    if not n_d - 1.0 > 1e-3:
        raise ValueError(
            f"has the index {n_d:.6g} at the line d, as air; expected more for a lens to refract"
        )
    return tuple((n - n_d) / ((n_d - 1.0) * length) for n in others)
