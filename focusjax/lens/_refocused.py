"""Any lens with its focus set elsewhere."""

import dataclasses
from typing import TypeVar, cast

from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens
from focusjax.lens._film import film_for
from focusjax.lens._fitted import FittedLens, refitted, unfitted
from focusjax.lens._focused import focused_lens, with_indices
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._spectral import SpectralLens
from focusjax.lens._thin import ThinLens
from focusjax.lens._tilt_shift import TiltShiftLens
from focusjax.lens._tilted import retilted
from focusjax.lens._tilted_lens import TiltedPrescriptionLens
from focusjax.lens._wrapper import AbstractDimmedLens
from focusjax.lens.aberrations import AberratedLens, ChromaticLens

_Lens = TypeVar("_Lens", bound=AbstractLens)


def moved_film(lens: AbstractLens, camera: Camera, focus_disparity: Float[Array, ""]) -> AbstractLens:
    """As `refocused`, for `ray` alone: a real lens keeps bounds and the ellipse rays are spread over.

    That is much quicker, to compile above all. A fitted lens becomes the exact one.
    """
    if isinstance(lens, FittedLens):
        return moved_film(lens.exact, camera, focus_disparity)
    if isinstance(lens, PrescriptionLens):
        film, scale = film_for(
            lens.prescription, camera, focus_disparity, lens.focus, breathing=lens.breathing
        )
        return dataclasses.replace(lens, film_place=film, film_scale=scale, focus_disparity=focus_disparity)
    if isinstance(lens, TiltedPrescriptionLens):
        return lens.focused_at(camera, focus_disparity)
    if isinstance(lens, SpectralLens) and isinstance(lens.lens, TiltedPrescriptionLens):
        moved = [moved_film(each, camera, focus_disparity) for each in (lens.lens, *lens.bands)]
        return dataclasses.replace(lens, lens=moved[0], bands=tuple(moved[1:]))
    if isinstance(lens, SpectralLens):
        middle = moved_film(unfitted(lens.lens), camera, focus_disparity)
        place = {name: getattr(middle, name) for name in ("film_place", "film_scale", "focus_disparity")}
        bands = tuple(dataclasses.replace(unfitted(band), **place) for band in lens.bands)
        return dataclasses.replace(lens, lens=middle, bands=bands)
    if isinstance(lens, AberratedLens | ChromaticLens | AbstractDimmedLens):
        return dataclasses.replace(lens, lens=moved_film(lens.lens, camera, focus_disparity))
    return refocused(lens, camera, focus_disparity)


def refocused(lens: _Lens, camera: Camera, focus_disparity: Float[Array, ""]) -> _Lens:
    """`lens` focused on the plane at `focus_disparity` (1/m), as one turns its focusing ring.

    The film of a real lens moves; a tilted plane in focus keeps its lean; what wraps a lens stays. For
    derivatives and compiled code: differentiable in the focus and in the lens.

    Raises:
        ValueError: a lens that has no one focus to set.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.lens import thin_lens
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> lens = thin_lens(focus_distance=2, aperture_radius=0.02)
        >>> round(float(refocused(lens, camera, jnp.asarray(0.25)).focus_distance()), 6)
        4.0
    """
    if isinstance(lens, ThinLens):
        return dataclasses.replace(lens, focus_disparity=focus_disparity)
    if isinstance(lens, TiltShiftLens):
        return dataclasses.replace(lens, plane=lens.plane.at[2].set(focus_disparity))
    if isinstance(lens, PrescriptionLens):
        focused = focused_lens(
            lens.prescription,
            camera,
            focus_disparity,
            focus=lens.focus,
            breathing=lens.breathing,
            falloff=lens.falloff,
            aperture=lens.aperture,
        )
        return cast(_Lens, focused)
    if isinstance(lens, FittedLens):
        return refitted(lens, refocused(lens.exact, camera, focus_disparity), camera)
    if isinstance(lens, TiltedPrescriptionLens):
        return cast(_Lens, retilted(lens, camera, focus_disparity))
    if isinstance(lens, SpectralLens):
        if isinstance(lens.lens, TiltedPrescriptionLens):
            return cast(_Lens, retilted(lens, camera, focus_disparity))
        return _spectral(lens, camera, focus_disparity)
    if isinstance(lens, AberratedLens | ChromaticLens | AbstractDimmedLens):
        return dataclasses.replace(lens, lens=refocused(lens.lens, camera, focus_disparity))
    raise ValueError(f"a {type(lens).__name__} has no one focus to set")


def _spectral(lens: SpectralLens, camera: Camera, focus_disparity: Float[Array, ""]) -> SpectralLens:
    """Focused for the one wavelength, with the same film for all."""
    middle = refocused(unfitted(lens.lens), camera, focus_disparity)

    def band(old: AbstractLens) -> AbstractLens:
        new = with_indices(middle, unfitted(old).indices)
        return refitted(old, new, camera) if isinstance(old, FittedLens) else new

    bands = tuple(band(old) for old in lens.bands)
    first = refitted(lens.lens, middle, camera) if isinstance(lens.lens, FittedLens) else middle
    return dataclasses.replace(lens, lens=first, bands=bands)
