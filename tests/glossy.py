"""A glossy scene, and its picture by Embree and plain numpy: every ray shades what it meets for itself."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import trimesh
from small_scenes import SQUARE, front_camera

from focusjax.baselines import RayCaster
from focusjax.geometry import Camera
from focusjax.lens import ThinLens
from focusjax.scene import (
    Scene,
    directional_light,
    gradient_background,
    make_object,
    make_scene,
    point_light,
)

BOTTOM, HORIZON, TOP = (0.05, 0.04, 0.03), (0.5, 0.4, 0.35), (0.02, 0.06, 0.15)
SUN, SUN_COLOUR = np.array([-0.1, -0.17, 1.0]), np.array([4.0, 3.5, 3.0])
LAMP, LAMP_INTENSITY = np.array([-0.6, 0.4, 0.1]), np.array([0.3, 0.6, 1.2])
AMBIENT = 0.1
STEPS = 0.8566748838545029 ** np.arange(1, 5)
"""One over powers of the root of x^5 = x + 1: steps that fill the 4-cube evenly (Roberts 2018)."""


@cache
def glossy_scene() -> Scene:
    """A ball with highlights that mirrors the sky, over a polished table that a lamp behind it shines on."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.16)
    ball = make_object(
        "ball",
        mesh.vertices,
        mesh.faces,
        colour=(0.5, 0.2, 0.1),
        specular=(0.7, 0.6, 0.5),
        shininess=200.0,
        reflectance=(0.3, 0.4, 0.5),
        translate=(-0.16, 0.02, -1.0),
    )
    corners = [(-3.0, -0.15, -0.4), (3.0, -0.15, -0.4), (3.0, -0.15, -4.0), (-3.0, -0.15, -4.0)]
    table = make_object(
        "table", corners, SQUARE, colour=(0.2, 0.15, 0.1), specular=0.8, shininess=400.0, reflectance=0.3
    )
    return make_scene(
        [ball, table],
        lights=[directional_light(SUN, SUN_COLOUR), point_light(LAMP, LAMP_INTENSITY)],
        ambient=AMBIENT,
        background=gradient_background(BOTTOM, HORIZON, TOP),
    )


def glossy_camera() -> Camera:
    """Sees the ball 26 pixels wide."""
    return front_camera(64, 48)


def glossy_lens(focus: float = 0.5) -> ThinLens:
    """A lens of 10 cm radius, 1.5 times as far from the middle of the ball as that is wide."""
    return ThinLens(jnp.array(focus), jnp.array(0.1))


def sky(direction: np.ndarray) -> np.ndarray:
    """Radiance [n, 3] from infinity, linear in the elevation angle."""
    unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    share = np.arcsin(np.clip(unit[:, 1:2], -1, 1)) / (np.pi / 2)
    end = np.where(share < 0, BOTTOM, TOP)
    return HORIZON + np.abs(share) * (end - HORIZON)


def ray_by_ray(scene: Scene, camera: Camera, lens: ThinLens, *, rays: int, baked: bool = False) -> np.ndarray:
    """Picture [h, w, 3] of `rays` rays per pixel, their gloss as seen from where they start.

    With `baked`, as seen from the middle of the lens, which is what is asked of baked layers.
    """
    shift = np.random.default_rng(0).uniform(size=(camera.width * camera.height, 4))
    count = camera.width * camera.height
    row, column = np.divmod(np.arange(count), camera.width)
    caster = RayCaster(scene.vertices, scene.faces)
    focal, radius, focus = float(camera.focal_px), float(lens.aperture_radius), float(lens.focus_disparity)
    total = np.zeros((count, 3))
    for number in range(rays):
        square = (shift + number * STEPS) % 1.0
        film = np.stack([column, row], axis=1) + square[:, :2]
        angle, size = 2 * np.pi * square[:, 2], radius * np.sqrt(square[:, 3])
        origins = np.stack([size * np.cos(angle), size * np.sin(angle), np.zeros(count)], axis=1)
        x, y = ((film - [camera.width / 2, camera.height / 2]) / focal).T
        directions = np.stack([x, -y, -np.ones(count)], axis=1)
        # Every ray of a film point meets the others where the plane in focus is.
        directions[:, :2] -= origins[:, :2] * focus
        total += _seen(scene, caster, origins, directions, baked)
    return (total / rays).reshape(camera.height, camera.width, 3)


def _seen(
    scene: Scene, caster: RayCaster, origins: np.ndarray, directions: np.ndarray, baked: bool
) -> np.ndarray:
    hits = caster.first_hits(origins, directions)
    radiance = sky(directions)
    met = np.flatnonzero(hits.triangle >= 0)
    face = scene.faces[hits.triangle[met]]
    material = [scene.materials[k] for k in scene.face_material[hits.triangle[met]]]
    albedo, specular, reflectance = (
        np.stack([getattr(m, name) for m in material]) for name in ("base_colour", "specular", "reflectance")
    )
    shininess = np.array([m.shininess for m in material])[:, None]
    point = origins[met] + hits.distance[met, None] * directions[met]
    normal = np.einsum("nk,nkc->nc", hits.barycentric[met], scene.normals[face])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    to_eye = (0.0 if baked else origins[met]) - point
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    first, second, third = scene.vertices[face].transpose(1, 0, 2)
    flat = np.cross(second - first, third - first)
    normal *= np.sign(_dot(normal, flat)) * np.sign(_dot(to_eye, flat))
    mirrored = 2 * _dot(normal, to_eye) * normal - to_eye
    diffuse, highlight = np.full_like(point, AMBIENT), np.zeros_like(point)
    to_lamp = LAMP - point
    distance = np.linalg.norm(to_lamp, axis=1, keepdims=True)
    to_sun = np.broadcast_to(-SUN / np.linalg.norm(SUN), point.shape)
    for to_light, light in ((to_sun, SUN_COLOUR), (to_lamp / distance, LAMP_INTENSITY / distance**2)):
        cosine = _dot(normal, to_light)
        diffuse += light * np.maximum(cosine, 0)
        highlight += np.where(cosine > 0, light * np.maximum(_dot(mirrored, to_light), 0) ** shininess, 0)
    radiance[met] = albedo * diffuse + specular * highlight + reflectance * sky(mirrored)
    return radiance


def _dot(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return (left * right).sum(axis=1, keepdims=True)
