"""A real lens on a standard that tilts and swings: its glass turned against the film's normal.

The lens turns about the middle of its entrance pupil, where the camera's pinhole is. The film keeps its
normal and moves until what is in focus on that normal is at the wished distance; the plane in focus then
leans as derived below. In the lens's own axes everything but the film is what it is for a level lens: the
film point of a pixel that looks along the tangents t of these axes is where the level lens, were it focused
at w(t) = m.(t, 1), has it,

    h = -s(w) t        at D(w) from the exit pupil,

on the ray through the exit pupil's middle. So the picture is framed as the pinhole's. A ray is aimed at the
place in the exit pupil that the level lens, focused at m_z, aims it at, followed through the glass, and its
line ahead turned into the camera's axes. Its light is the film's irradiance: cos(film) cos(lens) / r^2 over
the last vertex plane, in units of that on the axis of the level lens.

Where the film has to be is first-order optics. Axes are the lens's: Z ahead along its axis, 0 the entrance
pupil's middle; w is in 1/mm. A level film is sharp at the disparity w when its distance and scale are

    D(w) = (p/F - w)^-1 p^2 from the exit pupil,        s(w) = D(w) / p = -1 / S(w),        S(w) = w/p - 1/F,

p being the exit pupil's diameter over the entrance pupil's. Points of a plane m.P = 1 that are seen along
the tangents t have the disparity w(t) = m_z + m_xy . t, and their images, at the height -s(w(t)) t, are in a
plane again: the film. Its normal is along (m_xy, S(m_z)), so that a film whose normal is g has

    m_xy = S(m_z) g_xy / g_z,

and the plane meets the film's normal through the pupil at the disparity w_0 = g.m where

    m_z (g_z + |g_xy|^2 / (p g_z)) = w_0 + |g_xy|^2 / (F g_z).

For p = 1 this is Scheimpflug's rule of `_tilt_shift`.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens
from focusjax.lens._film import film_for
from focusjax.lens._length import Pair
from focusjax.lens._prescription import PrescriptionLens, line_of
from focusjax.lens._pupils import from_film
from focusjax.lens._ray_bounds import STEEPEST, exit_line
from focusjax.lens._scheimpflug import view_tangents
from focusjax.lens._tilted_bounds import FilmBounds
from focusjax.optics import Prescription, film_distance, first_order, line


class TiltedFilm(eqx.Module):
    """The film of a lens that may lean, by the disparity in 1/mm that it is sharp at from place to place.

    Attributes:
        top: of the fraction that is the distance in mm from the last vertex: [2], at w = 0 and per w.
        slope: S at w = 0 and per w, [2] in 1/mm and 1.
        exit_pupil: mm from the last vertex.
        shift: mm along the axis, for the spots of real rays.
    """

    top: Float[Array, "2"]
    slope: Float[Array, "2"]
    exit_pupil: Float[Array, ""]
    shift: Float[Array, ""]

    def place(self, disparity: Float[Array, ""]) -> Float[Array, ""]:
        """Mm from the last vertex."""
        return (self.top[0] + self.top[1] * disparity) / self._slope(disparity) + self.shift

    def plane(self, normal: Float[Array, "3"], disparity: Float[Array, ""]) -> Float[Array, "3"]:
        """M in 1/mm of the plane in focus.

        Args:
            normal: g, of the film.
            disparity: w_0 in 1/mm.
        """
        across = normal[:2] @ normal[:2] / normal[2]
        level = (disparity - across * self.slope[0]) / (normal[2] + across * self.slope[1])
        return jnp.append(self._slope(level) * normal[:2] / normal[2], level)

    def _slope(self, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.slope[0] + self.slope[1] * disparity


def tilted_film(prescription: Prescription, shift: Float[Array, ""]) -> TiltedFilm:
    """The film of a prescription at the line d, moved by `shift` mm along the axis."""
    indices = prescription.indices(line())
    seen = first_order(prescription)
    # Both are ratios of what goes evenly with the disparity: two of them say all.
    ends = jnp.stack([jnp.zeros_like(shift), 0.1 / seen.focal_length])
    places, scales = zip(*(film_distance(prescription, indices, end) for end in ends), strict=True)
    slopes = [-1.0 / scale for scale in scales]
    tops = [place * slope for place, slope in zip(places, slopes, strict=True)]
    top, slope = (jnp.stack([each[0], (each[1] - each[0]) / ends[1]]) for each in (tops, slopes))
    return TiltedFilm(top, slope, seen.exit_pupil, shift)


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
        film, place = self.film_at(seen)
        target, light = self.lens.aimed_from(film, (pupil_point[0], -pupil_point[1]))
        slope, crossing, share, clearance = self.passing(film, place, target)
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

    def film_at(self, seen: Float[Array, "2"]) -> tuple[Pair, Float[Array, ""]]:
        """What tangents of the view are for the level lens, upside down, and the film's place there in mm."""
        x, y, z = self.turn.T @ jnp.append(seen, 1.0)
        tangents = x / z, y / z
        plane = self._plane()
        disparity = plane[2] + plane[0] * tangents[0] + plane[1] * tangents[1]
        return (-tangents[0], -tangents[1]), self.film.place(disparity)

    def passing(
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
            # The film has one side.
            cosines = jnp.maximum(normal[0] * x + normal[1] * y + normal[2] * place, 0.0) * place / square
            area = (place / (before * stretch)) ** 2
            share = area * before**2 * cosines / square
        return slope, crossing, jnp.where(flat, share, 0.0), found.clearance
