"""Small scenes, described by where things appear in the picture, for the tests of layers and tracer."""

from collections.abc import Sequence
from functools import cache

import jax.numpy as jnp
import numpy as np
import trimesh

from focusjax.geometry import Camera, look_at
from focusjax.layers import Layers, peel
from focusjax.lens import ThinLens
from focusjax.scene import Scene, SceneObject, constant_background, make_object, make_scene

WIDTH, HEIGHT = 32, 24
SQUARE = np.array([(0, 1, 2), (0, 2, 3)])


def front_camera(width: int = WIDTH, height: int = HEIGHT) -> Camera:
    """At the origin, looking along -z, with 40 pixels of focal length for a width of 32."""
    field = 2 * float(np.arctan(WIDTH / 80.0))
    return look_at((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), width=width, height=height, field_of_view=field)


def at_pixels(xy: np.ndarray, disparity: np.ndarray, camera: Camera) -> np.ndarray:
    """World points [n, 3] that the front camera sees at pixel positions `xy` [n, 2], at `disparity` [n]."""
    x, y = ((np.asarray(xy) - [camera.width / 2, camera.height / 2]) / float(camera.focal_px)).T
    return np.stack([x, -y, -np.ones_like(x)], axis=1) / np.asarray(disparity)[:, None]


def patch(
    name: str,
    camera: Camera,
    box: Sequence[float],
    disparity: float | Sequence[float],
    radiance: object = 1.0,
) -> SceneObject:
    """A rectangle on screen, `box` = left, top, right, bottom in pixels, flat in the world.

    `disparity` is one number, or those of the corners clockwise from the top left (of a parallelogram in
    (x, y, w): the sums of opposite corners are equal).
    """
    left, top, right, bottom = box
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    points = at_pixels(corners, np.broadcast_to(disparity, 4), camera)
    return make_object(name, points, SQUARE, colour=(0, 0, 0), emission=radiance)


def ball(name: str, place: Sequence[float], radius: float, seed: int) -> SceneObject:
    """A ball whose colour changes from vertex to vertex."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    waves = np.sin(mesh.vertices / radius * np.array([3.0, 4.0, 5.0]) + seed)
    return make_object(name, mesh.vertices, mesh.faces, vertex_colours=0.6 + 0.3 * waves, translate=place)


def wide_lens(camera: Camera, *, pixels_per_dioptre: float = 12.0, focus: float = 0.5) -> ThinLens:
    """A thin lens given by how far its rim moves a ray per dioptre."""
    return ThinLens(jnp.array(focus), jnp.array(pixels_per_dioptre / float(camera.focal_px)))


def varied_objects() -> list[SceneObject]:
    """A ball in focus, one on the border, a bar close to the lens, a steep floor, a wall."""
    camera = front_camera()
    floor = patch("floor", camera, (-8, 14, 40, 30), (0.15, 0.15, 1.2, 1.2), (0.3, 0.5, 0.2))
    bar = patch("bar", camera, (8.3, -20, 10.6, 60), 1.0, (0.9, 0.4, 0.1))
    wall = patch("wall", camera, (12.2, -30, 60, 60), 0.12, (0.2, 0.2, 0.6))
    balls = [ball("ball", (0.25, 0.1, -2.0), 0.35, 0), ball("border", (-0.75, 0.25, -1.6), 0.3, 1)]
    return [floor, bar, wall, *balls]


@cache
def varied_scene() -> Scene:
    """`varied_objects` before a bright sky, unlit."""
    return make_scene(varied_objects(), background=constant_background(1.0), unlit=True)


@cache
def varied_layers() -> Layers:
    """`varied_scene` peeled for `wide_lens(front_camera())`, two samples to a pixel and axis."""
    camera = front_camera()
    return peel(varied_scene(), camera, wide_lens(camera), supersampling=2)
