"""Cat's eyes: a second disk that rays have to pass, ahead of the lens or behind it."""

import dataclasses
from typing import SupportsFloat

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._arguments import real_number
from focusjax.geometry import Camera, LensRay
from focusjax.lens._base import AbstractLens
from focusjax.lens._dimmed import AbstractDimmedLens

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
