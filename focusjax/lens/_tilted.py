"""Turning a real lens on its standard: checked settings, and bounds of its rays."""

import dataclasses
import functools
import math
from typing import SupportsFloat, overload

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens
from focusjax.lens._focused import FRAME_MARGIN, focused_lens, with_indices
from focusjax.lens._prescription import PrescriptionLens, polar
from focusjax.lens._pupils import at_place, points_of
from focusjax.lens._ray_bounds import STEEPEST, is_round
from focusjax.lens._scheimpflug import MAX_TILT, turn_to
from focusjax.lens._spectral import SpectralLens
from focusjax.lens._tilted_bounds import FilmBounds, RayDisk, Rays, find_film_bounds
from focusjax.lens._tilted_lens import TiltedFilm, TiltedPrescriptionLens, tilted_film

_EDGES = (0.98, 1.0, 1.02)
"""Shares of the rim's radius at which bounds look, besides all over the opening."""
_BLOCKS = 1e-3
"""Clearance by which a ray may be cut off and still be bounded."""


@overload
def tilted_lens(
    lens: PrescriptionLens,
    camera: Camera,
    *,
    tilt: SupportsFloat = ...,
    swing: SupportsFloat = ...,
    max_tilt: SupportsFloat = ...,
) -> TiltedPrescriptionLens: ...
@overload
def tilted_lens(
    lens: SpectralLens,
    camera: Camera,
    *,
    tilt: SupportsFloat = ...,
    swing: SupportsFloat = ...,
    max_tilt: SupportsFloat = ...,
) -> SpectralLens: ...
def tilted_lens(
    lens: PrescriptionLens | SpectralLens,
    camera: Camera,
    *,
    tilt: SupportsFloat = 0.0,
    swing: SupportsFloat = 0.0,
    max_tilt: SupportsFloat = MAX_TILT,
) -> TiltedPrescriptionLens | SpectralLens:
    """A real lens turned on its standard, focused at the same distance along the film's normal.

    Args:
        lens: level, of `prescription_lens`, or `spectral_lens` of one.
        camera: that it was made for.
        tilt: radians; positive leans the lens forward, its axis down.
        swing: radians; positive turns the lens's axis to the right.
        max_tilt: radians; the most that the lens's axis may turn from the film's normal.

    Raises:
        ValueError: a lens with a height field, or one that breathes; more tilt than `max_tilt`; a frame that
            reaches beyond the image circle; a focus within the front focal point.

    Example:
        >>> camera = fj.look_at((0, 1, 2), (0, 1, 0), width=60, height=40, focal_length=0.05)
        >>> planar = fj.lens_preset("planar_us583336_f4.5_1897")
        >>> level = fj.prescription_lens(planar, camera, focus_distance=2.0)
        >>> float(fj.tilted_lens(level, camera, swing=0.05).f_number(camera)) == float(level.f_number(camera))
        True
    """
    remedy = "`prescription_lens` and `spectral_lens` make one"
    require_kind(lens, (PrescriptionLens, SpectralLens), "tilted_lens(lens, camera)", remedy, "lens")
    middle = lens.lens if isinstance(lens, SpectralLens) else lens
    require_kind(middle, PrescriptionLens, "tilted_lens(lens, camera)", remedy, "lens")
    assert isinstance(middle, PrescriptionLens)
    if not is_round(middle.prescription):
        raise ValueError(
            f"{middle.prescription.name} has a height field, and a tilted lens is the same all around its"
            " axis; leave it level"
        )
    if middle.breathing:
        raise ValueError(
            "the lens breathes, and a tilted one is framed as the pinhole's picture; make it without"
            " breathing"
        )
    angles = [
        real_number(angle, f"{name} in radians", "an angle between -pi/2 and pi/2")
        for name, angle in (("tilt", tilt), ("swing", swing))
    ]
    for name, angle in zip(("tilt", "swing"), angles, strict=True):
        if not abs(angle) < math.pi / 2:
            raise ValueError(f"{name} is {angle:g} radians; expected an angle between -pi/2 and pi/2")
    most = real_number(max_tilt, "the tilt limit in radians", "0 up to less than pi/2")
    axis = np.array(
        [
            math.cos(angles[0]) * math.sin(angles[1]),
            -math.sin(angles[0]),
            math.cos(angles[0]) * math.cos(angles[1]),
        ]
    )
    turned = math.acos(min(max(axis[2], -1.0), 1.0))
    if not turned <= most + 1e-9:
        raise ValueError(
            f"tilt and swing turn the lens by {math.degrees(turned):.1f} degrees; expected at most"
            f" {math.degrees(most):.1f}"
        )
    turn = turn_to(jnp.asarray(axis, dtype=middle.film_place.dtype))
    made = turned_lens(middle, camera, turn, middle.focus_disparity)
    _refuse_beyond(made, camera, turned)
    if not isinstance(lens, SpectralLens):
        return made
    return dataclasses.replace(lens, lens=made, bands=_bands(made, camera, lens.bands))


def turned_lens(
    lens: PrescriptionLens, camera: Camera, turn: Float[Array, "3 3"], focus_disparity: Float[Array, ""]
) -> TiltedPrescriptionLens:
    """As `tilted_lens`, unchecked, with its axes and focus: for derivatives and compiled code."""
    film = tilted_film(lens.prescription, jnp.zeros_like(focus_disparity))
    wanted = film.plane(turn[2], 1e-3 * focus_disparity)[2]
    level = focused_lens(
        lens.prescription,
        camera,
        1e3 * wanted,
        focus=lens.focus,
        falloff=lens.falloff,
        aperture=lens.aperture,
        farthest=_farthest(camera, turn),
    )
    film = dataclasses.replace(film, shift=level.film_place - film.place(wanted))
    return _bounded(level, camera, turn, focus_disparity, film)


@jit
def _bounded(
    level: PrescriptionLens,
    camera: Camera,
    turn: Float[Array, "3 3"],
    focus_disparity: Float[Array, ""],
    film: TiltedFilm,
) -> TiltedPrescriptionLens:
    """The lens with bounds of its rays over the frame."""
    low, high = _frame(camera)
    zero, pair = jnp.zeros_like(focus_disparity), jnp.zeros_like(low)
    blank = FilmBounds(low, high, RayDisk(pair, pair, zero, zero, zero, zero))
    lens = TiltedPrescriptionLens(level, turn, focus_disparity, film, blank)
    return dataclasses.replace(lens, bounds=find_film_bounds(functools.partial(_rays_of, lens), low, high))


def _rays_of(lens: TiltedPrescriptionLens, seen: Float[Array, "2"]) -> Rays:
    """Rays of the film point that looks along tangents, all over the opening."""
    film, place = lens.film_at(seen)
    level = lens.lens
    radius, along = polar(*film)
    pupils = level.pupils
    inside, rim = at_place((pupils.inside, pupils.rim), radius / level.film_step)
    out, aside, area = points_of(inside, rim, _EDGES)
    out, aside = jnp.tile(out, 2), jnp.concatenate([aside, -aside])
    targets = along[0] * out - along[1] * aside, along[1] * out + along[0] * aside

    def one(x: Array, y: Array) -> tuple[Array, Array, Array]:
        slope, crossing, share, clearance = lens.passing(film, place, (x, y))
        open_ = (clearance > -_BLOCKS) & (share > 0.0)
        return jnp.stack(slope), 1e-3 * jnp.stack(crossing), jnp.where(open_, 1.0, 0.0)

    slope, crossing, light = jax.vmap(one)(*targets)
    return slope, crossing, light, jnp.tile(area, 2)


def _bands(
    made: TiltedPrescriptionLens, camera: Camera, bands: tuple[AbstractLens, ...]
) -> tuple[TiltedPrescriptionLens, ...]:
    """The tilted lens for the wavelengths of others, with the same film."""
    found = []
    for band in bands:
        old = band.lens if isinstance(band, TiltedPrescriptionLens) else band
        assert isinstance(old, PrescriptionLens)
        level = with_indices(made.lens, old.indices)
        found.append(_bounded(level, camera, made.turn, made.focus_disparity, made.film))
    return tuple(found)


def retilted(
    lens: TiltedPrescriptionLens | SpectralLens, camera: Camera, focus_disparity: Float[Array, ""]
) -> TiltedPrescriptionLens | SpectralLens:
    """A tilted lens, of one or all colours, focused elsewhere: see `refocused`."""
    if isinstance(lens, TiltedPrescriptionLens):
        return turned_lens(lens.lens, camera, lens.turn, focus_disparity)
    assert isinstance(lens.lens, TiltedPrescriptionLens)
    middle = turned_lens(lens.lens.lens, camera, lens.lens.turn, focus_disparity)
    return dataclasses.replace(lens, lens=middle, bands=_bands(middle, camera, lens.bands))


def _frame(camera: Camera, margin: float = FRAME_MARGIN) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Least and largest tangents of the frame, y upwards, with a margin in pixels."""
    size = jnp.array([camera.width, camera.height], dtype=camera.principal_point.dtype)
    right, down = (size + margin - camera.principal_point) / camera.focal_px
    left, up = (camera.principal_point + margin) / camera.focal_px
    return jnp.stack([-left, -down]), jnp.stack([right, up])


def _farthest(camera: Camera, turn: Float[Array, "3 3"], margin: float = FRAME_MARGIN) -> Float[Array, ""]:
    """Tangent to the lens's axis to which the frame sees, a margin in pixels beyond its corners."""
    (left, down), (right, up) = _frame(camera, margin)
    corners = jnp.stack([jnp.stack([x, y, jnp.ones_like(x)]) for x in (left, right) for y in (down, up)])
    seen = corners @ turn
    ahead = jnp.maximum(seen[:, 2], 1.0 / STEEPEST)
    return jnp.max(jnp.sqrt(jnp.sum(seen[:, :2] ** 2, axis=1)) / ahead)


def _refuse_beyond(lens: TiltedPrescriptionLens, camera: Camera, turned: float) -> None:
    """A frame whose corners the lens's image circle does not reach, and what cannot be in focus."""
    level = lens.lens
    name = level.prescription.name
    if not (float(level.film_scale) > 0 and float(level.film_place) > 0):
        raise ValueError(
            f"tilted by {math.degrees(turned):.1f} degrees, {name} would have to be focused within its front"
            " focal point; tilt less, or focus farther away"
        )
    farthest = float(_farthest(camera, lens.turn, 0.0))
    lit = np.flatnonzero(
        np.asarray(level.pupils.open & (level.bounds.beyond[: len(level.pupils.open)] < 0.5))
    )
    reach = float(level.film_step) * (int(lit[-1]) if len(lit) else 0)
    if reach + float(level.film_step) < farthest:
        circle = math.degrees(math.atan(reach))
        raise ValueError(
            f"tilted by {math.degrees(turned):.1f} degrees, a corner of the frame is"
            f" {math.degrees(math.atan(farthest)):.1f} degrees from the axis of {name}, whose image circle"
            f" reaches {circle:.1f} degrees; tilt less, use a smaller sensor, or a lens that covers more"
        )
