"""The thin lens: every ray of a film point meets in one point of the focal plane."""

import math
from typing import Any, SupportsFloat

import equinox as eqx
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float

from focusjax._arguments import number_or_traced, require_kind
from focusjax._words import shown
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
    """A `ThinLens` in a photographer's terms, with checked values, each of which JAX may trace.

    Args:
        focus_distance: metres from the lens; `inf` is allowed.
        focal_length: metres; needed with `f_number`, and checked against the focus distance.
        f_number: focal length over aperture diameter; give this or `aperture_radius`.
        aperture_radius: metres; 0 is a pinhole.
        aperture: shape of the opening; a disk when not given.

    Raises:
        ValueError: a value out of range, a focus distance within the focal length, or not
            exactly one of `f_number` and `aperture_radius`.
        EquinoxRuntimeError: (a `RuntimeError`) a traced value is out of range; see `render`.

    Example:
        >>> import jax
        >>> def disparity(distance):
        ...     return thin_lens(focus_distance=distance, aperture_radius=0.01).focus_disparity
        >>> float(jax.grad(disparity)(2.0))
        -0.25
    """
    distance = number_or_traced(focus_distance, "focus distance in metres", "a positive distance or infinity")
    distance = _require(
        distance,
        distance > 0,
        f"focus distance is{_said(distance, ' m')}; expected a positive distance or infinity",
    )
    length = None
    if focal_length is not None:
        length = number_or_traced(focal_length, "focal length in metres", "a positive length")
        positive = (length > 0) & (length < math.inf)
        length = _require(
            length, positive, f"focal length is{_said(length, ' m')}; expected a positive length"
        )
        distance = _require(
            distance,
            distance > length,
            f"focus distance{_said(distance, ' m', '')} is within the focal length{_said(length, ' m', '')},"
            " where no lens forms a real image; focus farther away or use a shorter focal length",
        )
    if (f_number is None) == (aperture_radius is None):
        raise ValueError("give exactly one of f-number and aperture radius")
    if f_number is not None:
        expected = "a positive number such as 2.8"
        wanted = number_or_traced(f_number, "f-number", expected)
        positive = (wanted > 0) & (wanted < math.inf)
        wanted = _require(wanted, positive, f"f-number is{_said(wanted)}; expected {expected}")
        if length is None:
            raise ValueError("an f-number needs the focal length; give it, or the aperture radius")
        radius = length / (2.0 * wanted)
    else:
        expected = "zero or a positive length"
        radius = number_or_traced(aperture_radius, "aperture radius in metres", expected)
        possible = (radius >= 0) & (radius < math.inf)
        radius = _require(radius, possible, f"aperture radius is{_said(radius, ' m')}; expected {expected}")
    if aperture is not None:
        remedy = "`polygon`, `obstructed`, `apodized` and `mask` make one, and Disk() is round"
        require_kind(aperture, AbstractAperture, "thin_lens(aperture=)", remedy, "aperture")
    return ThinLens(
        focus_disparity=jnp.asarray(1.0 / distance, dtype=float),
        aperture_radius=jnp.asarray(radius, dtype=float),
        aperture=Disk() if aperture is None else aperture,
    )


def _require(value: Any, holds: Any, sentence: str) -> Any:
    """A value of which something `holds`; else the sentence, from compiled code where that is traced."""
    if isinstance(holds, Tracer):
        return eqx.error_if(jnp.asarray(value, dtype=float), ~holds, sentence)
    if not holds:
        raise ValueError(sentence)
    return value


def _said(value: Any, unit: str = "", traced: str = " out of range") -> str:
    """A value for a sentence, after a blank; what to say in its place where it is traced."""
    return traced if isinstance(value, Tracer) else f" {shown(value)}{unit}"
