"""The five Seidel aberrations, as gradients of a wavefront polynomial over the pupil (Kyaw eq. 6.2)."""

from typing import SupportsFloat

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number
from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens, frame_corners
from focusjax.lens._length import length
from focusjax.lens.aberrations._base import AbstractAberration, Bounds


class Seidel(AbstractAberration):
    """Third-order aberrations, over any lens.

    With u the ray's point on the pupil in radii of the full opening, and h the film point from the principal
    point in half diagonals of the frame, so that |h| = 1 in the corners of an unshifted frame, the wavefront
    is

        W = W040 |u|^4 - W131 (h.u) |u|^2 + W222 (h.u)^2 + W220 |h|^2 |u|^2 - W311 |h|^2 (h.u),

    (the image itself, upside down, is at -h), and light that an ideal lens sends to p lands at p + grad_u W.
    The coefficients are in pixels: W040 moves the rim's rays by 4 W040. A positive one makes

    - W040 spherical aberration, under-corrected: the rim focuses nearer than the middle;
    - W131 coma whose tail points to the middle of the picture, 3 W131 long in the corner at full opening;
    - W222 astigmatism: rays in the plane of h focus nearer towards the corners, those across it do not;
    - W220 field curvature: the focus is nearer towards the corners;
    - W311 barrel distortion: corners are drawn in by W311.

    u is taken from where rays cross the lens: stopped down to a part of the full opening, it has the
    aberrations of that part, and a pinhole has only distortion.

    Attributes:
        w040: pixels.
        w131: pixels.
        w222: pixels.
        w220: pixels.
        w311: pixels.
        full_radius: radius in metres of the opening that the coefficients are for.
    """

    w040: Float[Array, ""]
    w131: Float[Array, ""]
    w222: Float[Array, ""]
    w220: Float[Array, ""]
    w311: Float[Array, ""]
    full_radius: Float[Array, ""]

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        # The film point looks where the light that lands on it was meant to go.
        del pupil_point
        u, h = b / self._full(camera), _field(camera, film_point)
        square, across, far = u @ u, h @ u, h @ h
        gradient = 4.0 * self.w040 * square * u
        gradient -= self.w131 * (h * square + 2.0 * across * u)
        gradient += 2.0 * self.w222 * across * h
        gradient += 2.0 * self.w220 * far * u
        gradient -= self.w311 * far * h
        return -gradient

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        # (h.u) h is |h|^2 u / 2 and as much again, mirrored at h. Coma's circles lie in a disk that they
        # touch on both sides, 1.5 W131 |h| around.
        full, h = self._full(camera), _field(camera, film_point)
        k, far = parallax / full, h @ h
        flat = (2.0 * self.w220 + self.w222) * far / full
        rim = flat + 4.0 * self.w040 * k**2 / full
        coma = 1.5 * self.w131 * k**2
        return Bounds(
            least=jnp.minimum(flat, rim),
            most=jnp.maximum(flat, rim),
            shift=(coma + self.w311 * far) * h,
            spread=jnp.abs(coma) * length(h) + jnp.abs(self.w222) * far * k,
        )

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        full = self._full(camera)
        h = (frame_corners(camera, full.dtype) - camera.principal_point[None]) / _half_diagonal(camera)
        far = (h**2).sum(axis=1).max()
        k, zero = parallax / full, jnp.zeros_like(full)
        flat = (2.0 * self.w220 + self.w222) * far / full
        sphere = 4.0 * self.w040 * k**2 / full
        coma, barrel = 3.0 * jnp.abs(self.w131) * k**2, jnp.abs(self.w311) * far
        return Bounds(
            least=jnp.minimum(flat, zero) + jnp.minimum(sphere, zero),
            most=jnp.maximum(flat, zero) + jnp.maximum(sphere, zero),
            shift=jnp.stack([zero, zero]),
            spread=(coma + barrel) * jnp.sqrt(far) + jnp.abs(self.w222) * far * k,
        )

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        # The mean of |u|^2 weighted by |u|^2 is two thirds of the rim's.
        full, h = self._full(camera), _field(camera, film_point)
        sphere = 8.0 / 3.0 * self.w040 * (parallax / full) ** 2
        return (sphere + (2.0 * self.w220 + self.w222) * (h @ h)) / full

    def _full(self, camera: Camera) -> Float[Array, ""]:
        """Pixels per dioptre of the full opening's rim."""
        return camera.focal_px * self.full_radius


def seidel(
    lens: AbstractLens,
    camera: Camera,
    *,
    w040: SupportsFloat = 0.0,
    w131: SupportsFloat = 0.0,
    w222: SupportsFloat = 0.0,
    w220: SupportsFloat = 0.0,
    w311: SupportsFloat = 0.0,
) -> Seidel:
    """`Seidel` aberrations for a lens as it is open now, with checked coefficients in pixels.

    Raises:
        ValueError: a coefficient that is not finite, or a lens that is closed.

    Example:
        >>> from focusjax import look_at
        >>> from focusjax.lens import AberratedLens, thin_lens
        >>> camera = look_at((0, 0, 0), (0, 0, -1), width=60, height=40, focal_length=0.05)
        >>> thin = thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> lens = AberratedLens(thin, (seidel(thin, camera, w040=0.5, w131=1.0),))
    """
    given = {"w040": w040, "w131": w131, "w222": w222, "w220": w220, "w311": w311}
    for name, value in given.items():
        if not np.isfinite(real_number(value, name, "a finite number of pixels")):
            raise ValueError(f"{name} is {value}; expected a finite number of pixels")
    radius = lens.parallax(camera) / camera.focal_px
    if not float(radius) > 0:
        raise ValueError("a closed lens has no Seidel aberrations; open it, and stop it down afterwards")
    numbers = {name: jnp.asarray(float(value), dtype=float) for name, value in given.items()}
    return Seidel(**numbers, full_radius=jnp.asarray(radius, dtype=float))


def pixels_per_wave(
    camera: Camera, f_number: SupportsFloat, wavelength: SupportsFloat = 587.6e-9
) -> Float[Array, ""]:
    """Pixels that a wavefront coefficient of one wave is, as a coefficient of `Seidel`.

    The transverse aberration on the sensor is the wavefront's slope over the exit pupil, which is seen
    from there under 1 / (2 N): 2 N times the wavelength.

    Args:
        camera: whose pixels are meant.
        f_number: N at the full opening.
        wavelength: metres.

    Raises:
        ValueError: one that is not positive.
    """
    number, wave = (
        real_number(value, name, f"a positive number such as {usual}")
        for name, value, usual in (
            ("f-number", f_number, 2.8),
            ("wavelength in metres", wavelength, 5e-7),
        )
    )
    if not (number > 0 and wave > 0):
        raise ValueError(f"f-number is {number} and wavelength {wave} m; expected positive numbers")
    return 2.0 * number * wave * camera.focal_px / camera.focal_length


def seidel_of_wavefront(
    lens: AbstractLens,
    camera: Camera,
    *,
    f_number: SupportsFloat,
    height: SupportsFloat | None = None,
    w040: SupportsFloat = 0.0,
    w131: SupportsFloat = 0.0,
    w222: SupportsFloat = 0.0,
    w220: SupportsFloat = 0.0,
    w311: SupportsFloat = 0.0,
) -> Seidel:
    """`Seidel` aberrations from wavefront coefficients of one opening and one height in the picture.

    By the third-order laws (Kyaw eq. 6.2 to 6.7) W040 grows as the fourth power of the opening's radius, W131
    as the third and the height, W222 and W220 as the squares of both, W311 as the radius and the third power
    of the height. On the sensor a slope of the wavefront moves rays by 2 N times as much, so that spots grow
    as 1/N^3, h/N^2, h^2/N and h^2/N, and distortion as h^3 whatever the opening is. As the picture keeps its
    framing at every focus, so do they.

    Args:
        lens: as it is open in the picture; it may be wider or narrower than `f_number`.
        camera: whose pixels are meant.
        f_number: of the opening that the coefficients are for.
        height: metres on the sensor from the principal point, for which they are; half the sensor's diagonal
            when not given.
        w040: metres, at the rim of that opening, as all are; the signs are those of `Seidel`.
        w131: metres.
        w222: metres.
        w220: metres.
        w311: metres.

    Raises:
        ValueError: a number that is not finite, an f-number or a height that is not positive, or a closed
            lens.

    Example:
        >>> from focusjax import look_at
        >>> from focusjax.lens import thin_lens
        >>> camera = look_at((0, 0, 0), (0, 0, -1), width=60, height=40, focal_length=0.05)
        >>> wide, narrow = (thin_lens(focus_distance=2, f_number=n, focal_length=0.05) for n in (2, 4))
        >>> spots = [seidel_of_wavefront(lens, camera, f_number=2, w040=1e-5).w040 for lens in (wide, narrow)]
        >>> round(float(spots[0] / spots[1]), 6)
        8.0
    """
    diagonal = _half_diagonal(camera) * float(camera.focal_length) / float(camera.focal_px)
    stated = real_number(f_number, "the f-number of the coefficients", "a positive number such as 2.0")
    at = diagonal if height is None else real_number(height, "the height in metres", "a positive length")
    if not (0 < stated < np.inf and 0 < at < np.inf):
        raise ValueError(
            f"the coefficients are for f/{stated:g} and a height of {at:g} m; expected positive numbers"
        )
    opening = stated * 2.0 * float(lens.parallax(camera) / camera.focal_px) / float(camera.focal_length)
    if not opening > 0:
        raise ValueError("a closed lens has no Seidel aberrations; open it, and stop it down afterwards")
    # Pixels per metre of the wavefront, at the opening that there is.
    gain = float(pixels_per_wave(camera, stated / opening, 1.0))
    given = {"w040": w040, "w131": w131, "w222": w222, "w220": w220, "w311": w311}
    pixels = {
        name: gain
        * real_number(value, name, "a finite length in metres")
        * opening ** _RADIUS_POWERS[name]
        * (diagonal / at) ** _HEIGHT_POWERS[name]
        for name, value in given.items()
    }
    return seidel(lens, camera, **pixels)


_RADIUS_POWERS = {"w040": 4, "w131": 3, "w222": 2, "w220": 2, "w311": 1}
_HEIGHT_POWERS = {"w040": 0, "w131": 1, "w222": 2, "w220": 2, "w311": 3}


def _half_diagonal(camera: Camera) -> float:
    return 0.5 * float(np.hypot(camera.width, camera.height))


def _field(camera: Camera, film_point: Float[Array, "2"]) -> Float[Array, "2"]:
    return (film_point - camera.principal_point) / _half_diagonal(camera)
