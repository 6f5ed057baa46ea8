"""Scenes that are hard for depth of field: those of the papers' figures, made small and by rule.

Things are placed by where they appear: pixels of the picture, and disparity in 1/m. Lenses are given by the
blur diameters they are to make.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from _shapes import QUAD, in_world, quad_faces, shining

from focusjax.geometry import Camera, look_at
from focusjax.lens import AbstractAperture, ThinLens, polygon, thin_lens
from focusjax.scene import (
    Scene,
    SceneObject,
    constant_background,
    gradient_background,
    load_mesh,
    make_object,
    make_scene,
)

LAMPS = (
    ((50, 45), (30, 24, 16)),
    ((120, 50), (20, 26, 34)),
    ((190, 45), (36, 16, 9)),
    ((50, 130), (12, 32, 16)),
    ((190, 130), (90, 90, 80)),
)
"""Pixel and radiance of each highlight."""
LAMP_SIZE, LAMP_DISPARITY = 6.0, 0.25
SHARP_LAMP = ((120, 130), 12, (0.8, 0.8, 0.7))
"""Pixel, size and radiance of what is in focus."""
WALL = (0.02, 0.025, 0.04)
"""Radiance behind the highlights."""
BLADES, TURN = 6, 0.26
_MESHES = Path(__file__).parent.parent / "configs" / "meshes"
_SQUARES, _TEXELS = 44, 32
"""Squares of a chequered wall along each side, and texels along a square."""


@dataclasses.dataclass(frozen=True, eq=False)
class SpecialCase:
    """A picture to make.

    Attributes:
        name: for files and tables.
        what: what there is to see.
        scene: unlit.
        camera: frame and pose.
        lens: how it is seen.
        max_layers: most layers that are worth peeling.
    """

    name: str
    what: str
    scene: Scene
    camera: Camera
    lens: ThinLens
    max_layers: int = 16


def view(width: int, height: int) -> Camera:
    """At the origin, looking along -z, as wide as a 40 mm lens on full frame."""
    return look_at((0, 0, 0), (0, 0, -1), width=width, height=height, focal_length=0.04)


def lens_with(
    camera: Camera, focus: float, disparity: float, blur: float, aperture: AbstractAperture | None = None
) -> ThinLens:
    """Focused at `focus` (1/m), with a blur diameter of `blur` pixels at `disparity`."""
    radius = abs(blur / (2 * float(camera.focal_px) * (focus - disparity)))
    return thin_lens(focus_distance=1 / focus, aperture_radius=radius, aperture=aperture)


def branch(name: str, camera: Camera, path: np.ndarray, disparity: float, width: float) -> SceneObject:
    """A bent round branch `width` pixels thick along pixels `path` [n, 2], with stripes of bark."""
    centre = in_world(path, disparity, camera)
    along = np.gradient(centre, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, (0.0, 0.0, 1.0))
    radius = width / 2 / float(camera.focal_px) / disparity
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    around = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * np.array(
        [0, 0, 1.0]
    )
    vertices = centre[:, None] + radius * around
    rows, columns = np.mgrid[: len(path) - 1, : len(angle)]
    corner = rows * len(angle) + columns
    right = rows * len(angle) + (columns + 1) % len(angle)
    faces = np.stack([corner, right, right + 16, corner, right + 16, corner + 16], axis=-1).reshape(-1, 3)
    bark = 0.5 + 0.3 * np.sin(3 * angle)[None] + 0.2 * np.sin(1.7 * np.arange(len(path)))[:, None]
    colours = bark.reshape(-1, 1) * np.array([0.10, 0.055, 0.03])
    return make_object(name, vertices.reshape(-1, 3), faces, vertex_colours=colours)


def crossing_branches() -> SpecialCase:
    """Lee09 Fig. 8, second row: a branch before the focus and one behind it, both blurred over 32 pixels."""
    camera = view(240, 180)
    y = np.linspace(-60, 240, 61)
    lean = (y - 90) * np.tan(np.radians(9)) + 3 * np.sin(y / 25)
    near = branch("near branch", camera, np.stack([120 + lean, y], axis=1), 1.2, 6.0)
    far = branch("far branch", camera, np.stack([120 - lean, y], axis=1), 0.8, 6.0)
    sky = gradient_background((0.3, 0.35, 0.3), (0.55, 0.65, 0.75), (0.75, 0.85, 1.0))
    scene = make_scene([near, far], background=sky, unlit=True)
    what = "focus between two crossing branches 6 px thin, each blurred over 32 px: they look separated"
    return SpecialCase("branches", what, scene, camera, lens_with(camera, 1.0, 1.2, 32.0))


def leaves(name: str, count: int, layers: int) -> SpecialCase:
    """Leaves in a cloud that is densest in the middle, where a line of sight meets about `layers` of them."""
    camera, random = view(240, 180), np.random.default_rng(3)
    middle = np.array([120, 90]) + random.normal(size=(count, 2)) * (52, 40)
    disparity = random.uniform(0.25, 1.0, count)
    # So large that the densest place has so many, one behind the other.
    size = np.sqrt(layers * 2 * np.pi * 52 * 40 / count)
    turn = random.uniform(0, 2 * np.pi, (count, 1)) + np.array([0.0, 0.5, 1.0, 1.5]) * np.pi
    long = np.array([0.9, 0.42, 0.9, 0.42]) * 1.15 * size
    corners = middle[:, None] + long[None, :, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    # Leaves lean: their corners lie at slightly different depths.
    depth = np.repeat(disparity, 4).reshape(-1, 4) * (1 + 0.02 * np.array([1.0, -1.0, -1.0, 1.0]))
    vertices = in_world(corners.reshape(-1, 2), depth.reshape(-1), camera)
    tone = random.uniform(0.3, 1.0, (count, 1)) * np.where(random.random((count, 1)) < 0.15, 1.5, 1.0)
    hue = np.array([0.25, 0.5, 0.08]) + random.normal(size=(count, 3)) * (0.12, 0.08, 0.03)
    colours = np.repeat(np.clip(tone * hue, 0.01, 1.0), 4, axis=0)
    cloud = make_object("leaves", vertices, quad_faces(count), vertex_colours=colours)
    sky = gradient_background((0.5, 0.55, 0.5), (0.6, 0.7, 0.75), (0.8, 0.9, 1.0))
    scene = make_scene([cloud], background=sky, unlit=True)
    what = f"{count} leaves, about {layers} behind one another in the middle"
    return SpecialCase(name, what, scene, camera, lens_with(camera, 0.6, 1.0, 16.0), max_layers=32)


def highlights() -> SpecialCase:
    """Small lamps far brighter than white, out of focus, through six blades: hexagons of one brightness."""
    camera = view(240, 180)
    lamps = [
        lamp(f"lamp {k}", camera, place, LAMP_DISPARITY, LAMP_SIZE, colour)
        for k, (place, colour) in enumerate(LAMPS)
    ]
    wall = patch("wall", camera, (-99, -99, 400, 400), 0.2, WALL)
    place, size, colour = SHARP_LAMP
    sharp = lamp("in focus", camera, place, 1.0, size, colour)
    scene = make_scene([*lamps, wall, sharp], unlit=True)
    lens = lens_with(camera, 1.0, LAMP_DISPARITY, 44.0, polygon(BLADES, rotation=TURN))
    what = "lamps of 6 px, 30 to 90 times white, blurred over 44 px through six blades"
    return SpecialCase("highlights", what, scene, camera, lens)


def wide_blur() -> SpecialCase:
    """A ball close to the lens whose edge is blurred over 100 pixels, before a sharp chequered wall."""
    camera = view(320, 240)
    front = ball("ball", camera, (105, 120), 1.6, 45.0, (0.8, 0.25, 0.1))
    wall = chequers(camera, 0.5, 16)
    scene = make_scene([front, wall], background=constant_background((0.3, 0.4, 0.55)), unlit=True)
    what = "a ball before the lens blurred over 100 px, a chequered wall in focus"
    return SpecialCase("wide blur", what, scene, camera, lens_with(camera, 0.5, 1.6, 100.0))


def foreground_blur() -> SpecialCase:
    """Lee09 Fig. 8, first row: a strongly blurred fence lets things in focus show through."""
    camera, random = view(320, 240), np.random.default_rng(5)
    cows = [
        load_mesh(
            _MESHES / "spot.glb",
            name=f"spot {k}",
            rotate=(0, turn, 0),
            scale=0.28,
            translate=tuple(in_world(np.array([place]), 0.5, camera)[0]),
        )
        for k, (place, turn) in enumerate([((95, 140), 150), ((225, 130), 215)])
    ]
    wall = chequers(camera, 0.28, 20, seed=2)
    bars = [
        branch(
            f"bar {k}",
            camera,
            np.stack([x + 6 * np.sin(np.linspace(0, 4, 40) + k), np.linspace(-90, 330, 40)], axis=1),
            1.5,
            14.0,
        )
        for k, x in enumerate((40.0, 130.0, 205.0, 290.0))
    ]
    centres = random.uniform((-20, -20), (340, 260), (26, 2))
    petals = []
    for k, place in enumerate(centres):
        colour = np.array([0.75, 0.25, 0.3]) * random.uniform(0.5, 1.2)
        petals.append(
            ball(f"petal {k}", camera, place, random.uniform(1.3, 1.7), random.uniform(4, 9), colour)
        )
    scene = make_scene([*cows, wall, *bars, *petals], unlit=True)
    what = "bars and petals blurred over 44 px before two cows in focus"
    return SpecialCase("foreground blur", what, scene, camera, lens_with(camera, 0.5, 1.5, 44.0))


def patch(
    name: str, camera: Camera, box: tuple[float, float, float, float], disparity: float, colour: object
) -> SceneObject:
    """A flat rectangle, `box` = left, top, right, bottom in pixels."""
    left, top, right, bottom = box
    corners = np.array([(left, top), (right, top), (right, bottom), (left, bottom)])
    return shining(name, in_world(corners, disparity, camera), colour)


def lamp(name, camera: Camera, place, disparity: float, size: float, colour) -> SceneObject:
    """A square of light around a pixel."""
    x, y = place
    return patch(name, camera, (x - size / 2, y - size / 2, x + size / 2, y + size / 2), disparity, colour)


def ball(name: str, camera: Camera, place, disparity: float, radius: float, colour) -> SceneObject:
    """A striped ball around a pixel, its radius in pixels."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    size = radius / float(camera.focal_px) / disparity
    stripes = 0.75 + 0.25 * np.sin(9 * mesh.vertices @ np.array([0.6, 0.7, 0.4]))
    light = 0.55 + 0.45 * np.clip(mesh.vertices @ np.array([-0.5, 0.7, 0.5]), -0.4, 1.0)
    colours = np.clip((stripes * light)[:, None] * np.asarray(colour), 0.0, 1.0)
    middle = in_world(np.array([place]), disparity, camera)[0]
    return make_object(name, size * mesh.vertices + middle, mesh.faces, vertex_colours=colours)


def chequers(camera: Camera, disparity: float, step: float, seed: int = 0) -> SceneObject:
    """A wall of squares of `step` pixels in quiet colours, far beyond the frame on all sides."""
    random = np.random.default_rng(seed)
    row, column = np.mgrid[:_SQUARES, :_SQUARES]
    tone = 0.25 + 0.5 * ((row + column) % 2)
    squares = np.clip(tone[..., None] + random.normal(size=(_SQUARES, _SQUARES, 3)) * 0.1, 0.02, 1)
    texture = squares.repeat(_TEXELS, axis=0).repeat(_TEXELS, axis=1)
    half = _SQUARES * step / 2
    middle = np.array([camera.width / 2, camera.height / 2])
    corners = middle + half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], dtype=float)
    return make_object("wall", in_world(corners, disparity, camera), QUAD, uv=uv, texture=texture)


def smooth_things() -> SpecialCase:
    """Balls and bars without texture before a wall whose colour changes slowly: large parts without edges."""
    camera = view(160, 120)
    balls = [
        ball("near", camera, (40, 80), 1.2, 22.0, (0.8, 0.35, 0.1)),
        ball("sharp", camera, (90, 45), 0.7, 20.0, (0.3, 0.6, 0.2)),
        ball("far", camera, (130, 85), 0.4, 16.0, (0.2, 0.3, 0.8)),
    ]
    bars = [
        branch(
            f"bar {k}",
            camera,
            np.stack([x + np.linspace(-9, 9, 20), np.linspace(-60, 180, 20)], axis=1),
            w,
            4,
        )
        for k, (x, w) in enumerate([(62.0, 1.1), (70.0, 0.9), (112.0, 1.0)])
    ]
    corners = np.array([(-400, -300), (560, -300), (560, 420), (-400, 420)])
    points = in_world(corners, 0.25, camera)
    colours = np.array([(0.9, 0.6, 0.3), (0.2, 0.5, 0.9), (0.3, 0.8, 0.5), (0.7, 0.3, 0.6)])
    wall = make_object("wall", points, QUAD, vertex_colours=colours)
    scene = make_scene([*balls, *bars, wall], unlit=True)
    what = "balls and bars before a plain wall"
    return SpecialCase("smooth things", what, scene, camera, lens_with(camera, 0.7, 1.2, 12.0))


CASES: dict[str, Callable[[], SpecialCase]] = {
    "foreground blur": foreground_blur,
    "branches": crossing_branches,
    "24 layers": lambda: leaves("24 layers", 2000, 24),
    "100 layers": lambda: leaves("100 layers", 12000, 100),
    "highlights": highlights,
    "wide blur": wide_blur,
}
