"""Cat's eyes: a second disk that rays have to pass, ahead of the lens or behind it."""

import dataclasses
from typing import SupportsFloat

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number
from focusjax.geometry import Camera, LensRay
from focusjax.lens._base import AbstractLens
from focusjax.lens._falloff import CosineFalloff, DarkenedLens, illumination
from focusjax.lens._wrapper import AbstractDimmedLens

_SOFTNESS = 0.05
"""Width of the disk's edge, a share of its radius, so that pictures change smoothly with it."""


class VignettedLens(AbstractDimmedLens):
    """A lens in a tube: rays also have to pass a disk on its axis.

    From a film point off the axis, disk and opening look shifted against each other. What both let through is
    a cat's eye, narrower towards the corners, where the picture darkens by the share that is lost. Lights
    behind the focus lose the side away from the middle when the disk is ahead of the lens.

    A ray passes the disk at (b + L (a - c)) / f, with L the disk's distance, c the principal point, and f in
    pixels; its weight falls from 1 to 0 across the disk's edge. Stopping down takes the cat's eyes away. The
    axis is the camera's, also of a tilted lens.

    Attributes:
        lens: the lens without it.
        disk_radius: metres.
        disk_distance: metres ahead of the lens, below 0 behind it; nearer than anything in the scene.
    """

    lens: AbstractLens
    disk_radius: Float[Array, ""]
    disk_distance: Float[Array, ""]

    def vignettes(self) -> bool:
        return True

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        ray = self.lens.ray(camera, film_point, pupil_point)
        passes = (ray.b + self.disk_distance * (ray.a - camera.principal_point)) / camera.focal_px
        # By squares, which have a slope in the middle, too: d^2 - R^2 is 2 R (d - R) at the edge.
        beyond = (passes @ passes / self.disk_radius**2 - 1.0) / (2.0 * _SOFTNESS)
        t = jnp.clip(0.5 - beyond, 0.0, 1.0)
        return dataclasses.replace(ray, weight=ray.weight * t * t * (3.0 - 2.0 * t))


def vignetted_lens(
    lens: AbstractLens, camera: Camera, *, corner_shift: SupportsFloat, disk: SupportsFloat = 1.1
) -> VignettedLens:
    """A `VignettedLens` by how its cat's eyes look, with checked values.

    Args:
        lens: as it is open now.
        camera: the pinhole that frames the picture.
        corner_shift: how far the disk is shifted in the corners, in radii of the opening; below 0 for a disk
            behind the lens. From disk - 1 on light is lost, from disk + 1 on all of it.
        disk: radius of the disk in radii of the opening; above 1.05 the middle of the picture loses nothing.

    Raises:
        ValueError: a shift that is not finite, a disk that is not positive, or a closed lens.
    """
    if not abs(real_number(corner_shift, "the corner shift", "aperture radii, such as 0.7")) < float("inf"):
        raise ValueError(f"the corner shift is {corner_shift}; expected aperture radii, such as 0.7")
    if not 0.0 < real_number(disk, "the disk's radius", "aperture radii, such as 1.1") < float("inf"):
        raise ValueError(f"the disk's radius is {disk}; expected aperture radii, such as 1.1")
    radius = lens.parallax(camera) / camera.focal_px
    if not float(radius) > 0:
        raise ValueError("a closed lens has no cat's eyes; open it, and stop it down afterwards")
    corner = jnp.hypot(0.5 * camera.width, 0.5 * camera.height) / camera.focal_px
    return VignettedLens(lens, float(disk) * radius, float(corner_shift) * radius / corner)


def hooded_lens(lens: AbstractLens, *, radius: SupportsFloat, distance: SupportsFloat) -> VignettedLens:
    """A lens behind the round mouth of a hood or another tube: mechanical vignetting (Kyaw 2013 section 4.4).

    Args:
        lens: the lens without it.
        radius: of the mouth in metres.
        distance: metres from the middle of the entrance pupil to the mouth.

    Raises:
        ValueError: a radius or a distance that is not positive.
    """
    for name, value in (("radius", radius), ("distance", distance)):
        if not 0.0 < real_number(value, f"the hood's {name} in metres", "a positive length") < float("inf"):
            raise ValueError(f"the hood's {name} is {value} m; expected a positive length")
    return VignettedLens(
        lens, jnp.asarray(float(radius), dtype=float), jnp.asarray(float(distance), dtype=float)
    )


_PLACES = 13
_START = (1.2, 1.3, 0.8, 0.5, 4.0)
"""Radii of the disks ahead and behind and how far they are shifted in the corner, in radii of the opening;
and the power of the cosine."""
_LEAST, _MOST = (1.0, 1.0, 0.0, 0.0, 0.0), (10.0, 10.0, 10.0, 10.0, 8.0)


def vignetted_like(lens: AbstractLens, real: AbstractLens, camera: Camera) -> DarkenedLens:
    """`lens` behind one disk and before another, that together darken its corners as `real` does.

    Kyaw (2013, section 4.4) takes the rims of the first and the last element for the disks. Pupils of real
    lenses move and grow with the angle, so that rims seen by first-order optics are 10 % off; here radii and
    places of the disks, and the power of the cosine that natural vignetting follows, are fitted to the light
    through `real` along the picture's diagonal, relative to the axis. So a lens without glass gets the
    vignetting of one that has it, at a fraction of the cost. They are its own at this opening.

    Args:
        lens: an ideal lens, as far open as `real`.
        real: a lens that knows its vignetting, such as a `PrescriptionLens`.
        camera: the camera both stand in.

    Raises:
        ValueError: a closed lens.
    """
    opening = float(lens.parallax(camera)) / float(camera.focal_px)
    if not opening > 0:
        raise ValueError("a closed lens has no vignetting; open it")
    middle = np.asarray(camera.principal_point, dtype=float)
    from scipy.optimize import least_squares

    size = np.array([camera.width, camera.height])
    corner = np.where(middle > size / 2, 0.0, size)
    along = np.linspace(0.0, 1.0, _PLACES)[:, None]
    places = jnp.asarray(middle + along * (corner - middle), dtype=float)
    wanted = np.asarray(illumination(real, camera, places))
    wanted = wanted / wanted[0]
    steepest = float(np.hypot(*(corner - middle)) / camera.focal_px)

    def model(values: np.ndarray) -> DarkenedLens:
        ahead, behind, shift_ahead, shift_behind, power = (jnp.asarray(float(v), dtype=float) for v in values)

        def disk(inner: AbstractLens, radius: Array, shift: Array) -> VignettedLens:
            return VignettedLens(inner, radius * opening, shift * (opening / steepest))

        return DarkenedLens(disk(disk(lens, behind, -shift_behind), ahead, shift_ahead), CosineFalloff(power))

    def left(values: np.ndarray) -> np.ndarray:
        found = np.asarray(illumination(model(values), camera, places))
        return (found / found[0] - wanted) / np.maximum(wanted, 0.05)

    # Finite differences: more than single precision has digits for, which stops the fit early at worst.
    found = least_squares(left, _START, bounds=(_LEAST, _MOST), diff_step=1e-3, xtol=1e-6, ftol=1e-8)
    return model(found.x)
