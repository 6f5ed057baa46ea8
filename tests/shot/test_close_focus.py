"""Shots with a model of close focus: every frame has the lens and the framing of a still focused there."""

import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest
from cards_config import CONFIG, write_cards

from focusjax.config import ConfigError, load_config
from focusjax.job import run
from focusjax.lens import at_image_distance
from focusjax.motion import solved_path
from focusjax.shot import build_shot, solve_shot
from focusjax.shot._frame import camera_while

FIVE = ["shot.frames=5", "lens={f_number=2}", "shot.camera=[]", "shot.objects=[]", "shot.wishes=[]"]
KEYS = "shot.lens=[{frame=1, focus_distance_m=4}, {frame=5, focus_distance_m=0.2}]"


@pytest.fixture(scope="module")
def config_file(tmp_path_factory):
    return write_cards(tmp_path_factory.mktemp("near"))


def solved_shot(config_file, *changes):
    return solve_shot(build_shot(load_config(config_file, [*FIVE, *changes])))


@pytest.mark.parametrize("model", ["framing", "breathing"])
def test_keyed_frames_are_as_stills(config_file, model):
    near = f"lens.close_focus={model}"
    still_file = config_file.with_name("still.toml")
    still_file.write_text(CONFIG[: CONFIG.index("[shot]")])
    shot = solved_shot(config_file, near, "focus=[]", KEYS)
    found = shot.solution.settings()
    for frame in (1, 3, 5):
        distance = 1 / found["focus_per_m"][frame - 1]
        still = run(
            load_config(still_file, [*FIVE[1:2], near, "focus=[]", f"lens.focus_distance_m={distance}"]),
            solving=False,
            rendering=False,
        )
        camera, lens = shot.seen_with(frame)
        assert float(camera.focal_length) == pytest.approx(float(still.camera.focal_length), rel=1e-6)
        assert float(lens.aperture_radius) == pytest.approx(float(still.lens.aperture_radius), rel=1e-6)
        assert found["f_number"][frame - 1] == pytest.approx(2.0, rel=1e-6)
        settings = still.settings
        assert found["focal_length_mm"][frame - 1] == pytest.approx(
            1000 * float(settings.focal_length), rel=1e-6
        )
        assert found["image_distance_mm"][frame - 1] == pytest.approx(
            1000 * float(settings.image_distance), rel=1e-6
        )
        # While the shutter is open the framing stays that of the frame's focus.
        later = camera_while(shot, frame)(frame + 0.3)
        assert float(later.focal_length) == pytest.approx(float(camera.focal_length), rel=1e-6)


def test_a_zoom_while_the_shutter_is_open_has_its_own_image_distances(config_file):
    """1 / s = 1 / F - 1 / d, at every focal length, of what is in focus at the frame."""
    zoom = "shot.lens=[{frame=1, focal_length_mm=40}, {frame=5, focal_length_mm=80}]"
    sets = ["focus=[]", "lens.focus_distance_m=0.3", zoom, "shot.between='linear'"]
    shot = solved_shot(config_file, "lens.close_focus=breathing", *sets)
    for time in (2.0, 2.4, 2.8):
        length = 0.04 + 0.01 * (time - 1.0)
        image = float(camera_while(shot, 2)(time).focal_length)
        assert image == pytest.approx(1 / (1 / length - 1 / 0.3), rel=1e-6)
    camera = shot.shot.cameras[0]
    near = at_image_distance(camera, jnp.asarray(1 / 0.06), "breathing")
    zooming = solved_path(
        lambda t: dataclasses.replace(camera, focal_length=jnp.asarray(0.04 * t)), 1.0, near, breathes=True
    )
    with pytest.raises(ValueError, match=r"the focal length of 64 mm reaches the focus distance, 60 mm"):
        zooming(1.6)


def test_wishes_over_time_are_met_where_the_picture_grows(config_file):
    """One card comes into focus after the other; what is nearer is larger, by s / F."""
    wishes = [
        "focus=[{name='near', point=[-0.2, 0, -1], sharp=true},"
        " {name='far', point=[0.2, 0, -2], sharp=true}]",
        "shot.wishes=[{name='near', to_frame=2}, {name='far', from_frame=4}]",
    ]
    smooth = ["shot.smoothness=0", "shot.steadiness=0.01", "shot.fade_frames=0"]
    shot = solved_shot(config_file, *FIVE[:4], *wishes, *smooth, "lens.close_focus=breathing")
    found = shot.solution.settings()
    np.testing.assert_allclose(found["focus_per_m"][[0, 4]], [1.0, 0.5], rtol=1e-2)
    length = found["focal_length_mm"] / 1000
    np.testing.assert_allclose(
        found["image_distance_mm"] / 1000, length / (1 - length * found["focus_per_m"]), rtol=1e-6
    )
    assert not shot.missed()
    # Where the wishes are is where the frame's own camera shows them.
    for frame, name, point in ((1, "near", (-0.2, 0.0, -1.0)), (5, "far", (0.2, 0.0, -2.0))):
        camera, _ = shot.seen_with(frame)
        (row,) = [each for each in shot.solution.table(frame - 1) if each.name == name]
        np.testing.assert_allclose(row.xy, camera.project(jnp.array(point))[0], atol=0.02)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            "{frame=2, tilt_deg=3}",
            "a keyframe at frame 2 of tilt_deg, with which the image distance is another",
        ),
        ("{frame=2, seidel={w040_um=1, f_number=2}}", "at frame 2 of Seidel coefficients of a wavefront"),
        (
            "{frame=2, colour={glass={name='N-BK7'}}}",
            "at frame 2 of colour.glass, which is for one focal length",
        ),
    ],
)
def test_keyframes_of_what_it_is_not_for_are_refused(config_file, keys, message):
    sets = ["lens.close_focus=framing", "focus=[]", "lens.focus_distance_m=1", f"shot.lens=[{keys}]"]
    with pytest.raises(ConfigError, match=re.escape(message)):
        build_shot(load_config(config_file, [*FIVE, *sets]))


def test_a_size_that_is_kept_does_not_breathe(config_file):
    back = ["shot.camera=[{frame=1, position=[0, 0, 0]}, {frame=5, position=[0, 0, 2]}]", "focus=[]"]
    sets = [*FIVE[:2], *back, "lens.focus_distance_m=1", "shot.keep_size_of='near'"]
    with pytest.raises(ConfigError, match=r"'breathing' and shot\.keep_size_of, whose size the focus would"):
        load_config(config_file, [*sets, "lens.close_focus=breathing"])
    zoom = [*sets[:-1], "shot.lens=[{frame=1, focal_length_mm=40}]", "shot.keep_field_of_view=true"]
    with pytest.raises(ConfigError, match=r"'breathing' and shot\.keep_field_of_view, which the focus would"):
        load_config(config_file, [*zoom, "lens.close_focus=breathing"])
