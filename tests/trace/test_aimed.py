"""Rays aimed at highlights bring what the others would, with less noise, and no more light."""

import dataclasses
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers

from focusjax.layers import Layers, peel
from focusjax.lens import (
    AbstractLens,
    FocalSurfaceLens,
    ThinLens,
    TiltShiftLens,
    focal_surface,
    focal_surface_lens,
    polygon,
)
from focusjax.scene import make_scene
from focusjax.trace import render
from focusjax.trace import _tracer
from focusjax.trace._highlights import split_highlights

CAMERA = front_camera()
RADIUS = 14.0 / float(CAMERA.focal_px)
BLADES = polygon(5, rotation=0.3)


def thin() -> ThinLens:
    return ThinLens(jnp.array(1.0), jnp.array(RADIUS), BLADES)


def tilted() -> TiltShiftLens:
    return TiltShiftLens(jnp.array([2.0, 1.0, 1.0]), jnp.array(RADIUS), BLADES)


def surfaced() -> FocalSurfaceLens:
    surface = focal_surface([(5.0, 5.0), (27.0, 12.0), (9.0, 20.0)], [0.95, 1.0, 1.05], basis="affine")
    return focal_surface_lens(surface, CAMERA, thin())


LENSES = {"thin": thin, "tilted": tilted, "focal surface": surfaced}


@cache
def lit(name: str) -> Layers:
    """Lamps before a wall, one of them leaning, behind bars and a pane."""
    lamps = [
        patch("square", CAMERA, (8, 7, 10, 9), 0.4, (60, 40, 20)),
        patch("leaning", CAMERA, (20, 12, 23, 14), (0.3, 0.7, 0.7, 0.3), (20, 30, 40)),
        patch("dot", CAMERA, (15, 16, 16, 17), 1.6, (99, 99, 99)),
    ]
    wall = patch("wall", CAMERA, (-60, -60, 90, 90), 0.25, (0.2, 0.3, 0.2))
    bars = [patch(f"bar {x}", CAMERA, (x, -30, x + 3, 60), 0.9, (0.1, 0.1, 0.1)) for x in (3, 13, 22)]
    plain = patch("pane", CAMERA, (12, 2, 31, 18), 0.8, (0.5, 0.1, 0.1))
    pane = dataclasses.replace(plain, materials=(dataclasses.replace(plain.materials[0], opacity=0.5),))
    return peel(make_scene([*lamps, wall, *bars, pane], unlit=True), CAMERA, LENSES[name](), supersampling=1)


@pytest.mark.parametrize("name", LENSES)
def test_aimed_rays_bring_what_the_others_would(name: str, monkeypatch: pytest.MonkeyPatch):
    layers = lit(name)
    lens: AbstractLens = layers.lens
    aimed = [np.asarray(render(layers, lens, rays=32, seed=k)) for k in range(4)]
    print(_tracer.Tracer(layers,lens)._aimed.rays(32), len(_tracer.Tracer(layers,lens)._aimed.pixels))
    monkeypatch.setattr(_tracer, "split_highlights", lambda layers, lens: (layers, None))
    others = [np.asarray(render(layers, lens, rays=512, even=True, seed=k)) for k in range(4)]
    print(split_highlights(layers, lens)[1].low.shape, name, [p.mean((0, 1)) for p in (np.mean(aimed, 0), np.mean(others, 0))])

    def blocks(pictures):
        return np.stack(pictures).reshape(len(pictures), 6, 4, 8, 4, 3).mean(axis=(2, 4))

    once = [np.asarray(render(layers, lens, rays=32, seed=k)) for k in range(4)]
    first, second = blocks(aimed), blocks(others)
    error = np.sqrt((first.var(axis=0, ddof=1).mean() + second.var(axis=0, ddof=1).mean()) / 4)
    away = first.mean(axis=0) - second.mean(axis=0)
    print(error, np.sqrt((away**2).mean()), away.mean(), np.std(aimed, 0).mean(), np.std(once, 0).mean(), np.std(others, 0).mean())
