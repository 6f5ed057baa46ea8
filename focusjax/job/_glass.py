"""The real lens of a run: solved for, and fitted."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from focusjax.config import Config, build_real_lens, refusals_located, widest_real
from focusjax.focus import F_NUMBERS, ImagePoints, Solution, seen_through, solve
from focusjax.geometry import Camera
from focusjax.lens import (
    AbstractLens,
    FitError,
    FittedLens,
    PoorFitError,
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    TiltedPrescriptionLens,
    TiltShiftLens,
    fitted_lens,
    is_tilted,
    refocused,
)
from focusjax.trace import NO_TILTED_FIT, LensPlan

FIT_PX = 0.05
"""Pixels by which polynomials may be off where nothing is said of them, nor of quality."""


@dataclass(frozen=True)
class ThroughGlass:
    """A real lens in place of the thin one that was solved for.

    Attributes:
        exact: focused.
        traced: what rays are traced with: `exact`, or polynomials for it.
        poor_fit: why rays are traced exactly although polynomials were asked for, or a quality was; empty
            otherwise.
        decibels: expected PSNR of the picture by polynomials against that through the glass, where they were
            chosen for a quality; None otherwise.
        solution: what wishes set the focus; None where none did.
    """

    exact: PrescriptionLens | TiltedPrescriptionLens | SpectralLens
    traced: AbstractLens
    poor_fit: str
    decibels: float | None = None
    solution: Solution | None = None

    @property
    def middle(self) -> PrescriptionLens | TiltedPrescriptionLens:
        """The lens for the one wavelength that it is focused with."""
        lens = self.exact.lens if isinstance(self.exact, SpectralLens) else self.exact
        assert isinstance(lens, PrescriptionLens | TiltedPrescriptionLens)
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


def opened_as_glass(config: Config, options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Options of `solve` for an ideal lens that opens no wider than the real one of a config.

    Where even the largest f-number allowed is wider, they stay as they are: the glass then says so.
    """
    if "f_number" not in options["free"]:
        return options
    widest = widest_real(config)
    low, high = options.get("f_number_range", F_NUMBERS)
    if widest is None or not low < widest < high:
        return options
    return {**options, "f_number_range": (widest, high)}


def solved_through(
    config: Config,
    options: Mapping[str, Any],
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    settled: Solution | None,
) -> Solution:
    """The wishes of a config met by its real lens.

    Args:
        config: has a prescription.
        options: of `solve`.
        points: the wishes.
        camera: framed already, where that is solved for.
        lens: where to start.
        settled: what an ideal lens says, where more is free than focus and f-number, where it is tilted, or
            where the light has set the f-number: the focus is then found anew, and the f-number where nothing
            has set it. None otherwise.

    Raises:
        ConfigError: as `build_real_lens`, and as `solve`.
    """
    free = [name for name in options["free"] if name in ("focus", "f_number")]
    if config.weighs(solving=True):
        free = [name for name in free if name == "focus"]
    exact = build_real_lens(config, camera, lens, wide_open="f_number" in free)
    assert exact is not None
    if not free:
        assert settled is not None
        return seen_through(settled, exact)
    # The glass is turned; what is solved for is its focus and opening.
    start = ThinLens(lens.focus_disparity, lens.aperture_radius, lens.aperture)
    with refusals_located(config):
        solution = solve(points, camera, start, through=exact, **options_through(options, free))
    jax.block_until_ready(solution.blur)
    if isinstance(lens, TiltShiftLens):
        found = replace(lens, aperture_radius=solution.lens.aperture_radius)
        solution = replace(solution, lens=refocused(found, camera, solution.lens.focus_disparity))
    return solution


def options_through(options: Mapping[str, Any], free: Sequence[str]) -> dict[str, Any]:
    """Of the options of a solve those for `free` settings of a real lens: its focus, its f-number or both."""
    limits = {"focus": ("min_focus_distance", "max_focus_distance"), "f_number": ("f_number_range",)}
    kept = {name: options[name] for each in free for name in limits[each] if name in options}
    priors = {name: prior for name, prior in options.get("priors", {}).items() if name in free}
    return {"free": free, "solver": options.get("solver"), "priors": priors, **kept}


def through_glass(
    config: Config,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    solution: Solution | None,
    disparity: Float[np.ndarray, "h w"],
    *,
    fit: bool,
) -> ThroughGlass:
    """The real lens of a config.

    Args:
        config: has a prescription.
        camera: as it was solved for.
        lens: the ideal lens with the settings.
        solution: through the glass; None when nothing was solved for.
        disparity: of the first surface at every pixel, for the nearest.
        fit: whether to look for polynomials, of a config that does not leave that to its quality.

    Raises:
        ConfigError: as `build_real_lens`.
    """
    exact = build_real_lens(config, camera, lens) if solution is None else solution.glass
    assert isinstance(exact, PrescriptionLens | TiltedPrescriptionLens | SpectralLens)
    traced, poor_fit = exact, ""
    error_px = FIT_PX if config.lens.fit_px is None else config.lens.fit_px
    if is_tilted(exact):
        poor_fit = NO_TILTED_FIT if fit and error_px > 0 else ""
    elif fit and error_px > 0 and not left_to_quality(config):
        assert isinstance(exact, PrescriptionLens | SpectralLens)
        nearest = float(disparity.max())
        try:
            distances = {"nearest": 1.0 / nearest} if nearest > 0 else {}
            traced = fitted_lens(exact, camera, error_px=error_px, **distances)
        except PoorFitError as error:
            poor_fit = str(error)
    return ThroughGlass(exact, traced, poor_fit, solution=solution)


def left_to_quality(config: Config) -> bool:
    """Whether the quality of the picture decides between the glass and polynomials."""
    return config.lens.fit_px is None and config.render.quality is not None
