"""One lens of every kind, and the camera they stand in, for tests that hold for all of them."""

import functools

import jax.numpy as jnp
from optics_lenses import biconvex

from focusjax.geometry import look_at
from focusjax.lens import (
    AberratedLens,
    AbstractAperture,
    AbstractLens,
    Disk,
    FittedLens,
    FocalSurfaceLens,
    PrescriptionLens,
    ThinLens,
    TiltedPrescriptionLens,
    TiltShiftLens,
    apodized,
    chromatic_lens,
    field_curvature,
    fitted_lens,
    focal_surface,
    focal_surface_lens,
    height_curve,
    mask,
    obstructed,
    polygon,
    power_profile,
    prescription_lens,
    seidel,
    squeezed,
    tabulated_aberrations,
    tilted_lens,
    vignetted_lens,
)

CAMERA = look_at((1.0, 0.5, 2.0), (0.0, 0.0, 0.0), width=40, height=30, field_of_view=0.7)
FOCUS = 0.5
TILTED = (2.1, -1.7, FOCUS)
"""A plane in focus: with the 49 mm of the camera, a lens turned by 7.6 degrees."""


def thin(aperture: AbstractAperture, focus: float = FOCUS, radius: float = 0.04) -> ThinLens:
    return ThinLens(jnp.array(focus), jnp.array(radius), aperture)


def tilted(aperture: AbstractAperture, plane=TILTED, radius: float = 0.04) -> TiltShiftLens:
    return TiltShiftLens(jnp.array(plane), jnp.array(radius), aperture)


def surfaced(radius: float = 0.04) -> FocalSurfaceLens:
    """Focus at about the same disparity everywhere."""
    places = [(5.0, 5.0), (33.0, 12.0), (18.0, 26.0)]
    surface = focal_surface(places, [0.492, 0.5, 0.508], aperture_scale=[0.6, 1.0, 1.3], basis="affine")
    return focal_surface_lens(surface, CAMERA, thin(polygon(5, rotation=0.3), radius=radius))


def aberrated(lens: AbstractLens) -> AberratedLens:
    """With all of Seidel's terms and a power profile."""
    terms = seidel(thin(Disk()), CAMERA, w040=0.7, w131=-1.1, w222=0.6, w220=-0.4, w311=0.9)
    return AberratedLens(lens, (terms, power_profile([0.0, -0.05, 0.2])))


def curved(lens: AbstractLens) -> AberratedLens:
    """With a focus that differs over the picture."""
    offsets = focal_surface([(5.0, 5.0), (33.0, 12.0), (18.0, 26.0)], [0.1, -0.05, 0.02], basis="affine")
    return AberratedLens(lens, (field_curvature(offsets, CAMERA),))


def tabulated(lens: AbstractLens) -> AberratedLens:
    """With all tables over the image height, that reach to a corner of the frame, or not quite."""
    heights = [0.0, 0.005, 0.012, 0.02]

    tables = {
        "distortion": (0.0, -0.004, -0.02, -0.03),
        "sagittal": (0.02, 0.03, 0.06, 0.03),
        "tangential": (0.02, 0.0, -0.05, -0.1),
        "spherical": (0.1, 0.12, 0.15, 0.2),
        "coma": (0.0, 2e-4, 6e-4, 4e-4),
        "shift": (0.0, -5e-4, -8e-4, -1.8e-3),
    }
    curves = {
        name: height_curve(heights, values, even=name not in ("coma", "shift"))
        for name, values in tables.items()
    }
    return AberratedLens(lens, tabulated_aberrations(curves, 0.05))


SQUEEZED = "thin, squeezed, apodized, obstructed blades"
IDEAL = {
    "thin, disk": thin(Disk()),
    "thin, 5 straight blades": thin(polygon(5, rotation=0.3)),
    "thin, 5 bulging blades": thin(polygon(5, rotation=0.3, roundness=0.5)),
    "thin, 5 round blades": thin(polygon(5, rotation=0.3, roundness=1.0)),
    "thin, focused on infinity": thin(polygon(5), focus=0.0),
    SQUEEZED: thin(squeezed(1.5, apodized([1.0, 0.7, 0.2], obstructed(0.4, polygon(5))))),
    "thin, mask": thin(mask([[0.3, 1.0, 0.0], [0.8, 0.5, 0.6]])),
    "tilted, disk": tilted(Disk()),
    "tilted, 5 bulging blades": tilted(polygon(5, rotation=0.3, roundness=0.5)),
    "tilted, plane parallel to the view axis": tilted(Disk(), (0.0, -1.3, 0.0)),
    "tilted by nothing": tilted(polygon(5, rotation=0.3), (0.0, 0.0, FOCUS)),
    "focal surface": surfaced(),
}
"""Rays of a film point meet in one point of the scene."""

CHROMATIC = chromatic_lens(
    thin(Disk()), focus_offset=(-0.05, 0.01, 0.05), magnification=(1.01, 1.005, 0.98), bands=3
)

ABERRATED = {
    "aberrated": aberrated(thin(Disk())),
    "curved field, tables over the image height": AberratedLens(
        thin(Disk()), (*curved(thin(Disk())).aberrations, *tabulated(thin(Disk())).aberrations)
    ),
    "tilted, aberrated, cat's eyes": vignetted_lens(
        AberratedLens(tilted(polygon(5, rotation=0.3)), (power_profile([0.0, -0.05, 0.2]),)),
        CAMERA,
        corner_shift=0.8,
    ),
    "chromatic": CHROMATIC,
}
"""They do not, or not all of them pass."""

PINHOLES = {
    "thin, disk": thin(Disk(), radius=0.0),
    "thin, blades": thin(polygon(5), radius=0.0),
    "tilted, disk": tilted(Disk(), radius=0.0),
    "focal surface": surfaced(0.0),
    "power profile": AberratedLens(thin(Disk(), radius=0.0), (power_profile([0.0, 0.3]),)),
}


@functools.cache
def through_glass() -> PrescriptionLens:
    """A simple lens, with all its aberrations."""
    return prescription_lens(biconvex(), CAMERA, focus_distance=1.0 / FOCUS, f_number=4)


@functools.cache
def by_polynomials() -> FittedLens:
    """The same with blades in its stop."""
    blades = polygon(5, rotation=0.3, roundness=0.5)
    exact = prescription_lens(biconvex(), CAMERA, focus_distance=1.0 / FOCUS, f_number=4, aperture=blades)
    return fitted_lens(exact, CAMERA)


@functools.cache
def turned_glass() -> TiltedPrescriptionLens:
    """The first on a standard that is tilted and swung."""
    return tilted_lens(through_glass(), CAMERA, tilt=0.06, swing=-0.04)


REAL = {"glass": through_glass, "glass, fitted": by_polynomials, "glass, tilted": turned_glass}
"""Functions that make them, as that takes seconds."""
