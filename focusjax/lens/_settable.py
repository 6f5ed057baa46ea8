"""A real lens whose focus and opening compiled code can set, with its rays aimed by places in the stop.

The rays of `PrescriptionLens` are spread over what one opening and one place of the film let through. Here
they are drawn over the stop, whose radius may shrink, and over film points beyond the frame, where spots of
what is seen near its edge reach.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._aperture import Disk
from focusjax.lens._base import AbstractLens
from focusjax.lens._film import film_for
from focusjax.lens._fitted import FittedLens, unfitted
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._pupils import SOFTNESS, Pupils
from focusjax.lens._spectral import SpectralLens
from focusjax.lens._stop_map import find_stop_map
from focusjax.lens._tilted_lens import TiltedPrescriptionLens
from focusjax.optics import Prescription, first_order

_RADII = 17
"""Film radii at which aims are kept."""
_BEYOND = 1.3
"""Reach of these radii, in that of the frame's corner."""


class SettableLens(eqx.Module):
    """A real lens with its stop at `opening` of its widest radius and its film where `focus` puts it.

    Attributes:
        channels: a lens for every colour, or one.
        shares: how much of the light each colour is (static).
    """

    channels: tuple[PrescriptionLens | TiltedPrescriptionLens, ...]
    shares: tuple[float, ...] = eqx.field(static=True)

    def pupil_point(self, sample: Float[Array, "2"], opening: Float[Array, ""]) -> Float[Array, "2"]:
        """A point of the stop, in its widest radii, for one of the unit square."""
        aperture = self.channels[0].opening()
        edge = 1.0 + SOFTNESS / 2.0 if isinstance(aperture, Disk) else 1.0
        return opening * edge * aperture.point(sample)

    def set_to(
        self, camera: Camera, focus_disparity: Float[Array, ""], opening: Float[Array, ""]
    ) -> tuple[PrescriptionLens | TiltedPrescriptionLens, ...]:
        """The channels, for `ray` alone, focused on 1/m and stopped down; differentiable in both."""
        first = self.channels[0]
        if isinstance(first, TiltedPrescriptionLens):
            return self._tilted_to(camera, focus_disparity, opening)
        prescription = _opened(first.prescription, opening)
        film, scale = film_for(prescription, camera, focus_disparity, first.focus, breathing=first.breathing)
        return tuple(
            dataclasses.replace(
                each,
                prescription=prescription,
                film_place=film,
                film_scale=scale,
                focus_disparity=focus_disparity,
            )
            for each in self.channels
            if isinstance(each, PrescriptionLens)
        )

    def _tilted_to(
        self, camera: Camera, focus_disparity: Float[Array, ""], opening: Float[Array, ""]
    ) -> tuple[TiltedPrescriptionLens, ...]:
        """As `set_to`, of a tilted lens."""
        found = []
        for each in self.channels:
            assert isinstance(each, TiltedPrescriptionLens)
            glass = dataclasses.replace(each.lens, prescription=_opened(each.lens.prescription, opening))
            found.append(dataclasses.replace(each, lens=glass).focused_at(camera, focus_disparity))
        return tuple(found)


def settable(lens: AbstractLens, camera: Camera, focus_disparity: Float[Array, ""]) -> SettableLens:
    """`lens` with rays aimed for a film about where `focus_disparity` (1/m) puts it.

    Aims carry no derivatives, as any that cover the opening give the same spots.

    Args:
        lens: a `PrescriptionLens`, a `SpectralLens`, or polynomials for one of these; as wide as it may open.
        camera: that it was made for.
        focus_disparity: near enough to where it is used.
    """
    if isinstance(lens, SpectralLens):
        colours = lens.channels()
        bands = [each.lens for each in colours]
        shares = tuple(sum(each.colour) / 3.0 for each in colours)
    else:
        bands, shares = [lens], (1.0,)
    return SettableLens(tuple(_channel(band, camera, focus_disparity) for band in bands), shares)


def _channel(
    lens: AbstractLens, camera: Camera, focus_disparity: Float[Array, ""]
) -> PrescriptionLens | TiltedPrescriptionLens:
    """One colour's lens with its aims."""
    if not isinstance(lens, TiltedPrescriptionLens):
        return _aimed(unfitted(lens), camera, focus_disparity)
    near = lens.focused_at(camera, focus_disparity)
    return dataclasses.replace(near, lens=_aimed(near.lens, camera, near.lens.focus_disparity))


@jit
def _aimed(lens: PrescriptionLens, camera: Camera, focus_disparity: Float[Array, ""]) -> PrescriptionLens:
    """The lens with aims by places in the stop, in place of pupils."""
    lens = jax.lax.stop_gradient(lens)
    film, scale = film_for(lens.prescription, camera, focus_disparity, lens.focus, breathing=lens.breathing)
    last = lens.pupils.centre.shape[0] - 1
    places = jnp.linspace(0.0, _BEYOND * last, _RADII, dtype=lens.indices.dtype)
    step = lens.film_step * places[1]
    # Any ray that passes will do to aim by. Beyond the frame it is where the last ones lead.
    seen = jnp.arange(last + 1, dtype=places.dtype)
    inside = lens.pupils.inside
    ahead = inside[-1] + (inside[-1] - inside[-2]) * (places - last)
    inside = jnp.where(places <= last, jnp.interp(places, seen, inside), ahead)
    is_open = jnp.interp(places, seen, lens.pupils.open.astype(places.dtype)) > 0.5
    blank = jnp.zeros((_RADII, 0), dtype=places.dtype)
    pupils = Pupils(inside, inside, inside, inside, blank, is_open)
    aims = find_stop_map(lens.prescription, lens.indices, film, scale * lens.film_step * places, pupils)
    pupils, aims, step = jax.lax.stop_gradient((pupils, aims, step))
    return dataclasses.replace(lens, pupils=pupils, stop_map=aims, film_step=step)


def _opened(prescription: Prescription, opening: Float[Array, ""]) -> Prescription:
    """The prescription with its stop at a share of its radius."""
    stop = prescription.stop
    radii = prescription.semi_diameters
    return dataclasses.replace(prescription, semi_diameters=radii.at[stop].set(radii[stop] * opening))


def pupil_radius(lens: AbstractLens) -> Float[Array, ""]:
    """Radius in metres of the entrance pupil of a real lens, as it is opened."""
    return 1e-3 * first_order(level_glass(lens).prescription).entrance_pupil_radius


def is_tilted(lens: AbstractLens) -> bool:
    """Whether a real lens is turned on its standard."""
    middle = lens.lens if isinstance(lens, SpectralLens) else lens
    return isinstance(middle, TiltedPrescriptionLens)


def level_glass(lens: AbstractLens) -> PrescriptionLens:
    """The glass of a real lens for the one wavelength that it is focused with, not tilted nor fitted."""
    middle = lens.lens if isinstance(lens, SpectralLens) else lens
    return middle.lens if isinstance(middle, TiltedPrescriptionLens) else unfitted(middle)


def stopped(lens: AbstractLens, opening: Float[Array, ""]) -> AbstractLens:
    """A real lens with its stop at a share of its radius; `refocused` then finds what that lets through."""
    if isinstance(lens, SpectralLens):
        bands = tuple(stopped(band, opening) for band in lens.bands)
        return dataclasses.replace(lens, lens=stopped(lens.lens, opening), bands=bands)
    if isinstance(lens, TiltedPrescriptionLens):
        return dataclasses.replace(lens, lens=stopped(lens.lens, opening))
    exact = unfitted(lens)
    exact = dataclasses.replace(exact, prescription=_opened(exact.prescription, opening))
    return dataclasses.replace(lens, exact=exact) if isinstance(lens, FittedLens) else exact


def nearest_focus(lens: AbstractLens) -> Float[Array, ""]:
    """Metres along the film's normal from the entrance pupil to the front focal plane.

    Nothing nearer has a real image.
    """
    seen = first_order(level_glass(lens).prescription)
    middle = lens.lens if isinstance(lens, SpectralLens) else lens
    lean = middle.turn[2, 2] if isinstance(middle, TiltedPrescriptionLens) else 1.0
    return 1e-3 * (seen.entrance_pupil - seen.front_focal_distance) / lean
