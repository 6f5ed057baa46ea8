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

Rays are spread over an ellipse around the opening that their film point sees (`_pupils`); where the stop has
blades or another shape, they cross it where its light is (`_stop_map`). Light that falls on the film is the
integral of cos^4 over the last vertex plane, over the film distance squared; a ray's weight is its part of
it, in units of that on the axis. So corners are darker by cos^4 and by vignetting, as in photographs.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture
from focusjax.lens._base import AbstractLens
from focusjax.lens._length import Pair, root
from focusjax.lens._pupils import Pupils, at_place, from_film, openness
from focusjax.lens._ray_bounds import STEEPEST, RayBounds, exit_line
from focusjax.lens._stop_map import StopMap
from focusjax.optics import Prescription, first_order


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
    light: Float[Array, ""],
    slope: Pair,
    crossing: Pair,
    clearance: Float[Array, ""],
) -> LensRay:
    """A ray ahead of a real lens as a line in image space; cut off, it is the pinhole's, without light.

    `light` is its weight if it passes.
    """
    flat = slope[0] * slope[0] + slope[1] * slope[1] < STEEPEST**2
    share = jnp.where(flat, openness(clearance) * light, 0.0)
    a, b = [], []
    for axis, sign in enumerate((1.0, -1.0)):
        ahead = camera.principal_point[axis] + sign * camera.focal_px * slope[axis]
        a.append(jnp.where(share > 0.0, ahead, film_point[axis]))
        b.append(jnp.where(share > 0.0, sign * 1e-3 * camera.focal_px * crossing[axis], 0.0))
    return LensRay(a=jnp.stack(a), b=jnp.stack(b), weight=share)


def polar(x: Float[Array, ""], y: Float[Array, ""]) -> tuple[Float[Array, ""], Pair]:
    """Length and direction; of the zero vector 0 and x, with derivative 0."""
    size = root(x * x + y * y)
    inverse = 1.0 / jnp.where(size > 0.0, size, 1.0)
    return size, (jnp.where(size > 0.0, x * inverse, 1.0), y * inverse)


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
        aperture: shape of the opening in the stop.
        stop_map: where rays are aimed to cross the stop; None where it is round, and all that is seen of it
            is open.
        exposure: in mm^2, the mean on the axis of the area that a ray stands for times its share of light.
        falloff: whether weights have the fourth power of the cosine to the axis at the film (static).
        focus: how it was focused, "traced" or "paraxial" (static).
        breathing: whether the film keeps its size at every focus (static).

    Example:
        >>> camera = fj.look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> triplet = fj.lens_preset("cooke_triplet_50mm_f4")
        >>> lens = fj.prescription_lens(triplet, camera, focus_distance=2.0, f_number=8)
        >>> round(float(lens.focus_distance()), 4), round(float(lens.f_number(camera)), 3)
        (2.0, 8.0)
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
    aperture: AbstractAperture
    stop_map: StopMap | None
    exposure: Float[Array, ""]
    falloff: bool = eqx.field(static=True)
    focus: str = eqx.field(static=True)
    breathing: bool = eqx.field(static=True)

    def opening(self) -> AbstractAperture:
        return self.aperture

    def vignettes(self) -> bool:
        return True

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        aim = self.aim(camera, film_point, pupil_point)
        return line_of(camera, film_point, aim.light, *self.passing(aim))

    def aim(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> Aim:
        """How a ray starts at the film."""
        # In numbers rather than vectors, which compilers keep in registers. Seen from the lens, the film is
        # upside down.
        x = (camera.principal_point[0] - film_point[0]) / camera.focal_px
        y = (film_point[1] - camera.principal_point[1]) / camera.focal_px
        (target_x, target_y), light = self.aimed_from((x, y), (pupil_point[0], -pupil_point[1]))
        if self.falloff:
            step_x, step_y = target_x - self.film_scale * x, target_y - self.film_scale * y
            square = self.film_place**2
            light *= (square / (step_x * step_x + step_y * step_y + square)) ** 2
        return Aim((x, y), (target_x, target_y), light)

    def aimed_from(self, film: Pair, opening: Pair) -> tuple[Pair, Float[Array, ""]]:
        """Point in mm of the last vertex plane for one of the opening, and the light without its falloff.

        Args:
            film: the film point over s, upside down.
            opening: the point of the opening; both with y upwards, as the lens sees them.
        """
        radius, (along_x, along_y) = polar(*film)
        r = along_x * opening[0] + along_y * opening[1]
        t = along_x * opening[1] - along_y * opening[0]
        (out, aside), area = self.aimed_at(radius / self.film_step, r, t)
        last = self.pupils.centre.shape[0] - 1
        light = jnp.where(radius <= last * self.film_step, area / self.exposure, 0.0)
        return (along_x * out - along_y * aside, along_y * out + along_x * aside), light

    def passing(self, aim: Aim) -> tuple[Pair, Pair, Float[Array, ""]]:
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
        return polar(x / camera.focal_px, y / camera.focal_px)

    def pupil_magnification(self) -> Float[Array, ""]:
        """Diameter of the exit pupil over that of the entrance pupil, at the line d."""
        seen = first_order(self.prescription)
        return seen.exit_pupil_radius / seen.entrance_pupil_radius

    def _bounds_at(self, camera: Camera, film_point: Float[Array, "2"]) -> RayBounds:
        radius, _ = self._off_axis(camera, film_point)
        return self.bounds.at(radius / self.film_step)

    def aimed_at(
        self, place: Float[Array, ""], r: Float[Array, ""], t: Float[Array, ""]
    ) -> tuple[Pair, Array]:
        """Point in mm of the last vertex plane for one of the opening, and mm^2 there per unit of its area.

        Both are along the film point's side, at a `place` counted in film radii, and across.
        """
        if self.stop_map is not None:
            return self.stop_map.at(place, r, t)
        pupils = self.pupils
        centre, radial, tangential = at_place((pupils.centre, pupils.radial, pupils.tangential), place)
        return (centre + radial * r, tangential * t), radial * tangential
