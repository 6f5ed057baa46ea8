"""Blur in the picture equals blur by formula: a bright dot becomes the opening, 2 f E |w_f - w| across."""

from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.geometry import Camera, look_at
from focusjax.layers import peel
from focusjax.lens import AbstractAperture, Disk, ThinLens, polygon
from focusjax.scene import Scene, make_object, make_scene
from focusjax.trace import render

SIZE = 48
DISPARITY = 0.5
DOT = 6.0  # edge in pixels; RAYS * DOT^2 rays find it, and the noise is one over the root of that
RADIUS = 0.5
RAYS = 1024


def camera() -> Camera:
    """A small frame on a pose that is aligned with nothing."""
    eye, target = np.array([0.4, 1.0, 2.0]), np.array([-0.3, 0.2, -1.0])
    return look_at(eye, target, width=SIZE, height=SIZE, field_of_view=0.7)


CENTRE = np.array([23.3, 25.6])
"""Where the dot is, in pixels: not on the grid of samples."""


def dot_scene() -> Scene:
    """A square of radiance 40 facing the camera, `DOT` pixels wide, around `CENTRE`."""
    half = DOT / 2
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    points = [camera().unproject(jnp.array(CENTRE + corner), jnp.array(DISPARITY)) for corner in corners]
    dot = make_object("dot", np.array(points), [(0, 1, 2), (0, 2, 3)], colour=(0, 0, 0), emission=40.0)
    return make_scene([dot], unlit=True)


def lens_for(blur: float, aperture: AbstractAperture) -> ThinLens:
    """The lens that gives the dot a signed blur diameter of `blur` pixels."""
    focus = DISPARITY + blur / (2.0 * float(camera().focal_px) * RADIUS)
    return ThinLens(jnp.array(focus), jnp.array(RADIUS), aperture)


@cache
def picture(blur: float, blades: int = 0, rotation: float = 0.0) -> np.ndarray:
    """What becomes of the dot: light per pixel [h, w]."""
    lens = lens_for(blur, polygon(blades, rotation=rotation) if blades else Disk())
    layers = peel(dot_scene(), camera(), lens, supersampling=2)
    return np.asarray(render(layers, lens, rays=RAYS, smooth=False))[..., 0]


def spread(light: np.ndarray) -> np.ndarray:
    """Positions [h, w], as complex numbers x + i y, from the centre of the light."""
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    position = x + 1j * y
    return position - (light * position).sum() / light.sum()


@pytest.mark.parametrize("blur", [-26.0, -9.0, 9.0, 26.0])
def test_diameter(blur: float) -> None:
    predicted = lens_for(blur, Disk()).blur(camera(), jnp.array(CENTRE), jnp.array(DISPARITY))
    assert float(predicted) == pytest.approx(blur)
    light = picture(blur)
    # Variances add: a disk's is D^2 / 16 per axis, the dot's and the pixel's a twelfth of their square.
    position = spread(light)
    variance = [(light * part**2).sum() / light.sum() for part in (position.real, position.imag)]
    measured = 4 * np.sqrt(np.array(variance) - (DOT**2 + 1) / 12)
    # Observed: within 0.033 pixels.
    np.testing.assert_allclose(measured, abs(blur), atol=0.15)


@pytest.mark.parametrize("blur", [-26.0, 26.0])
def test_disk_is_flat_and_ends_at_its_rim(blur: float) -> None:
    light = picture(blur)
    distance = np.abs(spread(light))
    level = 40.0 * DOT**2 / (np.pi * (blur / 2) ** 2)
    rim, corner = abs(blur) / 2, DOT / np.sqrt(2)
    inner, outer = light[distance < 5], light[(distance > 5) & (distance < rim - corner - 1)]
    # Observed: within 0.6 %.
    assert inner.mean() == pytest.approx(level, rel=0.02)
    assert outer.mean() == pytest.approx(level, rel=0.02)
    assert light[distance > rim + corner + 1].sum() == 0.0


@pytest.mark.parametrize("blur", [-26.0, -9.0, 9.0, 26.0])
def test_blur_keeps_the_light(blur: float) -> None:
    sharp, blurred = picture(0.0).sum(), picture(blur).sum()
    # Observed: within 0.13 %.
    assert blurred == pytest.approx(sharp, rel=0.005)


@pytest.mark.parametrize("blades", [3, pytest.param(5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("blur", [-26.0, 26.0])
def test_shape_stands_upright_behind_the_focus_and_on_its_head_before(blur: float, blades: int) -> None:
    """The n-th moment of an n-gon, E[(x + i y)^n], points n times the angle of its corner."""
    rotation = 0.3
    light = picture(blur, blades, rotation)
    moment = (light * spread(light) ** blades).sum() / light.sum()
    expected = _polygon_moment(blades) * (blur / 2 * np.exp(1j * rotation)) ** blades
    # Observed: within 0.023; a turn by 1 degree would give 0.05 for three corners, 0.09 for five.
    assert abs(moment / expected - 1) < 0.05


def _polygon_moment(corners: int) -> float:
    """E[z^n] over the regular n-gon with a corner at z = 1, on a fine grid."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, 1001)] * 2)
    middle = np.pi / corners * (2 * np.arange(corners) + 1)
    inside = np.all([x * np.cos(a) + y * np.sin(a) <= np.cos(np.pi / corners) for a in middle], axis=0)
    return float(((x + 1j * y) ** corners)[inside].mean().real)
