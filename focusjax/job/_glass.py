"""The real lens of a run: focused by its rays, and fitted."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from focusjax.config import Config, build_real_lens
from focusjax.focus import ImagePoints, focus_by_rays, sharp_weights, spots
from focusjax.geometry import Camera
from focusjax.lens import (
    AbstractLens,
    FitError,
    FittedLens,
    PoorFitError,
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    fitted_lens,
)
from focusjax.trace import LensPlan

FIT_PX = 0.05
"""Pixels by which polynomials may be off where nothing is said of them, nor of quality."""


@dataclass(frozen=True)
class ThroughGlass:
    """A real lens in place of the thin one that was solved for.

    Attributes:
        exact: focused.
        traced: what rays are traced with: `exact`, or polynomials for it.
        by_rays: whether the spots of what is wished sharp set the focus, instead of the thin lens's distance.
        spots: RMS diameter in pixels of the spot of each wish for sharpness, the largest of its samples, by
            name.
        poor_fit: why rays are traced exactly although polynomials were asked for, or a quality was; empty
            otherwise.
        decibels: expected PSNR of the picture by polynomials against that through the glass, where they were
            chosen for a quality; None otherwise.
    """

    exact: PrescriptionLens | SpectralLens
    traced: AbstractLens
    by_rays: bool
    spots: dict[str, float]
    poor_fit: str
    decibels: float | None = None

    @property
    def middle(self) -> PrescriptionLens:
        """The lens for the one wavelength that it is focused with."""
        lens = self.exact.lens if isinstance(self.exact, SpectralLens) else self.exact
        assert isinstance(lens, PrescriptionLens)
        return lens

    def planned(self, plan: LensPlan) -> "ThroughGlass":
        """The same with the lens that was chosen for a quality."""
        return replace(self, traced=plan.lens, poor_fit=plan.why_glass, decibels=plan.decibels)

    @property
    def errors(self) -> tuple[FitError, ...]:
        """Of the polynomials of each colour; none where rays are traced exactly."""
        lens = self.traced
        fitted = lens.bands if isinstance(lens, SpectralLens) else (lens,)
        return tuple(each.error for each in fitted if isinstance(each, FittedLens))


def through_glass(
    config: Config,
    camera: Camera,
    lens: AbstractLens,
    points: ImagePoints | None,
    disparity: Float[np.ndarray, "h w"],
    *,
    fit: bool,
) -> ThroughGlass:
    """The real lens of a config.

    What the wishes make of a thin lens is taken for its f-number, and for its focus where nothing is wished
    sharp. Where something is, the film goes to where the spots of that are smallest.

    Args:
        config: has a prescription.
        camera: as it was solved for.
        lens: the thin lens that was solved for.
        points: the wishes; None when nothing was solved for.
        disparity: of the first surface at every pixel, for the nearest.
        fit: whether to look for polynomials, of a config that does not leave that to its quality.

    Raises:
        ConfigError: as `build_real_lens`.
    """
    assert isinstance(lens, ThinLens)
    exact = build_real_lens(config, camera, lens)
    assert exact is not None
    sharp = np.zeros(0) if points is None else np.asarray(sharp_weights(points))
    by_rays = bool((sharp > 0).any()) and "focus" in config.solve.free
    if by_rays:
        assert points is not None
        found = focus_by_rays(points, camera, exact).lens
        assert isinstance(found, PrescriptionLens | SpectralLens)
        exact = found
    sizes = {}
    if points is not None and (sharp > 0).any():
        found = np.asarray(spots(points.xy, points.disparity, camera, exact))
        for number in np.unique(np.asarray(points.wish)[sharp > 0]):
            mine = (np.asarray(points.wish) == number) & (sharp > 0)
            sizes[points.names[number]] = float(found[mine].max())
    traced, poor_fit = exact, ""
    error_px = FIT_PX if config.lens.fit_px is None else config.lens.fit_px
    if fit and error_px > 0 and not left_to_quality(config):
        nearest = float(disparity.max())
        try:
            distances = {"nearest": 1.0 / nearest} if nearest > 0 else {}
            traced = fitted_lens(exact, camera, error_px=error_px, **distances)
        except PoorFitError as error:
            poor_fit = str(error)
    return ThroughGlass(exact, traced, by_rays, sizes, poor_fit)


def left_to_quality(config: Config) -> bool:
    """Whether the quality of the picture decides between the glass and polynomials."""
    return config.lens.fit_px is None and config.render.quality is not None
