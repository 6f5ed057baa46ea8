"""The pinhole that frames a picture: where it stands, where it looks, what it projects to.

World and lens lengths are metres. The camera looks along its own -z axis with +y up; pixels
count x to the right and y downwards from the frame's top-left corner, so that pixel (i, j) has
its centre at (i + 0.5, j + 0.5). Depth z is the distance along the view axis (never along the
ray) and disparity w = 1/z, in dioptres, is the working depth: infinity is w = 0.
"""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._device import device_array

FULL_FRAME_WIDTH = 0.036
"""Width in metres of the 36 mm x 24 mm sensor, used where only a field of view is given."""


class Camera(eqx.Module):
    """A pinhole camera; the lens that replaces the pinhole is a separate object.

    Attributes:
        world_from_camera: rigid transform [4, 4]; its last column is the lens centre in metres.
        focal_length: distance in metres from the lens centre to the sensor.
        sensor_width: width in metres of the sensor that the frame's `width` pixels cover.
        principal_point: where the view axis meets the picture, in pixels [2] (x right, y down).
        width: pixels per row (static).
        height: rows (static).

    Example:
        >>> camera = look_at((0, 0, 5), (0, 0, 0), width=640, height=480, field_of_view=0.7)
        >>> xy, disparity = camera.project(jnp.zeros(3))
        >>> [round(float(v), 3) for v in (*xy, disparity)]
        [320.0, 240.0, 0.2]
    """

    world_from_camera: Float[Array, "4 4"]
    focal_length: Float[Array, ""]
    sensor_width: Float[Array, ""]
    principal_point: Float[Array, "2"]
    width: int = eqx.field(static=True)
    height: int = eqx.field(static=True)

    @property
    def focal_px(self) -> Float[Array, ""]:
        """Focal length in pixels, the `f` of every projection formula."""
        return self.focal_length / self.sensor_width * self.width

    @property
    def shift(self) -> Float[Array, ""]:
        """Metres that the lens is slid to the right over the sensor; 0 with the axis in mid-frame."""
        return (self.width / 2 - self.principal_point[0]) * self.sensor_width / self.width

    @property
    def rise(self) -> Float[Array, ""]:
        """Metres that the lens is slid up over the sensor."""
        return (self.principal_point[1] - self.height / 2) * self.sensor_width / self.width

    @property
    def position(self) -> Float[Array, "3"]:
        """The lens centre in world metres."""
        return self.world_from_camera[:3, 3]

    def camera_from_world(self, point: Float[Array, "3"]) -> Float[Array, "3"]:
        """The world `point` (metres) in camera axes; points ahead have negative z."""
        return self.world_from_camera[:3, :3].T @ (point - self.position)

    def project(self, point: Float[Array, "3"]) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        """Image position in pixels and disparity in 1/m of a world `point` in metres.

        A point behind the camera has negative disparity; one in the lens plane has none, and
        gives infinities.
        """
        x, y, z = self.camera_from_world(point)
        disparity = -1.0 / z
        offset = self.focal_px * disparity * jnp.stack([x, -y])
        return self.principal_point + offset, disparity

    def unproject(self, xy: Float[Array, "2"], disparity: Float[Array, ""]) -> Float[Array, "3"]:
        """The world point in metres seen at pixel position `xy` with positive `disparity` (1/m)."""
        return self.position + self.direction(xy) / disparity

    def direction(self, xy: Float[Array, "2"]) -> Float[Array, "3"]:
        """World direction through pixel position `xy`, scaled to advance 1 m along the view axis."""
        x, y = (xy - self.principal_point) / self.focal_px
        return self.world_from_camera[:3, :3] @ jnp.stack([x, -y, -jnp.ones_like(x)])


def _real(value: Any) -> Array:
    """`value` as a device array of the default real type."""
    return device_array(value, dtype=float)


def make_camera(
    world_from_camera: ArrayLike | Sequence[Sequence[float]],
    *,
    width: int,
    height: int,
    focal_length: float | None = None,
    field_of_view: float | None = None,
    sensor_width: float = FULL_FRAME_WIDTH,
    shift: float = 0.0,
    rise: float = 0.0,
) -> Camera:
    """A camera with its view axis through the middle of the frame, or shifted from there.

    Shift and rise slide the lens over the sensor. That moves the frame over the scene and leaves the
    perspective as it is: uprights that are parallel in the picture stay so, as no turn of the camera would.

    Args:
        world_from_camera: rigid transform [4, 4] (rotation and metres).
        width: pixels per row.
        height: rows.
        focal_length: metres; give this or `field_of_view`, not both.
        field_of_view: horizontal angle in radians, below pi.
        sensor_width: metres.
        shift: metres that the lens slides to the right over the sensor; the frame sees more of what is there.
        rise: metres that the lens slides up; the frame sees more of what is above.

    Raises:
        ValueError: a size, length or angle out of range, or a transform that is not rigid.

    Example:
        >>> risen = make_camera(np.eye(4), width=36, height=24, focal_length=0.05, rise=0.004)
        >>> risen.principal_point.tolist()
        [18.0, 16.0]
    """
    # Checked on the host: every small operation on the device would be compiled by itself.
    pose = np.asarray(world_from_camera, dtype=np.float64)
    if pose.shape != (4, 4):
        raise ValueError(f"the camera matrix has shape {pose.shape}; expected 4 rows of 4 numbers")
    rotation = pose[:3, :3]
    if not np.all(np.isfinite(pose)):
        raise ValueError("the camera matrix has a value that is not finite; expected a pose in metres")
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
        raise ValueError("the camera matrix's 3 x 3 part is not a rotation; remove scale, shear or mirroring")
    for name, pixels in (("width", width), ("height", height)):
        if int(pixels) != pixels or pixels < 1:
            raise ValueError(f"{name} is {pixels} pixels; expected at least 1, and whole")
    if not 0 < sensor_width < math.inf:
        raise ValueError(f"sensor width is {sensor_width} m; expected a positive length")
    if (focal_length is None) == (field_of_view is None):
        raise ValueError("give exactly one of focal length and field of view")
    if field_of_view is not None:
        if not 0 < field_of_view < math.pi:
            raise ValueError(f"field of view is {field_of_view} rad; expected between 0 and pi")
        focal_length = sensor_width / 2 / math.tan(field_of_view / 2)
    elif focal_length is None or not 0 < focal_length < math.inf:
        raise ValueError(f"focal length is {focal_length} m; expected a positive length")
    for name, slide in (("shift", shift), ("rise", rise)):
        if not math.isfinite(slide):
            raise ValueError(f"{name} is {slide} m; expected a finite length")
    pixels_per_metre = width / sensor_width
    return Camera(
        world_from_camera=_real(pose),
        focal_length=_real(focal_length),
        sensor_width=_real(sensor_width),
        # What is seen straight ahead moves against the frame.
        principal_point=_real([width / 2 - shift * pixels_per_metre, height / 2 + rise * pixels_per_metre]),
        width=width,
        height=height,
    )


def look_at(
    position: ArrayLike | Sequence[float],
    target: ArrayLike | Sequence[float],
    up: ArrayLike | Sequence[float] = (0.0, 1.0, 0.0),
    *,
    width: int,
    height: int,
    focal_length: float | None = None,
    field_of_view: float | None = None,
    sensor_width: float = FULL_FRAME_WIDTH,
    shift: float = 0.0,
    rise: float = 0.0,
) -> Camera:
    """A camera at `position` whose view axis passes through `target` (both world metres).

    Lengths, angles, shift and rise are as in `make_camera`.

    Raises:
        ValueError: `target` is at `position`, or `up` is along the line between them.

    Example:
        >>> camera = fj.look_at((0, 0, 5), (0, 0, 0), width=8, height=6, focal_length=0.05)
        >>> xy, disparity = camera.project(jnp.array([0.0, 0.0, 0.0]))
        >>> xy.round(6).tolist(), round(float(disparity), 6)
        ([4.0, 3.0], 0.2)
    """
    eye, aim, upwards = (np.asarray(v, dtype=np.float64) for v in (position, target, up))
    backward = eye - aim
    distance = np.linalg.norm(backward)
    if not distance > 0:
        raise ValueError(f"the camera looks at its own position {position}; move one of the two")
    backward = backward / distance
    right = np.cross(upwards, backward)
    if not np.linalg.norm(right) > 1e-6 * np.linalg.norm(upwards):
        raise ValueError(f"up {up} is along the view axis; choose another up direction")
    right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(backward, right), backward], axis=1)
    pose[:3, 3] = eye
    return make_camera(
        pose,
        width=width,
        height=height,
        focal_length=focal_length,
        field_of_view=field_of_view,
        sensor_width=sensor_width,
        shift=shift,
        rise=rise,
    )
