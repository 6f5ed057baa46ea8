"""How a body moves while a shutter is open: from the axes in which it stands still to those of lens rays.

A lens ray is a straight line in the axes of the camera at its time. What moves as a rigid body (or as any
affine map, zooming cameras included) stands still in axes of its own, and there the ray is a straight line
again.

With P(z) = (X0 + m z, -z) the ray in the camera's axes at depth z, and M the map from there to the axes of
the key camera, of which o = M P(0) and d is the image of (m, -1), depth there is z' = z0 + g z with z0 =
-o_z and g = -d_z, and the ray crosses the plane z' = 0 at o - d z0 / g with slopes d / g: by these it is
q'(w') = a' + b' w' (see `focusjax.geometry.LensRay`), exactly. What it meets at disparity w' there is at

    w = g w' / (1 - z0 w')

at the ray's own time.

The other way, a place of slopes (x, y) at disparity w' of the key camera is the point (x, -y, -1) / w'. With
M = (R, t), it is k / w' in the axes of lens rays, of which k = R^-1 ((x, -y, -1) - t w'): the place
(k_x, -k_y) / -k_z at the disparity w' / -k_z. Nothing is divided by w', which may be 0.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.trace._timed import interpolated


class BodyMotion(eqx.Module):
    """Where a body is at the times of a span.

    Attributes:
        camera: in whose axes the lens makes its rays.
        key: the camera that the body's layers are seen from.
        matrices: maps [m, 3, 4] from the axes of the one to those of the other, in which the body stands
            still, at times evenly spaced from the first to the last of the span; straight between.
        begin: the first of these times.
        end: the last one.
    """

    camera: Camera
    key: Camera
    matrices: Float[Array, "m 3 4"]
    begin: Float[Array, ""]
    end: Float[Array, ""]

    def at(self, time: Float[Array, " n"]) -> Float[Array, "n 3 4"]:
        """The maps at some times."""
        length = jnp.where(self.end > self.begin, self.end - self.begin, 1.0)
        return interpolated(self.matrices, (time - self.begin) / length)

    def place(
        self, seen: Float[Array, "2"], disparity: Float[Array, ""], matrix: Float[Array, "3 4"]
    ) -> tuple[Float[Array, "2"], Float[Array, ""], Float[Array, ""]]:
        """Where a place of the key camera's picture is in that of lens rays; see the head of this file.

        It is `seen` in output pixels of the key camera at a disparity in 1/m; `matrix` is as of `at`.

        Returns:
            The place in output pixels, its disparity, and -k_z, which is positive if it lies ahead.
        """
        x, y = (seen - self.key.principal_point) / self.key.focal_px
        right = jnp.stack([x, -y, -jnp.ones_like(x)]) - matrix[:, 3] * disparity
        by_row = jnp.stack(
            [
                jnp.cross(matrix[:, 1], matrix[:, 2]),
                jnp.cross(matrix[:, 2], matrix[:, 0]),
                jnp.cross(matrix[:, 0], matrix[:, 1]),
            ]
        )
        point = by_row @ right / (by_row[0] @ matrix[:, 0])
        ahead = -point[2]
        safe = jnp.where(ahead > 0, ahead, 1.0)
        there = self.camera.principal_point + self.camera.focal_px * jnp.stack([point[0], -point[1]]) / safe
        return there, disparity / safe, ahead


def moved_ray(
    ray: LensRay, camera: Camera, key: Camera, matrix: Float[Array, "3 4"]
) -> tuple[LensRay, Float[Array, ""], Float[Array, ""]]:
    """A ray of `camera` in the axes in which a body stands still, z0 and g; see the head of this file.

    `matrix` goes from the axes of `camera` to those of `key`, the camera of the layers.
    """
    slope, crossing = (ray.a - camera.principal_point) / camera.focal_px, ray.b / camera.focal_px
    turned = matrix[:, :3]
    origin = turned[:, 0] * crossing[0] - turned[:, 1] * crossing[1] + matrix[:, 3]
    direction = turned[:, 0] * slope[0] - turned[:, 1] * slope[1] - turned[:, 2]
    depth, along = -origin[2], -direction[2]
    safe = jnp.where(along > 0, along, 1.0)
    x, y = direction[0] / safe, direction[1] / safe
    a = key.principal_point + key.focal_px * jnp.stack([x, -y])
    b = key.focal_px * jnp.stack([origin[0] - x * depth, y * depth - origin[1]])
    return LensRay(a, b, ray.weight), depth, along
