"""Tilting the camera's back instead of its lens: the same plane in focus, another perspective.

With the lens level, its axis along Z, the image of a plane m.P = 1 is the plane

    k.P' = 1,        k = m - e_z / F,

which is where the sensor has to be. Seen from the sensor, whose normal is N = -k / |k|, that is a camera
that looks along N with the lens tilted the other way: a `TiltShiftLens` in a turned `Camera`. The lens's
axis stays on the pixel where it was, so the principal point moves off it: a turned back alone slides the
picture, and makes parallels converge, as a turned camera does.
"""

import dataclasses

import jax.numpy as jnp

from focusjax.geometry import Camera
from focusjax.lens._scheimpflug import turn_to
from focusjax.lens._tilt_shift import TiltShiftLens


def tilt_back(camera: Camera, lens: TiltShiftLens) -> tuple[Camera, TiltShiftLens]:
    """Focus on the plane that `lens` is focused on by turning the sensor, with the lens itself left level.

    The lens's axis is the view axis of `camera`. The answer is given as everywhere, in axes along the
    sensor's normal: `movements` of the new lens in the new camera are the lens's towards the back, so the
    back's own tilt and swing are the negatives of those. The perpendicular distance to the sensor is the
    focal length as before, since pictures do not breathe. Differentiable.

    Args:
        camera: as it would be with the back upright.
        lens: whose plane is to be in focus; it meets the view axis beyond the focal length, or not at all.

    Returns:
        The camera that looks along the sensor's normal, and the lens in its axes.

    Example:
        >>> from focusjax import look_at, tilt_shift_lens
        >>> camera = look_at((0, 1, 0), (0, 1, -1), width=60, height=40, focal_length=0.09)
        >>> lens = tilt_shift_lens(focus_distance=2.0, tilt=0.1, f_number=8, focal_length=0.09)
        >>> turned, same = tilt_back(camera, lens)
        >>> round(float(-same.movements(turned).tilt), 4)
        -0.1042
    """
    plane = lens.plane
    normal = jnp.stack([-plane[0], -plane[1], 1.0 / camera.focal_length - plane[2]])
    axis = normal / jnp.sqrt(normal @ normal)
    x, y, z = axis
    turn = turn_to(axis)
    # Camera axes have z backwards.
    mirror = jnp.array([1.0, 1.0, -1.0], dtype=plane.dtype)
    pose = camera.world_from_camera
    rotation = pose[:3, :3] @ (mirror[:, None] * turn * mirror[None])
    slide = camera.focal_px * jnp.stack([x, -y]) / z
    turned = dataclasses.replace(
        camera,
        world_from_camera=pose.at[:3, :3].set(rotation),
        principal_point=camera.principal_point + slide,
    )
    return turned, dataclasses.replace(lens, plane=turn.T @ plane)
