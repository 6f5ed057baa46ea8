"""The ray-casting baseline: closed forms, another renderer, refusals."""

import sys

import jax.numpy as jnp
import numpy as np
import pytest
from glossy import glossy_camera, glossy_lens, glossy_scene, ray_by_ray
from reference_scenes import load_reference

from focusjax.baselines import RayCaster, lens_picture
from focusjax.geometry import look_at
from focusjax.lens import ThinLens, thin_lens
from focusjax.metrics import psnr
from focusjax.scene import constant_background, make_object, make_scene

SQUARE = np.array([(-1.0, -1.0, -2.0), (1.0, -1.0, -2.0), (1.0, 1.0, -2.0), (-1.0, 1.0, -2.0)])
FACES = np.array([(0, 1, 2), (0, 2, 3)])


def test_hits_are_exact() -> None:
    caster = RayCaster(SQUARE, FACES)
    origins = np.array([(0.0, 0.0, 0.0), (0.5, 0.25, -3.0), (2.0, 0.0, 0.0)])
    directions = np.array([(0.2, -0.1, -1.0), (0.0, 0.0, 2.0), (0.0, 0.0, -1.0)])
    hits = caster.first_hits(origins, directions)
    assert hits.triangle.tolist() == [0, 0, -1]
    np.testing.assert_allclose(hits.distance, [2.0, 0.5, np.inf], rtol=1e-14)
    corners = SQUARE[FACES[hits.triangle[:2]]]
    met = np.einsum("nk,nkx->nx", hits.barycentric[:2], corners)
    np.testing.assert_allclose(met, origins[:2] + directions[:2] * hits.distance[:2, None], atol=1e-14)


def test_hits_are_exact_far_from_the_origin() -> None:
    # Embree works in single precision: 3e5 m leave it 3 cm. The triangle it names is solved in double.
    place = np.array([3e5, -2e5, 1e5])
    hits = RayCaster(SQUARE + place, FACES).first_hits(place[None], np.array([(0.1, 0.3, -1.0)]))
    np.testing.assert_allclose(hits.distance, [2.0], rtol=1e-9)


def test_square_out_of_focus() -> None:
    """Blur moves its light about: as much arrives, over the square widened by the blur radius."""
    square = make_object("square", SQUARE * (0.2, 0.2, 1.0), FACES, colour=(0, 0, 0), emission=3.0)
    scene = make_scene([square], unlit=True)
    camera = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), width=40, height=40, field_of_view=0.8)
    lens = ThinLens(jnp.array(1.0), jnp.array(0.1))
    light = lens_picture(scene, camera, lens, rays=32)[..., 0]
    side = 0.4 * float(camera.focal_px) / 2.0
    # Observed: within 0.4 %, of 2900 rays that arrive.
    assert light.sum() == pytest.approx(3.0 * side**2, rel=1e-2)
    radius = float(camera.focal_px) * 0.1 * 0.5
    assert light[20, 20] == pytest.approx(3.0)
    reach = side / 2 + radius
    x = np.abs(np.arange(40) + 0.5 - 20)
    assert light[20, x > reach + 0.5].max() == 0.0
    assert light[20, x < reach - 1].min() > 0.0


def test_background_is_seen_where_nothing_is_hit() -> None:
    sky = np.array([0.2, 0.4, 0.9])
    scene = make_scene([make_object("behind", -SQUARE, FACES)], background=constant_background(sky))
    camera = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), width=8, height=6, field_of_view=0.8)
    picture = lens_picture(scene, camera, thin_lens(focus_distance=1.0, aperture_radius=0.1), rays=2)
    np.testing.assert_allclose(picture, np.broadcast_to(sky, (6, 8, 3)), rtol=1e-12)


@pytest.mark.parametrize("view", ["dof_strong_foreground", "dof_infinity"])
def test_agrees_with_mitsuba(view: str) -> None:
    """Means over 8 x 8 pixels, where little noise is left."""
    reference = load_reference("cow_bars")
    ours = lens_picture(reference.scene, reference.camera, reference.lenses[view], rays=16)
    blocks = [p.reshape(24, 8, 32, 8, 3).mean(axis=(1, 3)) for p in (ours, reference.pictures[view])]
    # Observed: 49.3 and 50.8 dB.
    assert psnr(*blocks) > 45.0


def test_each_ray_sees_gloss_from_where_it_starts() -> None:
    """Against the same in plain numpy."""
    ours = lens_picture(glossy_scene(), glossy_camera(), glossy_lens(2.0), rays=64)
    theirs = ray_by_ray(glossy_scene(), glossy_camera(), glossy_lens(2.0), rays=64)
    # Both are noisy: 35.1 dB observed; 14.8 dB baked.
    assert psnr(ours, theirs) > 33.0


def test_same_seed_same_picture() -> None:
    square = make_object("square", SQUARE, FACES, colour=(0, 0, 0), emission=3.0)
    scene = make_scene([square], unlit=True)
    camera = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), width=12, height=12, field_of_view=1.2)
    lens = thin_lens(focus_distance=1.0, aperture_radius=0.2)
    first, again, other = (lens_picture(scene, camera, lens, rays=2, seed=seed) for seed in (0, 0, 1))
    assert (first == again).all()
    assert (first != other).any()


def test_refuses_no_rays() -> None:
    scene = make_scene([make_object("square", SQUARE, FACES)])
    camera = look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]), width=8, height=8, field_of_view=0.8)
    with pytest.raises(ValueError, match="rays is 0; expected a whole number, at least 1"):
        lens_picture(scene, camera, thin_lens(focus_distance=1.0, aperture_radius=0.1), rays=0)


def test_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(ValueError, match=r"needs Embree, which is not installed; run `pip install embreex`"):
        RayCaster(SQUARE, FACES)
