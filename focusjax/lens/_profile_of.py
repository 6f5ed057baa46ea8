"""The profile of a real lens, computed from its prescription."""

import dataclasses
from collections.abc import Sequence
from typing import Any, SupportsFloat

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera, make_camera
from focusjax.lens._base import AbstractLens
from focusjax.lens._falloff import CosineFalloff
from focusjax.lens._focused import prescription_lens
from focusjax.lens._height_curve import HeightCurve, height_curve
from focusjax.lens._profile import CatsEyes, LensProfile
from focusjax.lens._spectral import spectral_lens
from focusjax.lens._thin import thin_lens
from focusjax.lens._vignetted import VignettedLens, vignetted_like
from focusjax.optics import Prescription, converging_length, first_order

_ACROSS = 32
"""Rays along each side of a grid over the square that is mapped to the opening."""
_WIDTH, _HEIGHT = 360, 240
"""Pixels of a frame whose corner is as far away as the profile reaches."""
_FEWEST = 24
"""Rays through the lens below which a height is dark."""


@dataclasses.dataclass(frozen=True)
class ProfileFit:
    """A profile with what it leaves of a lens's rays.

    Attributes:
        profile: of the lens.
        heights: [k] metres from the axis.
        ideal_rms: [k] metres on the film, RMS over rays, by which an ideal lens's rays are off.
        rms: [k] the same of the profile's: what is of higher order over the opening.
    """

    profile: LensProfile
    heights: Float[np.ndarray, " k"]
    ideal_rms: Float[np.ndarray, " k"]
    rms: Float[np.ndarray, " k"]


def profile_of(
    prescription: Prescription,
    *,
    focus_distance: SupportsFloat,
    f_number: SupportsFloat | None = None,
    f_number_max: SupportsFloat = 16.0,
    nearest: SupportsFloat | None = None,
    heights: int = 19,
    reach: SupportsFloat = 0.0235,
    spectral: bool = True,
    vignetting: bool = True,
    source: str = "",
) -> ProfileFit:
    """The profile of a prescription at its own focal length: tables fitted to traced rays, height by height.

    At each height on the film, rays through all of the opening that it sees are compared with an ideal lens's
    that is focused alike. Least squares over their distances on the film find distortion, tangential and
    sagittal focus, spherical aberration and coma together (`TabulatedAberrations`); those of red, green and
    blue give lateral and axial colour, and the light gives the cat's eyes (`vignetted_like`).

    Args:
        prescription: any that forms images.
        focus_distance: metres from the entrance pupil; the tables hold there.
        f_number: widest opening, for which they are; the prescription's if not given.
        f_number_max: smallest opening of the profile's range.
        nearest: nearest focus distance in metres of its range; `focus_distance` if not given. The farthest is
            infinity.
        heights: how many, from the axis to `reach`, as far as there is light.
        reach: metres from the axis; if not given, 9 % beyond the corner of a full frame, for cameras of a
            shorter focal length.
        spectral: with colour.
        vignetting: with cat's eyes.
        source: where the numbers are from; the prescription's name if not given.

    Raises:
        ValueError: as `prescription_lens`; fewer than two heights, or no light beyond the axis.
    """
    if heights < 2:
        raise ValueError(f"a profile was asked for at {heights} heights; expected two or more, such as 19")
    focal = 1e-3 * converging_length(prescription)
    pitch = float(reach) / (0.5 * np.hypot(_WIDTH, _HEIGHT))
    camera = make_camera(
        np.eye(4), width=_WIDTH, height=_HEIGHT, focal_length=focal, sensor_width=_WIDTH * pitch
    )
    real = prescription_lens(prescription, camera, focus_distance=focus_distance, f_number=f_number)
    widest = float(first_order(real.prescription).f_number)
    full = focal / (2.0 * widest)
    places = np.linspace(0.0, float(reach), heights)
    focus = float(real.focus_disparity)

    def terms(lens: AbstractLens) -> list["_Terms"]:
        return _fits(lens, camera, places / pitch, focus, float(camera.focal_px) * full)

    own = terms(real)
    lit = next((number for number, each in enumerate(own) if each.rays < _FEWEST), heights)
    if lit < 2:
        raise ValueError(f"{prescription.name} has no light {1e3 * places[1]:.2f} mm from its axis")
    places, own = places[:lit], own[:lit]

    held: dict[str, Any] = _tables(places, own, pitch)
    if spectral:
        bands = [terms(channel.lens)[:lit] for channel in spectral_lens(real).channels()]
        held |= _colour_tables(places, own, bands, pitch)
    if vignetting:
        held["cats_eyes"] = _cats_eyes(real, camera, full, focus)
    profile = LensProfile(
        title=prescription.name,
        focal_length=jnp.asarray(focal, dtype=float),
        f_number=(widest, float(f_number_max)),
        focus_distance=(float(focus_distance if nearest is None else nearest), float("inf")),
        **held,
    )
    said = source or f"rays through {prescription.name}"
    named = [*dict(profile.curves()), *(["cats_eyes"] if vignetting else [])]
    return ProfileFit(
        profile=dataclasses.replace(profile, sources=tuple((name, said) for name in named)),
        heights=places,
        ideal_rms=pitch * np.array([each.ideal_rms for each in own]),
        rms=pitch * np.array([each.rms for each in own]),
    )


@dataclasses.dataclass(frozen=True)
class _Terms:
    """What one film point's rays say, in pixels and dioptres; see `TabulatedAberrations`."""

    outwards: float
    tangential: float
    sagittal: float
    spherical: float
    coma: float
    rms: float
    ideal_rms: float
    rays: int


def _tables(places: np.ndarray, own: Sequence[_Terms], pitch: float) -> dict[str, HeightCurve]:
    """The profile's tables of one colour at heights `places`, of a film of `pitch` metres a pixel."""
    distorted = places[1:] / (places + _outwards(own, pitch))[1:] - 1.0
    # On the axis, where it is even, the mean of all rays has the scale that it comes from.
    on_axis = (4.0 * distorted[0] - distorted[1]) / 3.0 if len(own) > 2 else distorted[0]
    return {
        "distortion": height_curve(places, [on_axis, *distorted]),
        "sagittal": height_curve(places, [each.sagittal for each in own]),
        "tangential": height_curve(places, [each.tangential for each in own]),
        "spherical": height_curve(places, [each.spherical for each in own]),
        "coma": height_curve(places, [each.coma * pitch for each in own], even=False),
    }


def _colour_tables(
    places: np.ndarray, own: Sequence[_Terms], bands: Sequence[Sequence[_Terms]], pitch: float
) -> dict[str, tuple[HeightCurve, ...]]:
    """Lateral and axial colour of some bands, against the colour of the other tables."""
    shifts = [_outwards(own, pitch) - _outwards(band, pitch) for band in bands]
    focus = [_mean_focus(band) - _mean_focus(own) for band in bands]
    return {
        "lateral_colour": tuple(height_curve(places, [0.0, *shift[1:]], even=False) for shift in shifts),
        "axial_colour": tuple(height_curve(places, each) for each in focus),
    }


def _outwards(found: Sequence[_Terms], pitch: float) -> np.ndarray:
    return pitch * np.array([each.outwards for each in found])


def _mean_focus(found: Sequence[_Terms]) -> np.ndarray:
    return np.array([0.5 * (each.sagittal + each.tangential) for each in found])


def _fits(lens: AbstractLens, camera: Camera, heights: np.ndarray, focus: float, full: float) -> list[_Terms]:
    """The terms at film points `heights` pixels to the right of the axis."""
    points = jnp.asarray(np.column_stack([heights, np.zeros_like(heights)]), dtype=float)
    points = points + camera.principal_point[None]
    a, b, weight = (np.asarray(part, dtype=np.float64) for part in _rays(lens, camera, points))
    found = []
    for number, film_point in enumerate(np.asarray(points, dtype=np.float64)):
        off = a[number] - film_point + b[number] * focus
        found.append(_fit(off, b[number], weight[number], full, axis=number == 0))
    return found


def _fit(off: np.ndarray, b: np.ndarray, weight: np.ndarray, full: float, *, axis: bool) -> _Terms:
    """By least squares over rays [r, 2] along and across the direction to the axis."""
    passes = weight > 0
    off, b, share = off[passes], b[passes], np.sqrt(weight[passes] / max(weight.sum(), 1e-30))
    u = b / full
    square, zero, one = (u**2).sum(axis=1), np.zeros(len(b)), np.ones(len(b))
    along = [one, -b[:, 0], zero, -square * b[:, 0], square + 2.0 * u[:, 0] ** 2]
    across = [zero, zero, -b[:, 1], -square * b[:, 1], 2.0 * u[:, 0] * u[:, 1]]
    matrix = np.concatenate([np.column_stack(along), np.column_stack(across)])
    if axis:
        # By symmetry nothing points anywhere, and both foci are one.
        matrix[:, 1] += matrix[:, 2]
        matrix[:, [0, 2, 4]] = 0.0
    weights = np.concatenate([share, share])
    wanted = np.concatenate([off[:, 0], off[:, 1]])
    values = np.linalg.lstsq(matrix * weights[:, None], wanted * weights, rcond=None)[0]
    rest = (wanted - matrix @ values) * weights
    m, tangential, sagittal, spherical, coma = values
    return _Terms(
        outwards=float(m),
        tangential=float(tangential),
        sagittal=float(tangential if axis else sagittal),
        spherical=float(spherical),
        coma=float(coma),
        rms=float(np.sqrt((rest**2).sum())),
        ideal_rms=float(np.sqrt(((wanted * weights) ** 2).sum())),
        rays=len(b),
    )


@jit
def _rays(lens: AbstractLens, camera: Camera, points: Float[Array, "k 2"]) -> tuple[Array, Array, Array]:
    side = (jnp.arange(_ACROSS, dtype=points.dtype) + 0.5) / _ACROSS
    grid = jnp.stack(jnp.meshgrid(side, side), axis=-1).reshape(-1, 2)
    pupil = jax.vmap(lens.pupil_point)(grid)
    rays = jax.vmap(lambda point: jax.vmap(lambda v: lens.ray(camera, point, v))(pupil))(points)
    return rays.a, rays.b, rays.weight


def _cats_eyes(real: AbstractLens, camera: Camera, full: float, focus: float) -> CatsEyes:
    thin = thin_lens(focus_distance=1.0 / focus if focus else np.inf, aperture_radius=full)
    like = vignetted_like(thin, real, camera)
    ahead = like.lens
    assert isinstance(ahead, VignettedLens)
    behind, falloff = ahead.lens, like.falloff
    assert isinstance(behind, VignettedLens)
    assert isinstance(falloff, CosineFalloff)
    return CatsEyes(
        ahead.disk_radius, ahead.disk_distance, behind.disk_radius, -behind.disk_distance, falloff.power
    )
