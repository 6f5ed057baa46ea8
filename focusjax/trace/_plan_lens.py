"""Whether a picture through real glass may be traced by polynomials, by an estimate of the error they add.

A ray that is off by d pixels carries the radiance of a place d pixels away, so that a picture whose rays are
off by r RMS, as much in one direction as in another, has a squared error of about

    E = r^2 G / 2 + l^2 B,

with G the mean square of the slope of radiance per pixel, B that of radiance, and l the share of light that
is misplaced: more of it in the corners, but much of that is made up for by other rays of the same pixel. So a
factor of ten in the errors is 20 dB. G is that of the sharp picture: defocus only smooths it, but for what is
brighter than white, which it spreads. A source of radiance L > 1 makes a disk that is grey at the worst, with
an outline longer by L^(1/2) than its own, so that of slopes above 1 their root counts, not their square.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from focusjax.layers import Layers
from focusjax.lens import (
    AbstractLens,
    FittedLens,
    PoorFitError,
    PrescriptionLens,
    SpectralLens,
    TiltedPrescriptionLens,
    fitted_lens,
    is_tilted,
)
from focusjax.trace._pinhole import render_pinhole
from focusjax.trace._plan import decibels_of

_CLEAR = 10.0
"""Decibels by which polynomials have to be better than what is wanted, to add but a tenth to its error."""
_WORST = 4.0
"""Most error of a ray over the RMS error allowed; of polynomials it is about six times their own."""
_MOST = 0.25
"""Pixels by which no ray may be off, whatever the quality."""

NO_TILTED_FIT = "polynomials are of a level lens, and this one is tilted"
"""Why rays of a tilted lens are traced through its glass."""


@dataclasses.dataclass(frozen=True)
class LensPlan:
    """The lens to trace for a real one.

    Attributes:
        lens: by polynomials, or the glass itself.
        decibels: expected PSNR of the picture by polynomials against that through the glass, both of very
            many rays; None where the glass is traced.
        why_glass: why it is; empty where it is not.
    """

    lens: AbstractLens
    decibels: float | None
    why_glass: str


def plan_lens(
    layers: Layers,
    lens: PrescriptionLens | TiltedPrescriptionLens | SpectralLens,
    quality: str | float,
    *,
    margin: float = _CLEAR,
) -> LensPlan:
    """Polynomials for a real lens, where their error is clearly below what a quality allows; else the glass.

    Args:
        layers: peeled for the lens, which serve both.
        lens: whose rays are traced through glass.
        quality: as for `plan_rays`; "reference" always takes the glass.
        margin: decibels by which the picture by polynomials alone is to be better than that.

    Raises:
        ValueError: no such quality.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.prescription_lens(fj.lens_preset("cooke_triplet_50mm_f4"), camera, focus_distance=2.0)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> fj.plan_lens(layers, lens, "reference").lens is lens
        True
        >>> plan = fj.plan_lens(layers, lens, "38 dB")  # doctest: +SKIP
        >>> rays = fj.plan_rays(layers, plan.lens, "38 dB").rays  # doctest: +SKIP
    """
    wanted = decibels_of(quality)
    if quality == "reference":
        return LensPlan(lens, None, "a reference is made with the glass itself")
    if is_tilted(lens):
        return LensPlan(lens, None, NO_TILTED_FIT)
    assert isinstance(lens, PrescriptionLens | SpectralLens)
    slope, brightness = picture_slope(np.asarray(render_pinhole(layers)))
    allowed = np.sqrt(2.0 * 10.0 ** (-0.1 * (wanted + margin)) / max(slope, 1e-12))
    nearest = float(layers.ranges.overall[1])
    distances = {"nearest": 1.0 / nearest} if nearest > 0 else {}
    try:
        fitted = fitted_lens(lens, layers.camera, error_px=min(_WORST * allowed, _MOST), **distances)
    except PoorFitError as error:
        return LensPlan(lens, None, str(error))
    reached = fit_decibels(fitted, slope, brightness)
    if reached < wanted + margin:
        why = f"polynomials alone would leave {reached:.0f} dB, not {margin:g} dB more than is wanted"
        return LensPlan(lens, None, why)
    return LensPlan(fitted, reached, "")


def fit_decibels(lens: FittedLens | SpectralLens, slope: float, brightness: float) -> float:
    """Expected PSNR in dB of pictures by polynomials; of colours, that of the worst.

    Args:
        lens: fitted.
        slope: G of `picture_slope`.
        brightness: B.
    """
    bands = lens.bands if isinstance(lens, SpectralLens) else (lens,)
    errors = [each.error for each in bands if isinstance(each, FittedLens)]
    squares = [
        0.5 * float(error.rms.max()) ** 2 * slope + float(error.light) ** 2 * brightness for error in errors
    ]
    return -10.0 * float(np.log10(max(*squares, 1e-12)))


def picture_slope(sharp: Float[np.ndarray, "h w 3"]) -> tuple[float, float]:
    """G and B of a sharp picture: mean squares of its slope, per pixel, and of its radiance up to white."""
    picture = sharp.astype(np.float64)
    across, down = np.diff(picture, axis=1)[:-1], np.diff(picture, axis=0)[:, :-1]
    square = across**2 + down**2
    slopes = np.where(square > 1.0, square**0.25, square)
    return float(slopes.mean()) if slopes.size else 0.0, float((np.minimum(picture, 1.0) ** 2).mean())
