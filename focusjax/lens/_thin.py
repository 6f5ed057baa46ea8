"""The thin lens: every ray of a film point meets in one point of the focal plane."""

from typing import SupportsFloat

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind
from focusjax.geometry import Camera, LensRay
from focusjax.lens._aperture import AbstractAperture, Disk
from focusjax.lens._base import AbstractLens


class ThinLens(AbstractLens):
    """An ideal lens focused on the plane at disparity w_f (Potmesil and Chakravarty 1981).

    All rays of film point p pass through q(w_f) = p, and cross the lens at E v with E the
    aperture radius and v in the unit disk. Hence b = f E v and a = p - b w_f, and a point at
    disparity w is smeared over a disk of diameter 2 f E (w_f - w): linear in the focal disparity,
    which is why focusing on infinity needs no special case.

    The field of view does not change with the focus (no focus breathing).

    Attributes:
        focus_disparity: 1 / focus distance, in 1/m; 0 focuses on infinity.
        aperture_radius: radius E in metres of the circle around the opening; 0 is a pinhole.
        aperture: shape of the opening.

    Example:
        >>> lens = thin_lens(focus_distance=2.0, f_number=2.0, focal_length=0.05)
        >>> float(lens.focus_disparity), round(float(lens.aperture_radius), 6)
        (0.5, 0.0125)
    """

    focus_disparity: Float[Array, ""]
    aperture_radius: Float[Array, ""]
    aperture: AbstractAperture = eqx.field(default_factory=Disk)

    def opening(self) -> AbstractAperture:
        return self.aperture

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        b = self.parallax(camera) * pupil_point
        return LensRay(a=film_point - b * self.focus_disparity, b=b, weight=jnp.ones_like(b[0]))

    def blur(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> Float[Array, ""]:
        del film_point
        return 2.0 * self.parallax(camera) * (self.focus_disparity - disparity)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        return film_point, self.parallax(camera) * jnp.abs(self.focus_disparity - disparity)

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        return self.parallax(camera) * jnp.abs(self.focus_disparity - disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        return camera.focal_px * self.aperture_radius

    def focus_distance(self) -> Float[Array, ""]:
        """Distance in metres of the plane in focus; infinite when focused on infinity."""
        return 1.0 / self.focus_disparity

    def f_number(self, camera: Camera) -> Float[Array, ""]:
        """Focal length over aperture diameter; infinite for a pinhole."""
        return camera.focal_length / (2.0 * self.aperture_radius)


def thin_lens(
    *,
    focus_distance: SupportsFloat,
    focal_length: SupportsFloat | None = None,
    f_number: SupportsFloat | None = None,
    aperture_radius: SupportsFloat | None = None,
    aperture: AbstractAperture | None = None,
) -> ThinLens:
    """A `ThinLens` in a photographer's terms, with checked values.

    Args:
        focus_distance: metres from the lens; `inf` is allowed.
        focal_length: metres; needed with `f_number`, and checked against the focus distance.
        f_number: focal length over aperture diameter; give this or `aperture_radius`.
        aperture_radius: metres; 0 is a pinhole.
        aperture: shape of the opening; a disk when not given.

    Raises:
        ValueError: a value out of range, a focus distance within the focal length, or not
            exactly one of `f_number` and `aperture_radius`.
    """
    distance = real_number(focus_distance, "focus distance in metres", "a positive distance or infinity")
    if not distance > 0:
        raise ValueError(f"focus distance is {distance} m; expected a positive distance or infinity")
    if focal_length is not None:
        length = real_number(focal_length, "focal length in metres", "a positive length")
        if not 0 < length < float("inf"):
            raise ValueError(f"focal length is {length} m; expected a positive length")
        if distance <= length:
            raise ValueError(
                f"focus distance {distance} m is within the focal length {length} m, where no lens"
                " forms a real image; focus farther away or use a shorter focal length"
            )
    if (f_number is None) == (aperture_radius is None):
        raise ValueError("give exactly one of f-number and aperture radius")
    if f_number is not None:
        wanted = real_number(f_number, "f-number", "a positive number such as 2.8")
        if not 0 < wanted < float("inf"):
            raise ValueError(f"f-number is {f_number}; expected a positive number such as 2.8")
        if focal_length is None:
            raise ValueError("an f-number needs the focal length; give it, or the aperture radius")
        radius = float(focal_length) / (2.0 * wanted)
    else:
        assert aperture_radius is not None
        radius = real_number(aperture_radius, "aperture radius in metres", "zero or a positive length")
        if not 0 <= radius < float("inf"):
            raise ValueError(f"aperture radius is {radius} m; expected zero or a positive length")
    if aperture is not None:
        remedy = "`polygon`, `obstructed`, `apodized` and `mask` make one, and Disk() is round"
        require_kind(aperture, AbstractAperture, "thin_lens(aperture=)", remedy, "aperture")
    return ThinLens(
        focus_disparity=jnp.asarray(1.0 / distance, dtype=float),
        aperture_radius=jnp.asarray(radius, dtype=float),
        aperture=Disk() if aperture is None else aperture,
    )
