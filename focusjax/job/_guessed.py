"""How much of a refocused photograph nobody photographed."""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from focusjax.config import Config, FocusTable
from focusjax.geometry import Camera
from focusjax.layers import Layers, faces_of_samples, first_surfaces
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


def in_grey(objects: Mapping[str, range], layers: Layers) -> Layers:
    """The layers of a photograph in grey: guesses in red, what has no measured depth in green, all in blue.

    Args:
        objects: faces of the photograph's objects by name, as its scene has them.
        layers: of that scene.
    """
    face = faces_of_samples(layers)
    grey = layers.samples.radiance.mean(axis=1)
    shown = [
        jnp.where((face >= some.start) & (face < some.stop), grey, 0.0)
        for some in (objects.get(name, range(0)) for name in (GUESS, HOLES))
    ]
    samples = dataclasses.replace(layers.samples, radiance=jnp.stack([*shown, grey], axis=1))
    return dataclasses.replace(layers, samples=samples)


def guessed_shares(grey: Layers, lens: AbstractLens, *, rays: int, seed: int) -> Guessed:
    """Shares of guesses in a picture: R / B and G / B of sums over the picture of `in_grey` layers."""
    picture = render(grey, lens, rays=min(_RAYS, rays), seed=seed)
    red, green, blue = np.asarray(picture).sum(axis=(0, 1))
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
