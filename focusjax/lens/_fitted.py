"""A real lens by polynomials instead of glass: quick, and with a known error."""

import dataclasses
import functools
import math
from typing import SupportsFloat, overload

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind
from focusjax._programs import jit
from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens
from focusjax.lens._fit_error import FitError, fit_error, limiting_rims, traced_rays
from focusjax.lens._prescription import PrescriptionLens, line_of
from focusjax.lens._ray_bounds import is_round
from focusjax.lens._spectral import SpectralLens
from focusjax.lens._transfer import TracedRays, Transfer, fit_transfers, fit_uneven_transfers

_traced = jit(traced_rays)
_DEGREES = {True: (2, 3, 4, 5, 6), False: (3, 4, 5, 6, 7)}
"""Tried of polynomials for a lens that is round and for one that is not, the lowest first."""


class FittedLens(AbstractLens):
    """A `PrescriptionLens` whose rays come from polynomials. `fitted_lens` makes one.

    All but the rays is that lens's own. Where rims cut light off is found as there, from the distances to the
    axis that rays have where the rims are, so that cat's eyes keep their edges.

    Attributes:
        exact: the lens that it stands for.
        transfer: the polynomials.
        rims: numbers of the surfaces whose rims cut light off (static).
        error: how far its rays are from that lens's.

    Example:
        >>> lens = fj.fitted_lens(exact, camera)  # doctest: +SKIP
        >>> lens.exact is exact  # doctest: +SKIP
        True
    """

    exact: PrescriptionLens
    transfer: Transfer
    rims: tuple[int, ...] = eqx.field(static=True)
    error: FitError

    def opening(self) -> AbstractAperture:
        return self.exact.opening()

    def vignettes(self) -> bool:
        return self.exact.vignettes()

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        aim = self.exact.aim(camera, film_point, pupil_point)
        (x, y), crossing, clearance = self.transfer(aim.tangents, aim.target)
        slope = (x - aim.tangents[0], y - aim.tangents[1])
        return line_of(camera, film_point, aim.light, slope, crossing, clearance)

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        return self.exact.blur(camera, film_point, disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        return self.exact.footprint(camera, film_point, disparity)

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.exact.reach(camera, disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return self.exact.parallax(camera)

    def focus_distance(self) -> Float[Array, ""]:
        """Distance in metres from the entrance pupil to the plane in focus; infinite when that is far."""
        return self.exact.focus_distance()

    def f_number(self, camera: Camera) -> Float[Array, ""]:
        """Focal length over entrance pupil diameter, at the line d."""
        return self.exact.f_number(camera)


class PoorFitError(ValueError):
    """No polynomials come near enough to a lens."""


@overload
def fitted_lens(
    lens: PrescriptionLens,
    camera: Camera,
    *,
    error_px: SupportsFloat = ...,
    nearest: SupportsFloat = ...,
    farthest: SupportsFloat = ...,
) -> FittedLens: ...
@overload
def fitted_lens(
    lens: SpectralLens,
    camera: Camera,
    *,
    error_px: SupportsFloat = ...,
    nearest: SupportsFloat = ...,
    farthest: SupportsFloat = ...,
) -> SpectralLens: ...
def fitted_lens(
    lens: PrescriptionLens | SpectralLens,
    camera: Camera,
    *,
    error_px: SupportsFloat = 0.05,
    nearest: SupportsFloat = 0.5,
    farthest: SupportsFloat = math.inf,
) -> FittedLens | SpectralLens:
    """A real lens with polynomials for its rays, which are quicker to trace.

    Of several degrees the lowest is taken whose error, over rays that were not fitted, is small enough. A
    lens with height fields that are not the same all around its axis gets polynomials without that symmetry.

    Args:
        lens: focused already. Of a `SpectralLens`, each colour is fitted.
        camera: that it was made for.
        error_px: by how much, in pixels, rays and outlines of the opening may be off at most, anywhere in the
            frame.
        nearest: metres to the nearest thing for which this holds. Errors grow as 1 over the distance.
        farthest: metres to the farthest.

    Raises:
        PoorFitError: a lens whose rays no degree up to 6, or 7 without symmetry, comes near enough to.
        ValueError: distances out of order, or an error that is not positive.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.lens import prescription_lens
        >>> from focusjax.optics import lens_preset
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> triplet = prescription_lens(lens_preset("cooke_triplet_50mm_f4"), camera, focus_distance=2.0)
        >>> fitted = fitted_lens(triplet, camera)
        >>> bool(fitted.error.largest() < 0.05)
        True
    """
    remedy = "`prescription_lens` and `spectral_lens` make one; polynomials are of a level lens"
    require_kind(lens, (PrescriptionLens, SpectralLens), "fitted_lens(lens, camera)", remedy, "lens")
    if isinstance(lens, SpectralLens):
        kinds = (PrescriptionLens, FittedLens)
        require_kind(lens.lens, kinds, "fitted_lens(lens, camera)", remedy, "lens")
    wanted = real_number(error_px, "the error allowed in pixels", "a positive number such as 0.05")
    near, far = (
        real_number(value, f"the {end} distance in metres", "a positive one, such as 0.5")
        for end, value in (("nearest", nearest), ("farthest", farthest))
    )
    if not 0.0 < wanted < math.inf:
        raise ValueError(f"the error allowed is {wanted} px; expected a positive number such as 0.05")
    if not 0.0 < near < far:
        raise ValueError(
            f"the nearest distance is {near} m and the farthest {far} m; expected positive ones in order"
        )
    if isinstance(lens, SpectralLens):
        fit = functools.partial(fitted_lens, camera=camera, error_px=wanted, nearest=near, farthest=far)
        bands = tuple(fit(unfitted(band)) for band in lens.bands)
        return dataclasses.replace(lens, lens=fit(unfitted(lens.lens)), bands=bands)
    name = lens.prescription.name
    disparities = jnp.asarray([1.0 / far, 1.0 / near], dtype=lens.indices.dtype)
    rays = _traced(lens, camera)
    rims = limiting_rims(rays)
    least = math.inf
    # A lens with a height field may be round all the same.
    kinds = (True,) if is_round(lens.prescription) else (True, False)
    for symmetric in kinds:
        degrees = _DEGREES[symmetric]
        found, rough = _fits(rays, lens, camera, disparities, rims, symmetric, degrees)
        for transfer, off in zip(found, np.asarray(rough), strict=True):
            # Over other rays the error is hardly less than over those that were fitted.
            last = symmetric is kinds[-1] and transfer.degree == degrees[-1]
            if off > wanted and not last:
                continue
            error = fit_error(lens, transfer, camera, disparities)
            if float(error.largest()) <= wanted:
                return FittedLens(lens, transfer, rims, error)
            least = min(least, float(error.largest()))
    raise PoorFitError(
        f"the best polynomials for {name} are off by {least:.2g} px, of {wanted:g} px allowed; allow more,"
        " ask for things farther away, stop it down, or trace it exactly"
    )


def refitted(fitted: FittedLens, lens: PrescriptionLens, camera: Camera) -> FittedLens:
    """Polynomials of the same degree and rims for a lens that has changed, unchecked.

    For derivatives and compiled code: differentiable in all that `lens` is. Its `error` is the old one.
    """
    ends = fitted.error.disparities
    rays = traced_rays(lens, camera)
    old = fitted.transfer
    (transfer,), _ = _fits(rays, lens, camera, ends, fitted.rims, old.is_round, (old.degree,))
    return FittedLens(lens, transfer, fitted.rims, fitted.error)


@jit
def _fits(
    rays: TracedRays,
    lens: PrescriptionLens,
    camera: Camera,
    disparities: Float[Array, "2"],
    rims: tuple[int, ...],
    symmetric: bool,
    degrees: tuple[int, ...],
) -> tuple[list[Transfer], Float[Array, " d"]]:
    """Polynomials of some degrees, and the largest error in pixels of each over its rays."""
    rays = eqx.tree_at(lambda r: r.squares, rays, rays.squares[:, jnp.array(rims)])
    last = lens.pupils.centre.shape[0] - 1
    steps = jnp.arange(last + 1, dtype=lens.indices.dtype)
    lean = jnp.sum(lens.pupils.centre * steps) / jnp.sum(steps**2)
    beside = jnp.abs(lens.pupils.centre - lean * steps)
    reach = jnp.max(jnp.hypot(beside + lens.pupils.radial, lens.pupils.tangential))
    scales = (1.0 / (last * lens.film_step), last * lean, 1.0 / reach)
    made, errors = [], []
    fit = fit_transfers if symmetric else fit_uneven_transfers
    for transfer, slope, crossing in fit(scales, rays, degrees):
        off = slope[:, None] + 1e-3 * disparities[None, :, None] * crossing[:, None]
        lit = rays.line_weight == 1.0
        errors.append(
            camera.focal_px * jnp.max(jnp.where(lit, jnp.linalg.norm(off, axis=-1).max(axis=1), 0.0))
        )
        made.append(transfer)
    return made, jnp.stack(errors)


def unfitted(lens: AbstractLens) -> PrescriptionLens:
    """The lens whose rays are traced."""
    exact = lens.exact if isinstance(lens, FittedLens) else lens
    assert isinstance(exact, PrescriptionLens)
    return exact
