"""Missed light where it is known: none where all is kept, and a closed form at one straight edge."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers, varied_scene, wide_lens

from focusjax.baselines import nearest_in_scene
from focusjax.geometry import Camera, LensRay
from focusjax.layers import decompose, missed_light, peel
from focusjax.lens import AbstractLens, ThinLens
from focusjax.scene import Scene, make_scene
from focusjax.trace import nearest_in_layers

PARALLAX, NEAR, FAR, EDGE = 12.0, 1.0, 0.5, 16.0


class HalfOpen(AbstractLens):
    """A thin lens through whose left half no light comes."""

    lens: ThinLens

    def opening(self):
        return self.lens.opening()

    def ray(self, camera: Camera, film_point, pupil_point) -> LensRay:
        ray = self.lens.ray(camera, film_point, pupil_point)
        return eqx.tree_at(lambda r: r.weight, ray, jnp.where(pupil_point[0] > 0, ray.weight, 0.0))

    def blur(self, camera, film_point, disparity):
        return self.lens.blur(camera, film_point, disparity)

    def footprint(self, camera, film_point, disparity):
        return self.lens.footprint(camera, film_point, disparity)

    def reach(self, camera, disparity):
        return self.lens.reach(camera, disparity)

    def parallax(self, camera):
        return self.lens.parallax(camera)


def straight_edge() -> tuple[Scene, Camera, ThinLens]:
    """A wall in focus; half of it hidden by a screen whose edge is upright."""
    camera = front_camera()
    screen = patch("screen", camera, (-100, -100, EDGE, 100), NEAR)
    wall = patch("wall", camera, (-100, -100, 200, 200), FAR)
    return make_scene([screen, wall], unlit=True), camera, wide_lens(camera, focus=FAR)


def seen_around_the_edge(border: float) -> float:
    """Share of the rays of the frame that pass the edge and meet the wall over `border` pixels behind it.

    A ray of film point x leaves it by R v_x at the screen, R = f E (NEAR - FAR), and by nothing at the wall.
    At t = EDGE - x > 0 it passes with the probability F(t / R), F(u) = (arccos u - u sqrt(1 - u^2)) / pi,
    the share of the disk beyond a chord. The integral of F from a to 1 is in closed form.
    """
    reach = PARALLAX * (NEAR - FAR)
    a = border / reach
    rest = math.sqrt(1 - a * a)
    return reach / 32 * (rest - a * math.acos(a) - rest**3 / 3) / math.pi


@pytest.mark.parametrize("supersampling", [1, 2])
def test_one_layer_misses_what_is_seen_around_an_edge(supersampling: int):
    scene, camera, lens = straight_edge()
    truth = nearest_in_scene(scene, camera)
    expected = seen_around_the_edge(1.0 / supersampling)
    for layers in (
        peel(scene, camera, lens, supersampling=supersampling, max_layers=1),
        decompose(scene, camera, lens, supersampling=supersampling, count=1),
    ):
        missed = missed_light(layers, truth)
        assert missed.rays == 1 << 17
        # Observed: within 1.5 standard errors, of 5e-4 at a share of 0.02.
        assert abs(missed.share - expected) < 4 * missed.standard_error
        assert missed.standard_error < 0.05 * expected


def test_rays_count_by_their_weight():
    """Only rays through the right half pass the edge, so without the others the share is twice as large."""
    scene, camera, lens = straight_edge()
    layers = peel(scene, camera, lens, max_layers=1, supersampling=1)
    missed = missed_light(layers, nearest_in_scene(scene, camera), lens=HalfOpen(lens))
    assert abs(missed.share - 2 * seen_around_the_edge(1.0)) < 4 * missed.standard_error


def test_nothing_is_missed_where_all_is_kept():
    """By peeling, with the umbra or without, and by slabs enough."""
    scene, camera, lens = varied_scene(), front_camera(), varied_layers().lens
    truth = nearest_in_scene(scene, camera)
    plain = peel(scene, camera, lens, umbra=False, max_layers=12)
    for layers in (varied_layers(), plain, decompose(scene, camera, lens, count=64)):
        assert layers.complete
        missed = missed_light(layers, truth)
        # Observed: none.
        assert missed.share < 1e-4
        assert missed.standard_error > 0


def test_fewer_layers_miss_more():
    scene, camera, lens = varied_scene(), front_camera(), varied_layers().lens
    truth = nearest_in_scene(scene, camera)
    shares = [
        missed_light(peel(scene, camera, lens, max_layers=n), truth, rays=20000).share for n in (1, 2, 3)
    ]
    assert shares[0] > shares[1] > shares[2]


def test_plain_layers_find_what_the_ray_cast_finds():
    scene, camera, lens = varied_scene(), front_camera(), varied_layers().lens
    plain = peel(scene, camera, lens, supersampling=2, umbra=False, max_layers=12)
    assert missed_light(plain, nearest_in_layers(plain)).share == 0.0
    layers = peel(scene, camera, lens, supersampling=2, max_layers=1)
    cast = missed_light(layers, nearest_in_scene(scene, camera))
    traced = missed_light(layers, nearest_in_layers(plain))
    # Observed: 0.0359 against 0.0395, as the walk knows where a ray is to half a sample.
    assert traced.share == pytest.approx(cast.share, rel=0.15)


def test_the_standard_error_is_that_of_repeated_estimates():
    scene, camera, lens = straight_edge()
    layers, truth = peel(scene, camera, lens, max_layers=1), nearest_in_scene(scene, camera)
    estimates = [missed_light(layers, truth, rays=2000, seed=seed) for seed in range(40)]
    scatter = np.std([each.share for each in estimates], ddof=1)
    # The deviation of 40 draws is itself uncertain by a ninth.
    assert scatter == pytest.approx(np.mean([each.standard_error for each in estimates]), rel=0.35)


def test_a_seed_gives_the_same_rays():
    scene, camera, lens = straight_edge()
    layers, truth = peel(scene, camera, lens, max_layers=1), nearest_in_scene(scene, camera)
    once, again, other = (missed_light(layers, truth, rays=3000, seed=seed) for seed in (0, 0, 1))
    assert once == again
    assert once != other


def test_no_rays_are_refused():
    with pytest.raises(ValueError, match="rays is 0; expected a whole number, at least 1"):
        missed_light(varied_layers(), nearest_in_layers(varied_layers()), rays=0)
