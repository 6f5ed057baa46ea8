"""Mitsuba loads what is written, and sends the rays that we send."""

import numpy as np
import pytest
from exchange_cameras import HEIGHT, WIDTH, projected, round_lens, slid_camera
from small_scenes import front_camera, patch

import focusjax as fj
from focusjax.baselines import load_unlit, unlit_scene
from focusjax.exchange import mitsuba_dict, record_of
from focusjax.metrics import psnr
from focusjax.scene import constant_background, make_object, make_scene

mi = pytest.importorskip("mitsuba", reason="Mitsuba is not installed")


@pytest.fixture(scope="module", autouse=True)
def variant():
    mi.set_variant("scalar_rgb")


def loaded(path):
    return mi.load_file(str(path)).sensors()[0]


def made(camera, lens, tmp_path):
    """The same sensor from the file and from the dict."""
    fj.export_camera(camera, lens, tmp_path / "c.xml", to="mitsuba")
    return loaded(tmp_path / "c.xml"), mi.load_dict(mitsuba_dict(record_of(camera, lens), mi))


def test_rays_meet_in_the_plane_in_focus(tmp_path):
    camera, lens = slid_camera(), round_lens()
    rng = np.random.default_rng(0)
    for sensor in made(camera, lens, tmp_path):
        assert tuple(sensor.film().crop_size()) == (WIDTH, HEIGHT)
        for _ in range(10):
            place, pupil = rng.uniform(size=2), rng.uniform(size=2)
            ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(*place), mi.Point2f(*pupil))
            origin, direction = np.array(ray.o), np.array(ray.d)
            turned = np.asarray(camera.world_from_camera)[:3, :3].T
            inside = turned @ (origin - np.asarray(camera.position))
            towards = turned @ direction
            # The origin is moved along the ray to the near plane; back to the lens.
            at_lens = inside - towards * inside[2] / towards[2]
            assert np.hypot(*at_lens[:2]) <= 0.05 / 3.6 * (1 + 1e-4)
            in_focus = at_lens - towards * 1.3 / towards[2]
            world = np.asarray(camera.position) + turned.T @ in_focus
            # Observed 1e-4 px, of single precision.
            np.testing.assert_allclose(projected(camera, [world])[0], place * (WIDTH, HEIGHT), atol=2e-3)


def test_a_pinhole_is_a_perspective_sensor(tmp_path):
    lens = fj.thin_lens(focus_distance=2.0, aperture_radius=0.0)
    camera = slid_camera()
    for sensor in made(camera, lens, tmp_path):
        ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(0.25, 0.75), mi.Point2f(0.1, 0.9))
        world = np.array(ray.o) + np.array(ray.d)
        np.testing.assert_allclose(projected(camera, [world])[0], (20, 45), atol=2e-3)


def card(camera, name, box, disparity, colour):
    """A patch whose vertices have the colour, as the baseline takes it."""
    shape = patch(name, camera, box, disparity)
    return make_object(name, shape.vertices, shape.faces, vertex_colours=np.tile(colour, (4, 1)))


def test_the_picture_is_ours(tmp_path):
    camera = front_camera()
    near = card(camera, "near", (6, 5, 16, 15), 1.2, (0.9, 0.4, 0.1))
    wall = card(camera, "wall", (2, 2, 18, 14), 0.5, (0.1, 0.5, 0.7))
    scene = make_scene([near, wall], background=constant_background(0.2), unlit=True)
    lens = fj.thin_lens(focus_distance=2.0, aperture_radius=0.02)
    ours = fj.render(fj.peel(scene, camera, lens, supersampling=2), lens, rays=256)
    fj.export_camera(camera, lens, tmp_path / "c.xml", to="mitsuba")
    plain = load_unlit(unlit_scene(scene), "scalar_rgb")
    seen = mi.render(plain, sensor=loaded(tmp_path / "c.xml"), integrator=plain.integrator(), spp=256)
    theirs = np.array(seen)[..., -3:] + 0.2
    # Observed: see the assertion's message; Mitsuba's own noise is most of it.
    assert psnr(np.asarray(ours), theirs) > 40.0


def test_frames_of_a_shot_are_files(tmp_path):
    lenses = [round_lens(), round_lens(focus_distance=2.0)]
    exported = fj.export_camera([slid_camera()] * 2, lenses, tmp_path / "c.xml", to="mitsuba")
    assert [file.name for file in exported.files] == ["c.0001.xml", "c.0002.xml"]
    distances = [mi.traverse(loaded(file))["focus_distance"] for file in exported.files]
    assert distances == pytest.approx([1.3, 2.0])
