"""Blurred lights as they should look: their profiles against closed forms."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch

from focusjax.geometry import Camera
from focusjax.layers import Layers, peel
from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    ThinLens,
    chromatic_lens,
    power_profile,
    seidel,
    vignetted_lens,
)
from focusjax.scene import constant_background, make_scene
from focusjax.trace import render

FOCUS, PARALLAX = 0.5, 32.0
BEHIND, BEFORE = (16.0, 16.0), (48.0, 16.0)
"""Places of a light at disparity 0.25, and of one at 0.75: both blurred over 16 px."""
SIDE = 1.5


@cache
def camera() -> Camera:
    return front_camera(64, 32)


def thin() -> ThinLens:
    return ThinLens(jnp.array(FOCUS), jnp.array(PARALLAX / float(camera().focal_px)))


@cache
def lights() -> Layers:
    """Two small lights in the dark, peeled for lenses that blur more than these."""
    boxes = {"behind": (BEHIND, 0.25), "before": (BEFORE, 0.75)}
    objects = [
        patch(name, camera(), (x - SIDE / 2, y - SIDE / 2, x + SIDE / 2, y + SIDE / 2), disparity, 100.0)
        for name, ((x, y), disparity) in boxes.items()
    ]
    scene = make_scene(objects, background=constant_background(0.0), unlit=True)
    widest = AberratedLens(thin(), (power_profile([-0.1, 0.1]),))
    return peel(scene, camera(), widest, supersampling=2)


def disc(picture: np.ndarray, place: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Distance from a light's place and brightness [n, 3] of the pixels around it."""
    column, row = int(place[0]) - 16, int(place[1]) - 16
    part = picture[row : row + 32, column : column + 32].reshape(-1, 3)
    y, x = np.divmod(np.arange(32 * 32), 32)
    return np.hypot(x + 0.5 - 16, y + 0.5 - 16), part


def expected_light(lens_offset, place: tuple[float, float], disparity: float) -> np.ndarray:
    """Distances from a light's place of the pixels that its rays land in, as far as its own size allows.

    For focus offsets that are a function of the pupil's radius.
    """
    random = np.random.default_rng(0)
    radius, turn = np.sqrt(random.uniform(size=40000)), random.uniform(size=40000)
    spread = PARALLAX * radius * (FOCUS + lens_offset(radius) - disparity)
    landed = spread[:, None] * np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)], axis=1)
    landed += random.uniform(-SIDE / 2, SIDE / 2, landed.shape) + np.array(place)
    return np.linalg.norm(np.floor(landed) + 0.5 - np.array(place), axis=1)


@pytest.mark.parametrize("strength", [0.06, -0.06], ids=["under-corrected", "over-corrected"])
def test_spherical_aberration_makes_cores_and_rims(strength: float):
    """Kyaw 6.3.1: under-corrected, bright cores behind the focus and bright rims before it."""
    lens = AberratedLens(thin(), (power_profile([0.0, strength]),))
    picture = np.asarray(render(lights(), lens, rays=1024, even=True))
    radii = np.linspace(1.5, 9.5, 9)
    for place, disparity in ((BEHIND, 0.25), (BEFORE, 0.75)):
        away, light = disc(picture, place)
        # All of it is there. Observed: 0.4 %.
        assert light[:, 0].sum() == pytest.approx(100.0 * SIDE**2, rel=0.02)
        found = np.array([light[away < radius, 0].sum() for radius in radii]) / light[:, 0].sum()
        landed = expected_light(lambda r: strength * r**2, place, disparity)
        expected = (landed[:, None] < radii).mean(axis=0)
        # Observed: 0.012.
        np.testing.assert_allclose(found, expected, atol=0.03)
        rim = PARALLAX * abs(FOCUS + strength - disparity)
        outer = light[(away > 0.65 * rim) & (away < 0.85 * rim), 0].mean()
        bright_core = (strength > 0) == (disparity < FOCUS)
        core = light[away < 0.45 * rim, 0].mean()
        # In closed form: 1.47 for cores, 0.62 for rims.
        assert core / outer > 1.3 if bright_core else core / outer < 0.75


def test_the_seidel_term_is_the_same_as_a_parabola_of_power():
    """W040 in pixels moves the rim by four times as much, and 4 W040 / (f E) is the rim's focus offset."""
    lens = thin()
    by_power = AberratedLens(lens, (power_profile([0.0, 0.06]),))
    by_wave = AberratedLens(lens, (seidel(lens, camera(), w040=0.06 * PARALLAX / 4),))
    film, points = jnp.array([20.0, 7.0]), jnp.array([(0.3, -0.8), (0.1, 0.2), (1.0, 0.0)])
    for point in points:
        one, other = (each.ray(camera(), film, point) for each in (by_power, by_wave))
        np.testing.assert_allclose(one.a, other.a, atol=1e-12)
    disparity = jnp.array(0.2)
    # Observed: 0.
    assert float(by_power.blur(camera(), film, disparity)) == pytest.approx(
        float(by_wave.blur(camera(), film, disparity)), abs=1e-12
    )


def chromatic() -> AbstractLens:
    return chromatic_lens(thin(), focus_offset=(-0.04, 0.0, 0.04), magnification=(1.01, 1.0, 0.99))


@pytest.mark.slow
def test_colour_fringes_swap_sides_across_the_focus():
    """Blue focuses nearest: it is spread wider behind the focus, and red before it; radii by closed form."""
    picture = np.asarray(render(lights(), chromatic(), rays=1024, even=True))
    for place, disparity, sign in ((BEHIND, 0.25, 1), (BEFORE, 0.75, -1)):
        away, light = disc(picture, place)
        spread = np.sqrt(2 * (away[:, None] ** 2 * light).sum(axis=0) / light.sum(axis=0))
        expected = PARALLAX * np.abs(FOCUS + np.array([-0.04, 0.0, 0.04]) - disparity)
        # Observed: 0.12 px, of the light's size, lateral colour and noise.
        np.testing.assert_allclose(spread, expected, atol=0.3)
        assert sign * (spread[2] - spread[0]) > 2.0
    # Lateral colour: both lights, 16 px from the middle, are moved out in red and in towards it in blue.
    columns = np.arange(64) + 0.5
    for place, out in ((BEHIND, -1), (BEFORE, 1)):
        first = int(place[0]) - 16
        light = picture[:, first : first + 32].sum(axis=0)
        middle = (columns[first : first + 32, None] * light).sum(axis=0) / light.sum(axis=0)
        # Observed: 0.03 px.
        np.testing.assert_allclose(middle - place[0], out * np.array([0.16, 0.0, -0.16]), atol=0.1)


def overlap(apart: float, radius: float) -> float:
    """Share of a unit disk that a disk of another radius covers whose centre is `apart` from its own."""
    if apart <= radius - 1.0:
        return 1.0
    first = np.arccos((apart**2 + 1 - radius**2) / (2 * apart))
    second = np.arccos((apart**2 + radius**2 - 1) / (2 * apart * radius))
    kite = 0.5 * np.sqrt(
        (-apart + 1 + radius) * (apart + 1 - radius) * (apart - 1 + radius) * (apart + 1 + radius)
    )
    return (first + radius**2 * second - kite) / np.pi


def test_cats_eyes_grow_to_the_corners_which_darken_as_much():
    """Of two disks in closed form; lights far away, which are in focus, so that the shift is exact."""
    lens = ThinLens(jnp.array(0.0), jnp.array(0.1))
    tube = vignetted_lens(lens, camera(), corner_shift=0.9, disk=1.1)
    middles = (jnp.arange(100) + 0.5) / 100
    samples = jnp.stack(jnp.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    pupil = jax.vmap(tube.pupil_point)(samples)
    passed = jax.jit(lambda film: jax.vmap(lambda v: tube.ray(camera(), film, v).weight)(pupil))
    narrow = []
    for share in (0.0, 0.4, 0.7, 1.0):
        # Along the diagonal to the top right.
        film = jnp.array([32.0 + 32.0 * share, 16.0 - 16.0 * share])
        weight = np.asarray(passed(film))
        # Observed: 1.1e-3, by the disk's soft edge.
        assert weight.mean() == pytest.approx(overlap(0.9 * share, 1.1), abs=3e-3)
        outwards = np.asarray(pupil) @ np.array([2.0, -1.0]) / np.sqrt(5)
        kept = weight > 0.5
        narrow.append((outwards[kept].max() - outwards[kept].min()) / 2)
        # Light is lost on the side away from the middle.
        assert share == 0 or outwards[kept].max() < -outwards[kept].min()
    # The eye is as wide as 1 + 1.1 - shift, of a diameter of 2. Observed: 0.008.
    np.testing.assert_allclose(narrow, [1.0, min(1.0, 2.1 / 2 - 0.18), 1.05 - 0.315, 0.6], atol=0.02)


def test_pictures_darken_towards_the_corners_by_what_the_disk_takes():
    """Of an even sky, in its colour; many rays at once, which are a large block of a picture."""
    view = front_camera(128, 96)
    sky = np.array([0.1, 0.2, 0.3])
    scene = make_scene(
        [patch("light", view, (60, 44, 68, 52), 0.25, 1.0)], background=constant_background(sky), unlit=True
    )
    lens = vignetted_lens(ThinLens(jnp.array(0.0), thin().aperture_radius), view, corner_shift=0.9)
    picture = np.asarray(render(peel(scene, view, lens, supersampling=2), lens, rays=8, even=True))
    # Blocks of 8 x 8 pixels along the border.
    for row, column in ((0, 0), (0, 15), (11, 0), (0, 8), (5, 15)):
        found = picture[8 * row : 8 * row + 8, 8 * column : 8 * column + 8].mean(axis=(0, 1))
        x, y = 8 * column + 4 - 64, 8 * row + 4 - 48
        # Observed: 0.8 %, of 512 rays.
        np.testing.assert_allclose(found / sky, overlap(0.9 * np.hypot(x, y) / 80, 1.1), rtol=0.02)


def test_a_stopped_down_lens_loses_its_aberrations_and_cats_eyes():
    """Spherical aberration as the cube of the opening, coma as its square, and no vignetting."""
    full = thin()
    terms = seidel(full, camera(), w040=1.0, w131=1.0)
    half = ThinLens(full.focus_disparity, full.aperture_radius / 2)
    film, rim = jnp.array([40.0, 16.0]), jnp.array([0.0, 1.0])
    moved = [
        np.asarray(AberratedLens(lens, (terms,)).ray(camera(), film, rim).a - lens.ray(camera(), film, rim).a)
        for lens in (full, half)
    ]
    h = 8.0 / np.hypot(32.0, 16.0)
    # The film point looks back along grad W: -4 W040 u^3, and +W131 h u^2 across it.
    np.testing.assert_allclose(moved[0], [h, -4.0], atol=1e-12)
    np.testing.assert_allclose(moved[1], [h / 4, -0.5], atol=1e-12)
    tube = vignetted_lens(full, camera(), corner_shift=0.8)
    stopped = type(tube)(half, tube.disk_radius, tube.disk_distance)
    corner, side = jnp.array([64.0, 16.0]), jnp.array([1.0, 0.0])
    assert float(tube.ray(camera(), corner, side).weight) == 0.0
    assert float(stopped.ray(camera(), corner, side).weight) == 1.0
