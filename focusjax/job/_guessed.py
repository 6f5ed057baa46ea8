"""How much of a refocused photograph nobody photographed."""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np

from focusjax.config import Config, FocusTable, RenderTable
from focusjax.geometry import Camera
from focusjax.job._picture import Picture, make_layers
from focusjax.layers import first_surfaces
from focusjax.lens import AbstractLens
from focusjax.photo import GUESS, HOLES
from focusjax.scene import Scene
from focusjax.trace import render

_RAYS = 16
"""Per pixel, at most: a share of all light is soon known."""


@dataclasses.dataclass(frozen=True)
class Guessed:
    """Shares of the light that the lens gathers, 0 to 1.

    Attributes:
        light: of surfaces that are guessed: behind foregrounds, and beyond the frame.
        depth: of pixels whose depth was not measured.
    """

    light: float
    depth: float


def guessed_shares(
    table: RenderTable, scene: Scene, camera: Camera, lens: AbstractLens, picture: Picture
) -> Guessed:
    """Shares of guesses in the `picture` of a photograph's `scene`.

    The scene is rendered again with grey textures: what is guessed in red alone, what has no measured depth
    in green alone, everything in blue, so that the shares are R / B and G / B of sums over the picture.
    """
    tint = {GUESS: [1.0, 0.0, 1.0], HOLES: [0.0, 1.0, 1.0]}
    colours = np.tile([0.0, 0.0, 1.0], (len(scene.materials), 1))
    for name, colour in tint.items():
        if name in scene.objects:
            colours[np.unique(scene.face_material[list(scene.objects[name])])] = colour
    grey = {id(each): np.repeat(each.mean(axis=2, keepdims=True), 3, axis=2) for each in scene.textures}
    tinted = dataclasses.replace(
        scene,
        textures=tuple(grey[id(each)] for each in scene.textures),
        materials=tuple(
            dataclasses.replace(each, base_colour=colour)
            for each, colour in zip(scene.materials, colours, strict=True)
        ),
    )
    layers = make_layers(table, tinted, camera, lens, picture.extent)
    rays = min(_RAYS, picture.rays)
    red, green, blue = np.asarray(render(layers, lens, rays=rays, seed=table.seed)).sum(axis=(0, 1))
    whole = max(float(blue), 1e-30)
    return Guessed(light=float(red) / whole, depth=float(green) / whole)


def warn_of_holes(config: Config, wishes: Sequence[FocusTable], scene: Scene, camera: Camera) -> None:
    """Say so of wishes at pixels whose depth was not measured."""
    holes = scene.objects.get(HOLES)
    pixels = [(k, wish.pixel) for k, wish in enumerate(wishes) if wish.pixel is not None]
    if holes is None or not pixels:
        return
    _, face = first_surfaces(scene, camera)
    for number, (x, y) in pixels:
        if 0 <= x < camera.width and 0 <= y < camera.height and face[int(y), int(x)] in holes:
            warnings.warn(
                f"{config.source}: focus.{number} is at [{x:g}, {y:g}], where the depth map has a hole; its"
                " distance is a guess from around, so choose a place with depth if it matters",
                stacklevel=1,
            )
