"""The scene of a picture: objects before a wall, of the same number of everything for all pictures.

Arrays that shading is compiled for have the size of the largest scene that a spec allows: what there is less
of is made up by triangles behind the camera, materials that nothing has, and white textures.
"""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from skimage.transform import resize_local_mean

from focusjax.dataset._shapes import Shape, box, light, mesh, patch, sphere
from focusjax.dataset._spec import Spec
from focusjax.dataset._textures import TEXELS, texture
from focusjax.geometry import Camera, look_at
from focusjax.scene import (
    Material,
    Scene,
    SceneObject,
    directional_light,
    make_object,
    make_scene,
    placement,
)

WALL, GROUND = "wall", "ground"
_INNER = 0.8
"""Of the frame, within which the middles of objects are."""
_UPRIGHT = 0.2
"""Cosine of the camera's roll below which nothing is put on the ground."""
_TILE = 2.0
"""Metres of wall and ground that a texture is spread over."""
_BEHIND = 10.0
"""Metres."""


def draw_camera(spec: Spec, focal_length: float, random: np.random.Generator) -> Camera:
    """Above the ground, looking along -z, up or down, and turned about its axis; `focal_length` in metres."""
    table = spec.camera
    height, pitch = table.height_m.draw(random), math.radians(table.pitch_deg.draw(random))
    roll = math.radians(table.roll_deg.draw(random))
    forward = np.array([0.0, math.sin(pitch), -math.cos(pitch)])
    above = np.array([0.0, math.cos(pitch), math.sin(pitch)])
    eye = np.array([0.0, height, 0.0])
    width, rows = table.resolution
    return look_at(
        eye,
        eye + forward,
        math.cos(roll) * above + math.sin(roll) * np.array([1.0, 0.0, 0.0]),
        width=width,
        height=rows,
        focal_length=focal_length,
        sensor_width=1e-3 * table.sensor_width_mm,
    )


def draw_scene(spec: Spec, camera: Camera, files: tuple[Path, ...], random: np.random.Generator) -> Scene:
    """A scene before `camera`; `files` are the meshes that there are."""
    table = spec.scene
    wall = table.wall_m.draw(random)
    objects = list(_around(spec, camera, wall, random))
    for number in range(table.objects.draw_whole(random)):
        kind = table.chosen_kinds[int(random.integers(len(table.chosen_kinds)))]
        name, size = f"object {number + 1}", table.size_m.draw(random)
        if kind == "mesh":
            file = files[int(random.integers(len(files)))]
            objects.append(_mesh(name, file, size, spec, camera, random))
        else:
            objects.append(_solid(name, kind, size, spec, camera, random))
    for number in range(table.lights.draw_whole(random)):
        objects.append(_light(f"light {number + 1}", spec, camera, wall, random))
    # White paper that faces the light is as bright as 1, and nothing else but lights is brighter.
    sun = random.uniform(0.4, 0.75)
    travel = np.array([random.uniform(-1, 1), -random.uniform(0.4, 1.5), -random.uniform(0.3, 1.0)])
    scene = make_scene(objects, lights=[directional_light(travel, sun)], ambient=1.0 - sun)
    return _padded(scene, spec)


def _around(spec: Spec, camera: Camera, wall: float, random: np.random.Generator) -> Iterator[SceneObject]:
    """The wall and the ground, wider than the frame."""
    pitch = max(abs(math.radians(end)) for end in spec.camera.pitch_deg.ends)
    eye = np.asarray(camera.position, dtype=np.float64)
    half = 1.0 + 1.5 * wall * math.tan(math.atan(spec.camera.corner) + pitch)
    kinds = [spec.scene.textures[int(random.integers(len(spec.scene.textures)))] for _ in range(2)]
    upright = patch(2 * half, 2 * half)
    yield _placed(WALL, upright, texture(kinds[0], random), (0.0, eye[1], -wall), tile=_TILE)
    painted = texture(kinds[1], random)
    if spec.scene.ground:
        deep = wall + 1.0
        flat = patch(2 * half, deep)
        yield _placed(GROUND, flat, painted, (0.0, 0.0, 1.0 - 0.5 * deep), turn=(-90.0, 0.0, 0.0), tile=_TILE)


def _placed(
    name: str,
    shape: Shape,
    painted: Float[np.ndarray, "64 64 3"],
    place: tuple[float, float, float] | Float[np.ndarray, "3"],
    *,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    size: float = 1.0,
    tile: float = 1.0,
) -> SceneObject:
    return make_object(
        name,
        shape.vertices,
        shape.faces,
        uv=shape.uv / tile,
        texture=painted,
        smooth_angle=shape.smooth_angle,
        translate=tuple(float(metres) for metres in place),
        rotate=turn,
        scale=size,
    )


def _solid(
    name: str, kind: str, size: float, spec: Spec, camera: Camera, random: np.random.Generator
) -> SceneObject:
    """A box, a patch or a sphere with a texture."""
    table = spec.scene
    painted = texture(table.textures[int(random.integers(len(table.textures)))], random)
    edges = [1.0, *random.uniform(0.4, 1.0, 2)]
    turn = _turn(random)
    if kind == "sphere":
        shape = sphere()
    elif kind == "box":
        shape = box(*random.permutation(edges))
    else:
        shape = patch(*edges[:2])
        turn = (random.uniform(-50, 50), random.uniform(-50, 50), random.uniform(0, 360))
    stands, place = _place(spec, camera, size * shape.radius, random)
    if stands:
        turn = (0.0, turn[1], 0.0)
        place[1] = -size * shape.vertices[:, 1].min()
    return _placed(name, shape, painted, place, turn=turn, size=size)


def _mesh(
    name: str, file: Path, size: float, spec: Spec, camera: Camera, random: np.random.Generator
) -> SceneObject:
    """A mesh file as it is, scaled and turned about the upright axis, or any if it floats."""
    raw = mesh(file, spec.mesh_folder or file.parent)
    turn = _turn(random)
    radius = size * float(np.linalg.norm(raw.vertices, axis=1).max())
    stands, place = _place(spec, camera, radius, random)
    if stands:
        turn = (0.0, turn[1], 0.0)
        place[1] = -size * raw.vertices[:, 1].min()
    matrix = placement((0.0, 0.0, 0.0), turn, 1.0)[:3, :3]
    return dataclasses.replace(
        raw,
        name=name,
        vertices=size * raw.vertices @ matrix.T + place,
        normals=raw.normals @ matrix.T,
        textures=tuple(_of_size(picture) for picture in raw.textures),
    )


def _light(name: str, spec: Spec, camera: Camera, wall: float, random: np.random.Generator) -> SceneObject:
    """A small bright sphere anywhere between the nearest object and the wall, uniform in disparity."""
    table = spec.scene
    size, radiance = table.light_size_m.draw(random), table.light_radiance.draw(random)
    depth = 1.0 / random.uniform(1.0 / (0.95 * wall), 1.0 / table.distance_m.ends[0])
    shape, tint = light(), random.uniform(0.6, 1.0, 3)
    x, y = random.uniform(0.0, 1.0, 2) * (camera.width, camera.height)
    return make_object(
        name,
        shape.vertices,
        shape.faces,
        uv=shape.uv,
        texture=np.full((TEXELS, TEXELS, 3), 0.0, dtype=np.float32),
        emission=radiance * tint,
        smooth_angle=shape.smooth_angle,
        translate=_seen_at(camera, x, y, depth).tolist(),
        scale=size,
    )


def _turn(random: np.random.Generator) -> tuple[float, float, float]:
    x, y, z = (float(angle) for angle in random.uniform(0.0, 360.0, 3))
    return x, y, z


def _place(
    spec: Spec, camera: Camera, radius: float, random: np.random.Generator
) -> tuple[bool, Float[np.ndarray, "3"]]:
    """Where the middle of an object of that `radius` is, and whether it is to stand below on the ground."""
    depth = spec.scene.distance_m.draw(random) + radius
    stands = random.uniform() < spec.scene.standing and spec.scene.ground
    across, down = 0.5 + _INNER * random.uniform(-0.5, 0.5, 2)
    x, y = across * camera.width, down * camera.height
    if stands:
        # The row whose point at that depth is as high as the object's middle, about.
        up = float(camera.world_from_camera[1, 1])
        lower, upper = (_seen_at(camera, x, row, depth)[1] for row in (camera.height, 0.0))
        if abs(up) < _UPRIGHT or not lower < 0.5 * radius < upper:
            return False, _seen_at(camera, x, y, depth)
        y = camera.height * (upper - 0.5 * radius) / (upper - lower)
    return stands, _seen_at(camera, x, y, depth)


def _seen_at(camera: Camera, x: float, y: float, depth: float) -> Float[np.ndarray, "3"]:
    """The world point in metres that is seen at a pixel position, so deep along the view axis."""
    pose = np.asarray(camera.world_from_camera, dtype=np.float64)
    focal = float(camera.focal_length) / float(camera.sensor_width) * camera.width
    along = np.array([(x - camera.width / 2) / focal, (camera.height / 2 - y) / focal, -1.0])
    return pose[:3, 3] + depth * (pose[:3, :3] @ along)


def _of_size(picture: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "64 64 3"]:
    """A mesh's texture with as many texels as others."""
    if picture.shape[:2] == (TEXELS, TEXELS):
        return picture
    return resize_local_mean(picture, (TEXELS, TEXELS), channel_axis=-1).astype(np.float32)


@dataclass(frozen=True)
class _Room:
    """How many there are of each in the largest scene without meshes."""

    vertices: int
    faces: int
    things: int


def _room(spec: Spec) -> _Room:
    objects, lights = int(spec.scene.objects.ends[1]), int(spec.scene.lights.ends[1])
    kinds = set(spec.scene.chosen_kinds)
    shapes = [patch(1, 1)] + ([box(1, 1, 1)] if "box" in kinds else [])
    shapes += [sphere()] if "sphere" in kinds else []
    most, lamp = max(shapes, key=lambda shape: len(shape.faces)), light()
    return _Room(
        vertices=8 + objects * len(most.vertices) + lights * len(lamp.vertices) + 3,
        faces=4 + objects * len(most.faces) + lights * len(lamp.faces) + 1,
        things=2 + objects + lights,
    )


def _padded(scene: Scene, spec: Spec) -> Scene:
    """The scene with room for the largest, doubled until it is enough where meshes have more."""
    room = _room(spec)
    vertices = _enough(len(scene.vertices) + 3, room.vertices) - len(scene.vertices)
    faces = _enough(len(scene.faces) + 1, room.faces) - len(scene.faces)
    materials = _enough(len(scene.materials) + 1, room.things + 1) - len(scene.materials)
    textures = _enough(len(scene.textures), room.things) - len(scene.textures)
    beyond = np.array([(0.0, 0.0, _BEHIND), (1.0, 0.0, _BEHIND), (0.0, 1.0, _BEHIND)])
    nothing = np.zeros(3)
    # Where a spec may have lights, all its scenes shade emission.
    glow = np.ones(3) if spec.scene.lights.ends[1] > 0 else nothing
    spare = Material(base_colour=nothing, emission=glow, specular=nothing)
    white = np.ones((TEXELS, TEXELS, 3), dtype=np.float32)
    return dataclasses.replace(
        scene,
        vertices=np.concatenate([scene.vertices, beyond[np.arange(vertices) % 3]]),
        normals=_with_rows(scene.normals, np.array([0.0, 0.0, 1.0]), vertices),
        uv=_with_rows(scene.uv, np.zeros(2), vertices),
        colours=_with_rows(scene.colours, np.ones(3), vertices),
        vertex_opacity=None
        if scene.vertex_opacity is None
        else np.concatenate([scene.vertex_opacity, np.ones(vertices)]),
        faces=_with_rows(scene.faces, len(scene.vertices) + np.arange(3), faces),
        face_material=np.concatenate([scene.face_material, np.full(faces, len(scene.materials))]).astype(
            np.int32
        ),
        materials=(*scene.materials, *[spare] * materials),
        textures=(*scene.textures, *[white] * textures),
    )


def _with_rows(
    values: Float[np.ndarray, "n k"] | Int[np.ndarray, "n k"], row: np.ndarray, count: int
) -> np.ndarray:
    """`count` more rows that are all alike, of the same type."""
    return np.concatenate([values, np.broadcast_to(row, (count, len(row)))]).astype(values.dtype)


def _enough(needed: int, room: int) -> int:
    while room < needed:
        room *= 2
    return room
