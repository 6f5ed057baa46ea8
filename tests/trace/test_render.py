"""Pictures whose every pixel is known: by symmetry, by closed form, or from another way to the same one."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from small_scenes import HEIGHT, WIDTH, at_pixels, front_camera, patch, varied_layers, varied_scene, wide_lens

from focusjax._programs import forget_programs
from focusjax.layers import peel
from focusjax.lens import ThinLens
from focusjax.scene import constant_background, make_object, make_scene
from focusjax.trace import _devices, render, render_pinhole


def varied_picture(rays: int = 16, seed: int = 0) -> np.ndarray:
    layers = varied_layers()
    return np.asarray(render(layers, layers.lens, rays=rays, seed=seed))


def test_uniform_radiance_stays_uniform_to_the_border():
    radiance = np.array([0.25, 1.0, 7.0])
    uniform = eqx.tree_at(
        lambda layers: (layers.samples.radiance, layers.background),
        varied_layers(),
        (
            jnp.broadcast_to(radiance, varied_layers().samples.radiance.shape),
            jnp.broadcast_to(radiance, varied_layers().background.shape),
        ),
    )
    picture = np.asarray(render(uniform, uniform.lens, rays=16))
    # Observed: 0.
    np.testing.assert_allclose(picture, np.broadcast_to(radiance, picture.shape), rtol=1e-12)


def test_a_closed_aperture_gives_the_pinhole_picture():
    closed = ThinLens(jnp.array(0.5), jnp.array(0.0))
    picture = np.asarray(render(varied_layers(), closed, rays=64))
    pinhole = np.asarray(render_pinhole(varied_layers()))
    # Rays fall unevenly on the four samples of a pixel at an edge, and colours are interpolated.
    # Observed: 6.1e-3 on average, 0.11 at most, at the edges.
    assert np.abs(picture - pinhole).mean() < 7e-3
    assert np.abs(picture - pinhole).max() < 0.2


def test_each_thing_is_where_it_belongs():
    """Green in focus at the upper left, red far behind the focus at the lower right."""
    camera = front_camera()
    sharp = patch("sharp", camera, (4, 4, 10, 9), 0.5, (0, 1, 0))
    blurred = patch("blurred", camera, (20, 15, 26, 19), 0.1, (1, 0, 0))
    lens = wide_lens(camera)
    layers = peel(make_scene([sharp, blurred], unlit=True), camera, lens, supersampling=2)
    picture = np.asarray(render(layers, lens, rays=64, smooth=False))
    assert picture.shape == (HEIGHT, WIDTH, 3)
    green = np.zeros((HEIGHT, WIDTH))
    green[4:9, 4:10] = 1.0
    # Where all that a pixel's rays can meet is in focus, edges are exact but for rays that pass within a step
    # of disparity of them. Observed: one of 128 rays of one pixel.
    np.testing.assert_allclose(picture[..., 1], green, atol=0.01)
    red = picture[..., 0]
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    # Observed: 22.98, 17.00 and 24.05.
    assert (red * x).sum() / red.sum() == pytest.approx(23.0, abs=0.05)
    assert (red * y).sum() / red.sum() == pytest.approx(17.0, abs=0.05)
    assert red.sum() == pytest.approx(24.0, rel=0.02)
    assert red.max() < 0.5
    # Blur reaches 2 * 12 * 0.4 / 2 = 4.8 pixels out, and a filter of half a pixel more.
    assert red[:, 14].sum() == red[:, 31].sum() == red[9].sum() == 0.0
    assert min(red[:, 16].sum(), red[:, 29].sum(), red[11].sum(), red[22].sum()) > 0.0
    assert not picture[..., 2].any()


@pytest.mark.parametrize(
    ("slope_x", "slope_y"), [(0.045, 0.045), pytest.param(0.0, -0.06, marks=pytest.mark.slow)]
)
def test_no_light_leaks_through_a_slope(slope_x: float, slope_y: float):
    """A plane nearly as steep as the steepest ray, sky a thousand times as bright behind it."""
    camera = front_camera()
    left, top, right, bottom = -40, -40, 72, 64
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    disparity = [5.0 + slope_x * (x - 16) + slope_y * (y - 12) for x, y in corners]
    plane = patch("plane", camera, (left, top, right, bottom), disparity)
    lens = wide_lens(camera, pixels_per_dioptre=11.0, focus=5.0)
    layers = peel(
        make_scene([plane], background=constant_background(1000.0), unlit=True), camera, lens, supersampling=2
    )
    picture = np.asarray(render(layers, lens, rays=64))
    # Observed: 0.
    np.testing.assert_allclose(picture, 1.0, atol=1e-5)


def test_the_sky_shows_beside_a_bar():
    """A black bar (of whole samples) in front of a sky in focus hides a strip of the disk of rays."""
    camera = front_camera()
    left, right = 14.5, 17.5
    bar = patch("bar", camera, (left, -60, right, 84), 1.0, 0.0)
    lens = wide_lens(camera, pixels_per_dioptre=6.0, focus=0.0)
    scene = make_scene([bar], background=constant_background(1.0), unlit=True)
    layers = peel(scene, camera, wide_lens(camera), supersampling=2, like=varied_layers())
    picture = np.asarray(render(layers, lens, rays=64))[..., 0]

    def left_of(x: np.ndarray) -> np.ndarray:
        """Share of a disk of radius 6 to the left of x."""
        u = np.clip(x / 6.0, -1.0, 1.0)
        return 0.5 + (u * np.sqrt(1 - u**2) + np.arcsin(u)) / np.pi

    offsets = (np.arange(50) + 0.5) / 50
    films = np.arange(WIDTH)[:, None] + offsets
    expected = 1 - (left_of(right - films) - left_of(left - films)).mean(axis=1)
    assert expected.min() < 0.7
    # Observed: 0.004 over the 24 pixels of a column, 0.054 for one pixel.
    np.testing.assert_allclose(picture.mean(axis=0), expected, atol=0.01)
    assert np.abs(picture - expected).max() < 0.15


def test_colour_is_interpolated():
    """A ramp of colour on a tilted surface in view of a pinhole stays a ramp, without steps of samples."""
    camera = front_camera()
    corners = np.array([(-4.0, -4.0), (36.0, -4.0), (36.0, 28.0), (-4.0, 28.0)])
    points = at_pixels(corners, np.array([0.4, 0.6, 0.7, 0.5]), camera)
    ramp = points @ np.array([[0.1, 0.02, 0.0], [0.0, 0.08, 0.05], [0.01, 0.0, 0.03]]) + 1.0
    surface = make_object("ramp", points, [(0, 1, 2), (0, 2, 3)], vertex_colours=ramp)
    scene = make_scene([surface], unlit=True)
    layers = peel(scene, camera, wide_lens(camera), supersampling=2, like=varied_layers())
    picture = np.asarray(render(layers, ThinLens(jnp.array(0.5), jnp.array(0.0)), rays=64))
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    disparity = 0.4 + 0.005 * (x + 4) + 0.1 / 32 * (y + 4)
    seen = at_pixels(np.stack([x, y], axis=-1).reshape(-1, 2), disparity.reshape(-1), camera)
    expected = seen @ np.array([[0.1, 0.02, 0.0], [0.0, 0.08, 0.05], [0.01, 0.0, 0.03]]) + 1.0
    # Observed: 1.3e-4 where two triangles meet in a sample, 1.1e-5 elsewhere; a sample's step is 8e-3.
    np.testing.assert_allclose(picture.reshape(-1, 3), expected, atol=1e-4)


@pytest.mark.parametrize("pixels", [100, pytest.param(6 * WIDTH * HEIGHT, marks=pytest.mark.slow)])
def test_blocks_do_not_change_the_picture(pixels: int, monkeypatch: pytest.MonkeyPatch):
    """Not even when they do not divide the picture."""
    whole = varied_picture()
    monkeypatch.setattr(_devices, "at_once", lambda **_: 4 * pixels)
    forget_programs()
    # Observed: 2e-16.
    np.testing.assert_allclose(varied_picture(), whole, rtol=1e-12)
    forget_programs()


def test_the_seed_chooses_the_picture():
    first = varied_picture()
    np.testing.assert_array_equal(varied_picture(), first)
    other = varied_picture(seed=1)
    assert np.abs(other - first).max() > 0.01
    assert np.abs(other - first).mean() < 0.02


@pytest.mark.parametrize("rays", [1, 7])
def test_any_number_of_rays(rays: int):
    picture = varied_picture(rays)
    assert np.isfinite(picture).all()
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0 + 1e-6
    # Observed: 0.006 for one ray, 0.001 for seven.
    assert picture.mean() == pytest.approx(varied_picture().mean(), abs=0.01)


def test_a_second_picture_compiles_nothing():
    layers = varied_layers()
    with compilations() as compiled:
        jax.jit(lambda x: x + 41.5)(jnp.zeros(3))
        assert compiled, "compilations are not reported under the expected name"
        varied_picture()
        refocused = ThinLens(layers.lens.focus_disparity * 0.8, layers.lens.aperture_radius)
        compiled.clear()
        render(layers, refocused, rays=16, seed=3)
        assert not compiled


def test_single_precision_gives_the_same_picture():
    # Rounding may give a pixel the next number of rays: that is another picture.
    varied = np.asarray(render(varied_layers(), varied_layers().lens, rays=16, even=True))
    with jax.enable_x64(False):
        camera = front_camera()
        objects = varied_scene()
        lens = wide_lens(camera)
        layers = peel(objects, camera, lens, supersampling=2)
        assert layers.radiance.dtype == jnp.float32
        picture = np.asarray(render(layers, lens, rays=16, even=True))
    assert picture.dtype == np.float32
    difference = np.abs(picture - varied)
    # Observed: 1e-8, 1.7e-5 and 0.13 %. A ray within rounding of an edge may fall on its other side.
    assert np.median(difference) < 1e-6
    assert difference.mean() < 1e-4
    assert (difference > 1e-3).mean() < 0.01


@pytest.mark.parametrize("rays", [0, -4])
def test_no_rays_are_refused(rays: int):
    with pytest.raises(ValueError, match=f"rays is {rays}; expected a whole number, at least 1"):
        varied_picture(rays)


def test_lenses_beyond_the_layers_are_refused():
    layers = varied_layers()
    camera = layers.camera
    with pytest.raises(
        ValueError, match=r"moves rays by 13 pixels per dioptre but the layers were peeled for 12"
    ):
        render(layers, wide_lens(camera, pixels_per_dioptre=13.0))
    with pytest.raises(ValueError, match=r"rays of the lens leave the frame .* peeled for another focus"):
        render(layers, wide_lens(camera, focus=4.0))


def test_another_focus_finds_what_the_first_had_out_of_reach():
    """Beside the frame, where the first lens is focused and sees no farther: the margin holds it."""
    camera = front_camera()
    wall = patch("wall", camera, (-90, -90, 120, 120), 0.1, (0.2, 0.2, 0.6))
    beside = patch("beside", camera, (34, -90, 120, 120), 1.0)
    scene = make_scene([wall, beside], unlit=True)
    near, far = wide_lens(camera, focus=1.0), wide_lens(camera, focus=0.1)
    once, again = (render(peel(scene, camera, lens, supersampling=2), far, rays=64) for lens in (near, far))
    assert float(again[:, -1, 0].min()) > 0.4
    np.testing.assert_allclose(once, again, rtol=0, atol=1e-12)
