"""Small scenes that are hard to picture, and what a camera and a lens make of them.

All are looked at along -z from the origin by a frame of 16x12 pixels with 20 pixels of focal length, unless a
case has another frame. Most layers are made of one extent, so that the same compiled programs serve them.
"""

import dataclasses
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from focusjax.geometry import Camera, look_at
from focusjax.layers import Extent, Grid, Layers, peel
from focusjax.lens import TiltShiftLens
from focusjax.scene import Scene, SceneObject, constant_background, make_object, make_scene

WIDTH, HEIGHT, FOCAL_PX = 16, 12, 20.0
PARALLAX = 11.0
"""Pixels that the rim of the widest common opening moves a ray for every dioptre: a radius of 0.55 m."""
_EXTENT = Extent(Grid(WIDTH, HEIGHT, supersampling=1, margin=32), count=4, room=8192)
_SQUARE = np.array([(0, 1, 2), (0, 2, 3)])
_BACKGROUND = 0.2


@dataclasses.dataclass(frozen=True)
class Stage:
    """A scene and the camera that looks at it.

    Attributes:
        objects: makes what is in it.
        size: width and height of the frame in pixels.
        place: where the camera stands, in metres; the scene is moved with it.
        background: radiance where nothing is.
        max_layers: of the layers.
        solid: whether nothing may be seen through, so that casting rays at its triangles gives the truth.
        common: whether its layers have room for those of other stages; they are larger where they need to be.
            Not where the wider margin, by which positions are rounded, is as much as what is looked at.
    """

    objects: Callable[[], Sequence[SceneObject]]
    size: tuple[int, int] = (WIDTH, HEIGHT)
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    background: float = _BACKGROUND
    max_layers: int = 8
    solid: bool = True
    common: bool = True

    def camera(self) -> Camera:
        """Along -z, with 20 pixels of focal length."""
        width, height = self.size
        x, y, z = self.place
        field = 2.0 * float(np.arctan(width / 2.0 / FOCAL_PX))
        return look_at(self.place, (x, y, z - 1.0), width=width, height=height, field_of_view=field)

    def scene(self) -> Scene:
        """What is in front of it, unlit."""
        moved = [
            dataclasses.replace(each, vertices=each.vertices + np.asarray(self.place))
            for each in self.objects()
        ]
        return make_scene(moved, background=constant_background(self.background), unlit=True)


def layers_of(stage: Stage, settings: Sequence[float]) -> Layers:
    """Peeled for the lens that `settings` are of and for the same lens a little changed."""
    focus, radius, tilt = settings
    camera = stage.camera()
    lens = lens_of(jnp.array((focus, 1.05 * radius + 1e-6, tilt)), camera)
    like = _EXTENT if stage.common else None
    return peel(stage.scene(), camera, lens, max_layers=stage.max_layers, like=like)


def lens_of(settings: object, camera: Camera) -> TiltShiftLens:
    """From focus on the axis in 1/m, pixels that the rim moves a ray per dioptre, and 1/m of tilt.

    The plane in focus is at `focus` + `tilt` y, for tangents y of views upwards.
    """
    values = jnp.asarray(settings)
    plane = jnp.stack([jnp.zeros_like(values[0]), values[2], values[0]])
    return TiltShiftLens(plane, values[1] / camera.focal_px)


def patch(
    name: str,
    box: Sequence[float],
    disparity: float | Sequence[float],
    radiance: object,
    *,
    opacity: float = 1.0,
    faces: np.ndarray = _SQUARE,
) -> SceneObject:
    """A rectangle by where it appears: left, top, right, bottom in pixels of the common frame, and 1/m."""
    left, top, right, bottom = box
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    places = at_pixels(corners, np.broadcast_to(disparity, 4))
    return make_object(name, places, faces, colour=(0, 0, 0), emission=radiance, opacity=opacity)


def at_pixels(xy: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """World points [n, 3] that appear at pixel positions `xy` [n, 2] of the common frame."""
    x, y = ((np.asarray(xy) - [WIDTH / 2, HEIGHT / 2]) / FOCAL_PX).T
    return np.stack([x, -y, -np.ones_like(x)], axis=1) / np.asarray(disparity)[:, None]


def mixed() -> list[SceneObject]:
    """Bars a pixel wide, two surfaces that touch, one a hair before them, and two small lamps."""
    boxes = {
        "bar": ((5.27, -60, 6.27, 80), 1.0, 0.6),
        "level bar": ((-60, 7.13, 80, 8.13), 0.9, 0.8),
        "left": ((-60, -60, 9.37, 80), 0.3, 0.9),
        "right": ((9.37, -60, 80, 80), 0.3, 0.1),
        "hair": ((8.19, 2.21, 12.43, 5.77), 0.3 + 1e-6, 0.5),
        "near lamp": ((12.31, 8.57, 13.31, 9.57), 1.0, 5.0),
        "far lamp": ((2.11, 2.39, 3.11, 3.39), 0.31, 5.0),
    }
    return [patch(name, *values) for name, values in boxes.items()]


def lamps() -> list[SceneObject]:
    """Radiances of 1e-8 to 1e8, side by side before a wall, near and far."""
    wall = patch("wall", (-60, -60, 80, 80), 0.3, 1e-8)
    steps = range(5)
    return [
        wall,
        *(
            patch(
                f"lamp {k}", (3 * k + 0.31, 3.1 + k, 3 * k + 1.6, 4.7 + k), 0.4 + 0.1 * k, 10.0 ** (4 * k - 8)
            )
            for k in steps
        ),
    ]


def in_focus() -> list[SceneObject]:
    """Two surfaces side by side at 2 m, which fill every view."""
    return [patch("left", (-60, -60, 7.37, 80), 0.5, 0.9), patch("right", (7.37, -60, 80, 80), 0.5, 0.1)]


def before_a_wall() -> list[SceneObject]:
    """A square at 2 m before a wall at 5 m."""
    return [patch("square", (4.3, 3.4, 10.6, 8.7), 0.5, 0.9), patch("wall", (-60, -60, 80, 80), 0.2, 0.3)]


def coincident() -> list[SceneObject]:
    """One square three times, once turned over, before a wall that is there twice."""
    square, wall = before_a_wall()
    turned = patch("turned", (4.3, 3.4, 10.6, 8.7), 0.5, 0.9, faces=_SQUARE[:, ::-1])
    again = [dataclasses.replace(each, name=f"{each.name} again") for each in (square, wall)]
    return [square, *again, turned, wall]


def inverted() -> list[SceneObject]:
    """Faces that all look away, as of a mesh with mirrored axes."""
    return [dataclasses.replace(each, faces=each.faces[:, ::-1].copy()) for each in before_a_wall()]


def needles() -> list[SceneObject]:
    """Forty triangles across the picture, each a fiftieth of a pixel thin."""
    numbers = np.arange(40)
    top, bottom = 0.2 + 0.4 * numbers, 15.8 - 0.4 * numbers
    corners = np.stack(
        [
            np.stack([top, np.full(40, -4.0)], axis=1),
            np.stack([top + 0.02, np.full(40, -4.0)], axis=1),
            np.stack([bottom, np.full(40, 16.0)], axis=1),
        ],
        axis=1,
    ).reshape(-1, 2)
    places = at_pixels(corners, np.full(120, 0.8))
    faces = np.arange(120).reshape(-1, 3)
    many = make_object("needles", places, faces, colour=(0, 0, 0), emission=4.0)
    return [many, patch("wall", (-60, -60, 80, 80), 0.2, 0.3)]


def subpixel() -> list[SceneObject]:
    """Squares of a third of a pixel, every other one missing, before a wall."""
    columns, rows = np.meshgrid(np.arange(36), np.arange(24))
    held = (columns + rows) % 2 == 0
    corner = np.stack([columns[held], rows[held]], axis=1) / 3.0 + 2.1
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) / 3.0
    corners = (corner[:, None] + square).reshape(-1, 2)
    faces = (4 * np.arange(len(corner))[:, None, None] + _SQUARE).reshape(-1, 3)
    places = at_pixels(corners, np.full(len(corners), 0.8))
    board = make_object("board", places, faces, colour=(0, 0, 0), emission=1.0)
    return [board, patch("wall", (-60, -60, 80, 80), 0.2, 0.3)]


def frame_filling() -> list[SceneObject]:
    """One triangle whose corners are thousands of pixels away, before another."""
    corners = np.array([(-9000.0, -8000.0), (9000.0, -8000.0), (7.0, 9.0)])
    near = at_pixels(corners, np.array([0.5, 0.5, 0.5]))
    far = at_pixels(corners[:, ::-1] * np.array([2.0, -2.0]) + 12.0, np.array([0.1, 0.3, 0.2]))
    one = np.array([(0, 1, 2)])
    return [
        make_object("near", near, one, colour=(0, 0, 0), emission=0.8),
        make_object("far", far, one, colour=(0, 0, 0), emission=0.4),
    ]


def edge_on() -> list[SceneObject]:
    """A sheet that the lens centre sees edge on, and only the rest of the lens sees, before a wall."""
    points = np.array([(-0.3, 0.0, -1.2), (0.3, 0.0, -1.2), (0.3, 0.0, -4.0), (-0.3, 0.0, -4.0)])
    sheet = make_object("sheet", points, _SQUARE, colour=(0, 0, 0), emission=0.9)
    return [sheet, patch("wall", (-60, -60, 80, 80), 0.2, 0.3)]


def nothing() -> list[SceneObject]:
    """All that there is lies behind the camera."""
    points = np.array([(-1.0, -1.0, 2.0), (1.0, -1.0, 2.0), (1.0, 1.0, 2.0), (-1.0, 1.0, 2.0)])
    return [make_object("behind", points, _SQUARE, colour=(0, 0, 0), emission=0.9)]


def floor() -> list[SceneObject]:
    """A floor that goes from 5 m behind the camera through the lens plane to 20 m before it."""
    points = np.array([(-3.0, -0.4, 5.0), (3.0, -0.4, 5.0), (3.0, -0.4, -20.0), (-3.0, -0.4, -20.0)])
    return [make_object("floor", points, _SQUARE, colour=(0, 0, 0), emission=0.9)]


def touching() -> list[SceneObject]:
    """A wall along the view that begins in the lens plane, at the rim of an opening of 0.1 m radius."""
    points = np.array([(-0.1, -2.0, 0.0), (-0.1, -2.0, -5.0), (-0.1, 2.0, -5.0), (-0.1, 2.0, 0.0)])
    return [make_object("wall", points, _SQUARE, colour=(0, 0, 0), emission=0.9)]


def close() -> list[SceneObject]:
    """Something 5 cm away, which a lens focused at 2 m blurs over hundreds of pixels, before a wall."""
    return [patch("close", (-60, -60, 8.0, 80), 20.0, 1.0), patch("wall", (-600, -600, 600, 600), 0.5, 0.1)]


PANES, STOPPED = 119, 0.03
"""How many panes there are, and what share of the light each stops."""


def panes() -> list[SceneObject]:
    """Panes that fill every view, each glowing and stopping a few of the rays."""
    depths = np.linspace(0.9, 0.2, PANES)
    return [
        patch(f"pane {k}", (-60, -60, 80, 80), w, pane_light(k), opacity=STOPPED)
        for k, w in enumerate(depths)
    ]


def pane_light(number: int) -> float:
    """Radiance of a pane, of which 0 is the nearest."""
    return 0.5 + 0.5 * float(np.cos(number / 9.0))
