"""Keyframes of the lens: what is keyed, what is free, in which frames, and zooms that hold the frame."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from cards_config import write_cards
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.lens import AberratedLens
from focusjax.shot import build_shot, solve_shot

FIVE = ["shot.frames=5", "lens={f_number=2}", "shot.camera=[]", "shot.objects=[]", "shot.wishes=[]"]


@pytest.fixture(scope="module")
def config_file(tmp_path_factory):
    return write_cards(tmp_path_factory.mktemp("keys"))


def keyed(config_file, *changes):
    return load_config(config_file, [*FIVE, *changes])


def test_every_setting_of_the_lens_may_have_keyframes(config_file):
    """Without wishes nothing is solved for; in the middle, focus is the mean in dioptres, f in stops."""
    first = "frame=1, focus_distance_m=1, f_number=2, tilt_deg=0, swing_deg=4, focal_length_mm=40, rise_mm=0"
    last = "frame=5, focus_distance_m=4, f_number=8, tilt_deg=6, swing_deg=4, focal_length_mm=80, rise_mm=3"
    shot = build_shot(keyed(config_file, "focus=[]", f"shot.lens=[{{{first}}}, {{{last}}}]"))
    found = solve_shot(shot).solution.settings()
    # Eased keyframes are half-way in the middle.
    expected = {"focus_per_m": [1, 0.625, 0.25], "f_number": [2, 4, 8], "focal_length_mm": [40, 60, 80]}
    expected |= {"tilt_deg": [0, 3, 6], "swing_deg": [4, 4, 4]}
    for name, values in expected.items():
        np.testing.assert_allclose(found[name][[0, 2, 4]], values, rtol=1e-5, atol=1e-5)
    rises = [1000 * float(camera.rise) for camera in shot.cameras]
    np.testing.assert_allclose(rises[::2], [0, 1.5, 3], atol=1e-5)


def test_aberrations_have_keyframes_number_by_number(config_file):
    look = "shot.lens=[{frame=1, seidel={w040_px=0}}, {frame=5, seidel={w040_px=8}}]"
    shot = build_shot(keyed(config_file, "focus=[]", "lens.focus_distance_m=2", look))
    assert shot.look is not None
    lenses = [shot.look(number, shot.cameras[0], shot.lenses[0]) for number in (1, 3, 5)]
    assert all(isinstance(lens, AberratedLens) for lens in lenses)
    centre = shot.cameras[0].principal_point
    rim = jnp.array([1.0, 0.0])
    plain, *at = [lens.ray(shot.cameras[0], centre, rim).a[0] for lens in (shot.lenses[0], *lenses)]
    strength = [float(each - plain) for each in at]
    assert strength[0] == pytest.approx(0, abs=1e-5)
    assert abs(strength[2]) > 1
    assert strength[1] == pytest.approx(strength[2] / 2, rel=1e-4)


def test_a_setting_may_be_keyed_in_some_frames_and_free_in_the_others(config_file):
    """Held where it is keyed, and met where it is free, as the free frames alone would have it."""
    wish = "focus=[{point=[-0.2, 0, -1], sharp=true, name='near card'}]"
    keys = "shot.lens=[{frame=1, focus_distance_m=4}, {frame=2, focus_distance_m=2}]"
    smooth = ["shot.smoothness=0", "shot.steadiness=0"]
    free = "shot.free=[{name='focus', from_frame=3}]"
    solved = solve_shot(build_shot(keyed(config_file, wish, keys, free, *smooth)))
    np.testing.assert_allclose(solved.solution.settings()["focus_per_m"], [0.25, 0.5, 1, 1, 1], rtol=1e-5)
    assert solved.diagnosis.active_bounds == {}
    tied = solve_shot(build_shot(keyed(config_file, wish, keys, free)))
    focus = tied.solution.settings()["focus_per_m"]
    np.testing.assert_allclose(focus[:2], [0.25, 0.5], rtol=1e-5)
    # Smoothness holds the first free frame back towards the keyed ones.
    assert 0.5 < focus[2] < 0.99


def test_a_zoom_may_hold_the_frame_or_the_size_of_something(config_file):
    zoom = "shot.lens=[{frame=1, focal_length_mm=40}, {frame=5, focal_length_mm=80}]"
    held = build_shot(keyed(config_file, zoom, "shot.keep_field_of_view=true"))
    pixels = [float(camera.focal_px) for camera in held.cameras]
    np.testing.assert_allclose(pixels, pixels[0], rtol=1e-6)
    back = "shot.camera=[{frame=1, position=[0, 0, 0]}, {frame=5, position=[0, 0, 2]}]"
    dolly = build_shot(keyed(config_file, back, "shot.keep_size_of='near'"))
    for camera in dolly.cameras:
        # The near card at z = -1 keeps its size: focal length over depth stays.
        depth = float(camera.position[2]) + 1.0
        size = float(camera.focal_px) / depth
        assert size == pytest.approx(float(dolly.cameras[0].focal_px), rel=1e-5)
    with pytest.raises(ConfigError, match="is behind the camera, so that it has no size to keep"):
        build_shot(keyed(config_file, back, "shot.keep_size_of=[0, 0, 1]"))


KEY = "shot.lens=[{frame=2, focus_distance_m=3}]"


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ([KEY], "focus has a keyframe at frame 2 and is in solve.free, so that it is keyed and free at once"),
        ([KEY, "shot.free=[{name='focus', to_frame=3}]"], "in which [[shot.free]] has it free (to frame 3)"),
        (["shot.free=[{name='tilt'}]"], "tilt has frames in which it is free, and is not in solve.free"),
        (["shot.free=[{name='focus', from_frame=9}]"], "which is none of the shot's frames 1 to 5"),
        (
            ["shot.free=[{name='focus', from_frame=3}]"],
            "focus is free from frame 3 alone and has no value",
        ),
        (["shot.free=[{name='focus', from_frame=3, to_frame=2}]"], "from_frame = 3 after to_frame = 2"),
        (["shot.lens=[{frame=1}]"], "has nothing at frame 1; give a setting such as focus_distance_m = 2"),
        (["shot.keep_field_of_view=true"], "keep_field_of_view and no keyframes of focal_length_mm"),
        (
            ["shot.lens=[{frame=1, focal_length_mm=40}]", "shot.keep_size_of='near'"],
            "has keep_size_of, which sets the focal length, and keyframes of focal_length_mm in shot.lens",
        ),
        (
            ["shot.lens=[{frame=1, focal_length_mm=40}]", "shot.camera=[{frame=1, focal_length_mm=40}]"],
            "keyframes of focal_length_mm in shot.camera and in shot.lens; give them in one place",
        ),
        (
            ["shot.lens=[{frame=1, power_profile=[0, 1]}, {frame=2, power_profile=[0, 1, 2]}]"],
            "keyframe of power_profile at frame 2 has other rows than the first one",
        ),
        (
            [
                "shot.lens=[{frame=1, seidel={w040_waves=0, f_number=2}},"
                " {frame=2, seidel={w040_um=2, f_number=2}}]"
            ],
            "keyframes of seidel together make a table that has w040_um and w040_waves; give all",
        ),
        (["shot.keep_size_of='nobody'"], "keep_size_of:"),
        (
            ["focus=[]", "shot.lens=[{frame=1, focus_distance_m=1}, {frame=4, focus_distance_m=0.01}]"],
            ": shot: frame 4: focus distance 0.01 m is within the focal length",
        ),
    ],
)
def test_keyframes_that_contradict_are_refused(config_file, overrides, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        build_shot(keyed(config_file, *overrides))


def test_a_shot_by_keyframes_alone_is_rendered(config_file, tmp_path):
    keys = "shot.lens=[{frame=1, focus_distance_m=1}, {frame=5, focus_distance_m=4}]"
    options = [part for change in [*FIVE, "focus=[]", keys] for part in ("--set", change)]
    result = CliRunner().invoke(
        app, ["shot", str(config_file), "--out", str(tmp_path), *options, "--frames", "1"]
    )
    assert result.exit_code == 0, result.output
    assert "5 frames, focus from 1.00 m to 4.00 m by keyframes" in " ".join(result.output.split("\n"))
    assert "all settings by keyframes" in (tmp_path / "report.html").read_text()
