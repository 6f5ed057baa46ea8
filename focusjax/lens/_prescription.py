"""A real lens: rays traced from the film through its glass.

The camera's pinhole stands at the middle of the entrance pupil, which is the centre of perspective of what a
lens images sharply: points of the plane in focus whose rays through that point have the tangent t land, by
first-order optics, on the film at the height -s t (`film_distance` gives s). The film point of a pixel p is
therefore

    h = -s (p - c) / f,         c the principal point, f the camera's focal length in pixels,

so that the picture is framed as the pinhole's at every focus, but for the lens's distortion. With
`breathing`, s is the focal length, as on a film of fixed size: the picture then grows as the lens focuses
closer. A ray from h leaves the front of the lens as a straight line with slopes m that crosses the plane of
the entrance pupil at P, and a = c + f m, b = f P as for every ray (y downwards). By first-order optics it is
the thin lens's ray, with the entrance pupil's radius for the aperture's.

Rays are spread over an ellipse around the opening that their film point sees (`_pupils`). Light that falls on
the film is the integral of cos^4 over the last vertex plane, over the film distance squared; a ray's weight
is its part of it, in units of that on the axis. So corners are darker by cos^4 and by vignetting, as in
photographs.
"""

import dataclasses
from typing import SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import Disk
from focusjax.lens._base import AbstractLens
from focusjax.lens._length import Pair, root
from focusjax.lens._pupils import Pupils, find_pupils, from_film, openness
from focusjax.lens._ray_bounds import STEEPEST, RayBounds, exit_line, find_bounds
from focusjax.optics import (
    Prescription,
    film_distance,
    first_order,
    line,
    opened_to,
    trace,
    with_focal_length,
)

_RADII = 33
"""Film radii at which pupils and bounds are kept; as many less one lie between them."""
_FRAME_MARGIN = 4.0
"""Pixels beyond the frame from which rays may start, for wide filters."""
_RINGS = 1024


class PrescriptionLens(AbstractLens):
    """A prescription focused on a plane, as a source of rays. `prescription_lens` makes one.

    The film's light is followed by real rays, so that aberrations, distortion, vignetting and the shapes of
    out-of-focus highlights are the lens's own. Rays farther than 80 degrees from the axis are not taken.

    Attributes:
        prescription: in mm, with the stop as wide as the f-number wants.
        indices: refractive indices [n + 1] at the wavelength of these rays.
        focus_disparity: 1/m from the entrance pupil, where the camera stands.
        film_place: mm from the last vertex to the film.
        film_scale: s in mm.
        entrance_pupil: mm from the first vertex to the camera's place.
        film_step: tangent between the film radii of `pupils` and `bounds`.
        pupils: openings that film points see.
        bounds: disks around the rays of film points.
        exposure: in mm^2, the product of the ellipse's half axes times the mean share of light over it, on
            the axis.
        falloff: whether weights have the fourth power of the cosine to the axis at the film (static).
        focus: how it was focused, "traced" or "paraxial" (static).
        breathing: whether the film keeps its size at every focus (static).
    """

    prescription: Prescription
    indices: Float[Array, " n_plus_1"]
    focus_disparity: Float[Array, ""]
    film_place: Float[Array, ""]
    film_scale: Float[Array, ""]
    entrance_pupil: Float[Array, ""]
    film_step: Float[Array, ""]
    pupils: Pupils
    bounds: RayBounds
    exposure: Float[Array, ""]
    falloff: bool = eqx.field(static=True)
    focus: str = eqx.field(static=True)
    breathing: bool = eqx.field(static=True)

    def opening(self) -> Disk:
        return Disk()

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        aim = self.aim(camera, film_point, pupil_point)
        return line_of(camera, film_point, aim, *self.passing(aim))

    def aim(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> "Aim":
        """How a ray starts at the film."""
        # In numbers rather than vectors, which compilers keep in registers. Seen from the lens, the film is
        # upside down.
        x = (camera.principal_point[0] - film_point[0]) / camera.focal_px
        y = (film_point[1] - camera.principal_point[1]) / camera.focal_px
        radius, (along_x, along_y) = _polar(x, y)
        centre, radial, tangential = self._opening(radius / self.film_step)
        across_x, across_y = pupil_point[0], -pupil_point[1]
        out = centre + (radial - tangential) * (along_x * across_x + along_y * across_y)
        target_x, target_y = along_x * out + tangential * across_x, along_y * out + tangential * across_y
        light = radial * tangential / self.exposure
        if self.falloff:
            step_x, step_y = target_x - self.film_scale * x, target_y - self.film_scale * y
            square = self.film_place**2
            light *= (square / (step_x * step_x + step_y * step_y + square)) ** 2
        last = self.pupils.centre.shape[0] - 1
        light = jnp.where(radius <= last * self.film_step, light, 0.0)
        return Aim((x, y), (target_x, target_y), light)

    def passing(self, aim: "Aim") -> tuple[Pair, Pair, Float[Array, ""]]:
        """A ray's slopes [2] ahead of the lens, where [2] in mm it crosses the pupil, and its clearance."""
        (x, y), scale = aim.tangents, self.film_scale
        found, _ = from_film(
            self.prescription, self.indices, self.film_place, (scale * x, scale * y), aim.target
        )
        return *exit_line(found.position, found.direction, self.entrance_pupil), found.clearance

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Signed diameter in pixels, 2 f E (w_0 - w): about the film point's own best focus w_0.

        E is the radius of a round opening whose blur far from the focus has the same variance.
        """
        seen = self._bounds_at(camera, film_point)
        return 2.0 * camera.focal_px * seen.radius * (seen.focus - disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        seen = self._bounds_at(camera, film_point)
        _, along = self._off_axis(camera, film_point)
        middle = (seen.at_infinity + seen.crossing * disparity) * camera.focal_px
        radius = (seen.spot + seen.spread * jnp.abs(disparity - seen.focus)) * camera.focal_px
        return camera.principal_point + middle * jnp.stack(along), radius

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        seen = self.bounds
        radii = self.film_step * jnp.arange(seen.focus.shape[0], dtype=seen.focus.dtype)
        strays = jnp.abs(seen.at_infinity + seen.crossing * disparity - radii)
        return camera.focal_px * jnp.max(strays + seen.spot + seen.spread * jnp.abs(disparity - seen.focus))

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return camera.focal_px * jnp.max(jnp.abs(self.bounds.crossing) + self.bounds.spread)

    def focus_distance(self) -> Float[Array, ""]:
        """Distance in metres from the entrance pupil to the plane in focus; infinite when that is far."""
        return 1.0 / self.focus_disparity

    def f_number(self, camera: Camera) -> Float[Array, ""]:
        """Focal length over entrance pupil diameter, at the line d."""
        del camera
        return first_order(self.prescription).f_number

    def _off_axis(self, camera: Camera, film_point: Float[Array, "2"]) -> tuple[Float[Array, ""], Pair]:
        """Tangent of a film point to the axis, and the direction away from there in the picture."""
        x, y = (film_point[axis] - camera.principal_point[axis] for axis in range(2))
        return _polar(x / camera.focal_px, y / camera.focal_px)

    def pupil_magnification(self) -> Float[Array, ""]:
        """Diameter of the exit pupil over that of the entrance pupil, at the line d."""
        seen = first_order(self.prescription)
        return seen.exit_pupil_radius / seen.entrance_pupil_radius

    def _bounds_at(self, camera: Camera, film_point: Float[Array, "2"]) -> RayBounds:
        radius, _ = self._off_axis(camera, film_point)
        return self.bounds.at(radius / self.film_step)

    def _opening(self, place: Float[Array, ""]) -> tuple[Array, Array, Array]:
        """Centre and half axes in mm of the ellipse that a film point's rays are spread over."""
        pupils = self.pupils
        last = pupils.centre.shape[0] - 1
        low = jnp.clip(jnp.floor(place), 0, last - 1).astype(int)
        share = jnp.clip(place - low, 0.0, 1.0)
        centre, radial, tangential = (
            values[low] + share * (values[low + 1] - values[low])
            for values in (pupils.centre, pupils.radial, pupils.tangential)
        )
        return centre, radial, tangential


class Aim(eqx.Module):
    """How a ray starts at the film of a real lens, upside down and y upwards as the lens sees it.

    Attributes:
        tangents: the film point, over s.
        target: point of the last vertex plane in mm that the ray is aimed at.
        light: weight of the ray if it passes; 0 beyond the film.
    """

    tangents: Pair
    target: Pair
    light: Float[Array, ""]


def line_of(
    camera: Camera,
    film_point: Float[Array, "2"],
    aim: Aim,
    slope: Pair,
    crossing: Pair,
    clearance: Float[Array, ""],
) -> LensRay:
    """A ray ahead of a real lens as a line in image space; cut off, it is the pinhole's, without light."""
    flat = slope[0] * slope[0] + slope[1] * slope[1] < STEEPEST**2
    share = jnp.where(flat, openness(clearance) * aim.light, 0.0)
    a, b = [], []
    for axis, sign in enumerate((1.0, -1.0)):
        ahead = camera.principal_point[axis] + sign * camera.focal_px * slope[axis]
        a.append(jnp.where(share > 0.0, ahead, film_point[axis]))
        b.append(jnp.where(share > 0.0, sign * 1e-3 * camera.focal_px * crossing[axis], 0.0))
    return LensRay(a=jnp.stack(a), b=jnp.stack(b), weight=share)


def prescription_lens(
    prescription: Prescription,
    camera: Camera,
    *,
    focus_distance: SupportsFloat,
    f_number: SupportsFloat | None = None,
    focus: str = "traced",
    breathing: bool = False,
    falloff: bool = True,
) -> PrescriptionLens:
    """A prescription in a photographer's terms, scaled to the camera's focal length, with checked values.

    Args:
        prescription: any that forms images (`focusjax.optics`).
        camera: whose focal length the lens gets, and whose frame its rays are bounded for. It stands in the
            entrance pupil.
        focus_distance: metres from there; `inf` is allowed.
        f_number: focal length over entrance pupil diameter; that of the prescription if not given.
        focus: "traced" puts the film where the spot on the axis has the least variance, "paraxial" where rays
            near the axis meet.
        breathing: let the picture's scale follow the film's distance.
        falloff: let light fall off as cos^4 towards the corners; vignetting does so either way.

    Raises:
        ValueError: a lens without real images, an opening beyond the prescription's, a focus distance that
            takes the film into the lens or to infinity, or an unknown way to focus.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.optics import lens_preset
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> planar = lens_preset("planar_us583336_f4.5_1897")
        >>> lens = prescription_lens(planar, camera, focus_distance=2.0)
        >>> round(float(lens.f_number(camera)), 2)
        4.5
    """
    distance = float(focus_distance)
    if not distance > 0:
        raise ValueError(f"focus distance is {distance} m; expected a positive distance or infinity")
    if focus not in ("paraxial", "traced"):
        raise ValueError(f'focus is {focus!r}; expected "paraxial" or "traced"')
    lens = with_focal_length(prescription, float(camera.focal_length) * 1e3)
    if f_number is not None:
        lens = opened_to(lens, float(f_number))
    disparity = jnp.asarray(1.0 / distance, dtype=float)
    film, scale = film_distance(lens, lens.indices(line()), disparity * 1e-3)
    if not 0 < float(scale) < float("inf"):
        raise ValueError(
            f"focus distance {distance} m is within the front focal point of {lens.name}, where it forms no"
            " real image; focus farther away or use a shorter focal length"
        )
    if not float(film) > 0:
        raise ValueError(f"the film of {lens.name} would be {-float(film):.3g} mm inside the lens")
    return focused_lens(lens, camera, disparity, focus=focus, breathing=breathing, falloff=falloff)


def focused_lens(
    prescription: Prescription,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    *,
    focus: str = "traced",
    breathing: bool = False,
    falloff: bool = True,
) -> PrescriptionLens:
    """As `prescription_lens`, unchecked, not scaled nor stopped down: for derivatives and compiled code.

    Differentiable in the prescription and the focus; only the ellipse that rays are spread over is taken as
    it is, since any that covers the opening gives the same picture.
    """
    indices = prescription.indices(line())
    film, scale = film_for(prescription, camera, focus_disparity, focus, breathing=breathing)
    pupil = first_order(prescription).entrance_pupil
    lens = _placed(prescription, indices, film, scale, pupil, _film_step(camera), falloff)
    return dataclasses.replace(lens, focus_disparity=focus_disparity, focus=focus, breathing=breathing)


def film_for(
    prescription: Prescription,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    focus: str,
    *,
    breathing: bool,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Distance in mm from the last vertex to the film, and the film's scale s; see `focused_lens`."""
    seen = first_order(prescription)
    indices = prescription.indices(line())
    disparity = focus_disparity * 1e-3
    film, scale = film_distance(prescription, indices, disparity)
    if focus == "traced":
        best = _best_film(prescription, indices, disparity)
        scale = scale * (best - seen.exit_pupil) / (film - seen.exit_pupil)
        film = best
    if breathing:
        scale = camera.focal_length * 1e3
    return film, scale


def at_wavelength(
    lens: PrescriptionLens, camera: Camera, wavelength: SupportsFloat | Float[Array, ""]
) -> PrescriptionLens:
    """The same lens with its film where it is, for light of another `wavelength` in nm."""
    return with_indices(
        lens, camera, lens.prescription.indices(jnp.asarray(wavelength, dtype=lens.indices.dtype))
    )


def with_indices(
    lens: PrescriptionLens, camera: Camera, indices: Float[Array, " n_plus_1"]
) -> PrescriptionLens:
    """The same lens with its film where it is, for light that is refracted by other `indices`."""
    place = (lens.film_place, lens.film_scale, lens.entrance_pupil, _film_step(camera))
    other = _placed(lens.prescription, indices, *place, lens.falloff)
    kept = {name: getattr(lens, name) for name in ("focus_disparity", "exposure", "focus", "breathing")}
    return dataclasses.replace(other, **kept)


def _film_step(camera: Camera) -> Float[Array, ""]:
    """Tangent between the film radii that are kept, which reach beyond the frame's farthest corner."""
    size = jnp.array([camera.width, camera.height], dtype=camera.principal_point.dtype)
    farthest = jnp.maximum(camera.principal_point, size - camera.principal_point)
    reach = jnp.sqrt(farthest @ farthest) + _FRAME_MARGIN
    return jax.lax.stop_gradient(reach / camera.focal_px / (_RADII - 1))


@eqx.filter_jit
def _placed(
    prescription: Prescription,
    indices: Float[Array, " n_plus_1"],
    film: Float[Array, ""],
    scale: Float[Array, ""],
    pupil: Float[Array, ""],
    step: Float[Array, ""],
    falloff: bool,
) -> PrescriptionLens:
    """The lens with its film in place: find what film points see, and bound their rays."""
    radii = 0.5 * step * jnp.arange(2 * _RADII - 1, dtype=indices.dtype)
    pupils = find_pupils(prescription, indices, film, scale * radii)
    bounds = find_bounds(prescription, indices, film, scale, pupil, pupils, radii)
    # Rings of equal area: on the axis one ray stands for each.
    rings = pupils.radial[0] * jnp.sqrt((jnp.arange(_RINGS, dtype=indices.dtype) + 0.5) / _RINGS)

    def light(ring: Array) -> Array:
        zero = jnp.zeros_like(ring)
        found, cosine = from_film(prescription, indices, film, (zero, zero), (ring, zero))
        return openness(found.clearance) * (cosine**4 if falloff else 1.0)

    return PrescriptionLens(
        prescription=prescription,
        indices=indices,
        focus_disparity=jnp.zeros_like(film),
        film_place=film,
        film_scale=scale,
        entrance_pupil=pupil,
        film_step=step,
        pupils=jax.tree.map(lambda leaf: leaf[::2], pupils),
        bounds=bounds,
        exposure=jnp.mean(jax.vmap(light)(rings)) * pupils.radial[0] * pupils.tangential[0],
        falloff=falloff,
        focus="traced",
        breathing=False,
    )


@eqx.filter_jit
def _best_film(
    prescription: Prescription, indices: Float[Array, " n_plus_1"], disparity: Float[Array, ""]
) -> Float[Array, ""]:
    """Distance in mm from the last vertex at which the rays of the point in focus on the axis are closest.

    In the meridional plane the spot's variance over rings of equal area is a parabola in the film's distance.
    """
    seen = first_order(prescription)
    heights = seen.entrance_pupil_radius * jnp.sqrt((jnp.arange(_RINGS, dtype=indices.dtype) + 0.5) / _RINGS)

    def land(height: Array) -> tuple[Array, Array, Array]:
        slope = height * disparity
        way = jnp.stack([slope, jnp.zeros_like(slope), jnp.ones_like(slope)])
        start = jnp.stack([height, jnp.zeros_like(height), seen.entrance_pupil])
        found = trace(prescription, indices, start, way / jnp.sqrt(way @ way))
        exit_slope = found.direction[0] / found.direction[2]
        place = found.position[0] + exit_slope * (prescription.vertices()[-1] - found.position[2])
        return place, exit_slope, openness(found.clearance)

    place, slope, weight = jax.vmap(land)(heights)
    return -jnp.sum(weight * place * slope) / jnp.sum(weight * slope**2)


def _polar(x: Float[Array, ""], y: Float[Array, ""]) -> tuple[Float[Array, ""], Pair]:
    """Length and direction; of the zero vector 0 and x, with derivative 0."""
    size = root(x * x + y * y)
    inverse = 1.0 / jnp.where(size > 0.0, size, 1.0)
    return size, (jnp.where(size > 0.0, x * inverse, 1.0), y * inverse)
