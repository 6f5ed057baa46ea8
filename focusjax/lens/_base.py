"""What every lens answers: rays for a film point and a pupil point, and the blur they make."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay


class AbstractLens(eqx.Module):
    """A source of lens rays. One ray, one film point, one pupil point: callers vmap."""

    @abc.abstractmethod
    def pupil_point(self, sample: Float[Array, "2"]) -> Float[Array, "2"]:
        """Map a uniform `sample` of the unit square to a point of the opening, uniform by area.

        The point is in units of the aperture radius, in picture axes (x right, y down), so its
        norm is at most 1.
        """

    @abc.abstractmethod
    def rim_point(self, turn: Float[Array, ""]) -> Float[Array, "2"]:
        """The point of the opening's rim at `turn`, 0 to 1 once around, in the units of `pupil_point`.

        Sectors of equal turns about the middle have equal areas, so that sqrt(s) `rim_point(t)` is uniform
        by area over the unit square of (s, t).
        """

    @abc.abstractmethod
    def pupil_density(self, pupil_point: Float[Array, "2"]) -> Float[Array, ""]:
        """One over the opening's area, in squares of the aperture radius, at its points; 0 beside it."""

    @abc.abstractmethod
    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        """The ray that carries light from the scene through `pupil_point` to `film_point`.

        `film_point` is in output pixels: the place in the picture that receives the light.
        """

    @abc.abstractmethod
    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        """Signed circle-of-confusion diameter in pixels: positive behind the focus, else negative."""

    @abc.abstractmethod
    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        """Centre [2] and radius in pixels of a disk that holds all rays of `film_point` at `disparity`.

        Rays are linear in disparity, so the disks at both ends of a disparity interval bound all
        those between. The disks of a pixel's corners bound, in the same sense, those of the film points
        within it, to a thousandth of a pixel.
        """

    @abc.abstractmethod
    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        """How far in pixels, along x or y, rays are at most from their film points at `disparity`.

        A bound over all film points of the picture, and convex in the disparity.
        """

    @abc.abstractmethod
    def parallax(self, camera: Camera) -> Float[Array, ""]:
        """Largest |b| of any ray: pixels that the lens's rim moves per dioptre."""
