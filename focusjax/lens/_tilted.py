"""A real lens on a standard that tilts and swings: its glass turned against the film's normal.

The lens turns about the middle of its entrance pupil, where the camera's pinhole is. The film keeps its
normal and moves until what is in focus on that normal is at the wished distance; the plane in focus then
leans as `_tilted_film` derives. In the lens's own axes everything but the film is what it is for a level
lens: the film point of a pixel that looks along the tangents t of these axes is where the level lens, were it
focused at w(t) = m.(t, 1), has it,

    h = -s(w) t        at D(w) from the exit pupil,

on the ray through the exit pupil's middle. So the picture is framed as the pinhole's. A ray is aimed at the
place in the exit pupil that the level lens, focused at m_z, aims it at, followed through the glass, and its
line ahead turned into the camera's axes. Its light is the film's irradiance: cos(film) cos(lens) / r^2 over
the last vertex plane, in units of that on the axis of the level lens.
"""

import dataclasses
import functools
import math
from typing import SupportsFloat, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind
from focusjax.geometry import Camera, LensRay
from focusjax.lens._aim import line_of
from focusjax.lens._all_sides import is_round
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens
from focusjax.lens._film import film_for
from focusjax.lens._focused import FRAME_MARGIN, focused_lens, with_indices
from focusjax.lens._length import Pair
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._pupils import from_film, turns
from focusjax.lens._ray_bounds import STEEPEST, exit_line
from focusjax.lens._scheimpflug import MAX_TILT, turn_to, view_tangents
from focusjax.lens._spectral import SpectralLens
from focusjax.lens._tilted_bounds import FilmBounds, RayDisk, Rays, find_film_bounds
from focusjax.lens._tilted_film import TiltedFilm, tilted_film

_RINGS = (*(((ring + 0.5) / 4) ** 0.5 for ring in range(4)), 0.98, 1.0, 1.02)
"""Shares of the rim's radius at which bounds look: four that stand for equal areas, and about the rim."""
_AREAS = 4
_BLOCKS = 1e-3
"""Clearance by which a ray may be cut off and still be bounded."""


class TiltedPrescriptionLens(AbstractLens):
    """A prescription turned against the film, as a source of rays. `tilted_lens` makes one.

    Attributes:
        lens: the glass, level, with its film as far away as it is on the lens's axis.
        turn: camera axes from the lens's (X right, Y up, Z ahead) [3, 3].
        focus_disparity: 1/m along the film's normal from the entrance pupil, where the camera stands.
        film: where the film is.
        bounds: disks around the rays of film points.

    Example:
        >>> camera = fj.look_at((0, 1, 2), (0, 1, 0), width=60, height=40, focal_length=0.05)
        >>> planar = fj.lens_preset("planar_us583336_f4.5_1897")
        >>> level = fj.prescription_lens(planar, camera, focus_distance=2.0)
        >>> lens = fj.tilted_lens(level, camera, tilt=0.05)
        >>> [round(float(each), 2) for each in (lens.focus_distance(), *lens.plane)]
        [2.0, 0.0, -1.0, 0.5]
    """

    lens: PrescriptionLens
    turn: Float[Array, "3 3"]
    focus_disparity: Float[Array, ""]
    film: TiltedFilm
    bounds: FilmBounds

    @property
    def plane(self) -> Float[Array, "3"]:
        """The plane in focus n.P = 1, by first-order optics: n in 1/m, in camera axes."""
        return 1e3 * self.turn @ self._plane()

    def opening(self) -> AbstractAperture:
        return self.lens.opening()

    def vignettes(self) -> bool:
        return True

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        seen = view_tangents(camera, film_point)
        film, place = self._film_point(seen)
        target, light = self.lens.aimed_from(film, (pupil_point[0], -pupil_point[1]))
        slope, crossing, share, clearance = self._passing(film, place, target)
        return line_of(camera, film_point, light * share, slope, crossing, clearance)

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Signed diameter in pixels, 2 f E (w_0 - w): about the film point's own best focus w_0."""
        seen = self.bounds.at(view_tangents(camera, film_point))
        return 2.0 * camera.focal_px * seen.radius * (seen.focus - disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        seen = self.bounds.at(view_tangents(camera, film_point))
        middle = seen.at_infinity + seen.crossing * disparity
        radius = seen.spot + seen.spread * jnp.abs(disparity - seen.focus)
        down = jnp.array([1.0, -1.0], dtype=middle.dtype)
        return camera.principal_point + camera.focal_px * down * middle, camera.focal_px * radius

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return camera.focal_px * self.bounds.reach(disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return camera.focal_px * self.bounds.parallax()

    def focus_distance(self) -> Float[Array, ""]:
        """Distance in metres along the film's normal to the plane in focus; infinite when that is far."""
        return 1.0 / self.focus_disparity

    def f_number(self, camera: Camera) -> Float[Array, ""]:
        """Focal length over entrance pupil diameter, at the line d."""
        return self.lens.f_number(camera)

    def pupil_magnification(self) -> Float[Array, ""]:
        """Diameter of the exit pupil over that of the entrance pupil, at the line d."""
        return self.lens.pupil_magnification()

    def tilt_and_swing(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Radians, with the signs of `tilt_shift_lens`."""
        axis = self.turn[:, 2]
        return -jnp.arcsin(axis[1]), jnp.arctan2(axis[0], axis[2])

    def focused_at(self, camera: Camera, focus_disparity: Float[Array, ""]) -> "TiltedPrescriptionLens":
        """The same with its film moved, for `ray` alone: pupils and bounds stay."""
        level = self.lens
        film = tilted_film(level.prescription, jnp.zeros_like(focus_disparity))
        wanted = film.plane(self.turn[2], 1e-3 * focus_disparity)[2]
        place, scale = film_for(level.prescription, camera, 1e3 * wanted, level.focus, breathing=False)
        level = dataclasses.replace(level, film_place=place, film_scale=scale, focus_disparity=1e3 * wanted)
        film = dataclasses.replace(film, shift=place - film.place(wanted))
        return dataclasses.replace(self, lens=level, film=film, focus_disparity=focus_disparity)

    def _plane(self) -> Float[Array, "3"]:
        """M in 1/mm, in the lens's axes."""
        return self.film.plane(self.turn[2], 1e-3 * self.focus_disparity)

    def _film_point(self, seen: Float[Array, "2"]) -> tuple[Pair, Float[Array, ""]]:
        """What tangents of the view are for the level lens, upside down, and the film's place there in mm."""
        x, y, z = self.turn.T @ jnp.append(seen, 1.0)
        tangents = x / z, y / z
        plane = self._plane()
        disparity = plane[2] + plane[0] * tangents[0] + plane[1] * tangents[1]
        return (-tangents[0], -tangents[1]), self.film.place(disparity)

    def _passing(
        self, film: Pair, place: Float[Array, ""], target: Pair
    ) -> tuple[Pair, Pair, Float[Array, ""], Float[Array, ""]]:
        """A ray's slopes ahead of the lens and where in mm it crosses the pupil, in camera axes.

        Then its light over that of the level lens without falloff, and its clearance.

        Args:
            film: the level lens's film point over s, upside down.
            place: mm from the last vertex to the film there.
            target: point of the last vertex plane in mm that the level lens aims at.
        """
        level = self.lens
        before, moved = level.film_place, place - level.film_place
        inverse = 1.0 / (before - self.film.exit_pupil)
        start, aimed = [], []
        stretch = 1.0 + inverse * moved
        for at, to in zip(film, target, strict=True):
            height = level.film_scale * at
            start.append(height * stretch)
            # Through the same place of the exit pupil.
            way = ((to - height) / before - height * inverse**2 * moved) / stretch
            aimed.append(start[-1] + place * way)
        found, _ = from_film(level.prescription, level.indices, place, tuple(start), tuple(aimed))
        slope, crossing = exit_line(found.position, found.direction, level.entrance_pupil)
        ahead = self.turn @ jnp.stack([*slope, jnp.ones_like(place)])
        pupil = self.turn @ jnp.stack([*crossing, jnp.zeros_like(place)])
        flat = ahead[2] > jnp.sqrt(ahead @ ahead) / STEEPEST
        along = jnp.where(flat, ahead[2], 1.0)
        slope = ahead[0] / along, ahead[1] / along
        crossing = pupil[0] - pupil[2] * slope[0], pupil[1] - pupil[2] * slope[1]
        share = jnp.ones_like(place)
        if level.falloff:
            x, y = aimed[0] - start[0], aimed[1] - start[1]
            square = x * x + y * y + place * place
            normal = self.turn[2]
            cosines = (normal[0] * x + normal[1] * y + normal[2] * place) * place / square
            area = (place / (before * stretch)) ** 2
            share = area * before**2 * cosines / square
        return slope, crossing, jnp.where(flat, share, 0.0), found.clearance


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


@eqx.filter_jit
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
    film, place = lens._film_point(seen)
    level = lens.lens
    radius = jnp.sqrt(film[0] ** 2 + film[1] ** 2)
    along = (
        jnp.where(radius > 0.0, film[0] / jnp.where(radius > 0.0, radius, 1.0), 1.0),
        film[1] / jnp.where(radius > 0.0, radius, 1.0),
    )
    pupils = level.pupils
    at = radius / level.film_step
    last = pupils.centre.shape[0] - 1
    low = jnp.clip(jnp.floor(at), 0, last - 1).astype(int)
    part = jnp.clip(at - low, 0.0, 1.0)
    inside, rim = (table[low] + part * (table[low + 1] - table[low]) for table in (pupils.inside, pupils.rim))
    angles = turns(rim.dtype)[None]
    shares = jnp.asarray(_RINGS, dtype=rim.dtype)[:, None]
    rings = shares * rim[None]
    counts = (jnp.arange(len(_RINGS)) < _AREAS)[:, None]
    area = jnp.where(counts, rim[None] ** 2, 0.0)
    out, aside = (inside + rings * jnp.cos(angles)).ravel(), (rings * jnp.sin(angles)).ravel()
    out, aside = jnp.tile(out, 2), jnp.concatenate([aside, -aside])
    targets = along[0] * out - along[1] * aside, along[1] * out + along[0] * aside

    def one(x: Array, y: Array) -> tuple[Array, Array, Array]:
        slope, crossing, share, clearance = lens._passing(film, place, (x, y))
        open_ = (clearance > -_BLOCKS) & (share > 0.0)
        return jnp.stack(slope), 1e-3 * jnp.stack(crossing), jnp.where(open_, 1.0, 0.0)

    slope, crossing, light = jax.vmap(one)(*targets)
    return slope, crossing, light, jnp.tile(area.ravel(), 2)


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
