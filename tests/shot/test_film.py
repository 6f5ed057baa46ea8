"""From a config with a shot to frames, a film and a report; and what a config may get wrong."""

import dataclasses
import json
import re
import sys
import tomllib
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from cards_config import CARD, CONFIG, write_cards
from compilations import compilations
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import ConfigError, load_config
from focusjax.io import load_exr
from focusjax.shot import build_settings, build_shot, render_frames, save_mp4, solve_shot
from focusjax.shot._frame_files import write_record


@pytest.fixture(scope="module")
def config_file(tmp_path_factory) -> Path:
    return write_cards(tmp_path_factory.mktemp("shot"))


@pytest.fixture(scope="module")
def filmed(config_file, tmp_path_factory):
    """The output folder of a whole run, and what it said."""
    out = tmp_path_factory.mktemp("out")
    result = CliRunner().invoke(app, ["shot", str(config_file), "--out", str(out)])
    return out, result


def test_a_shot_leaves_frames_and_a_report(filmed):
    out, result = filmed
    assert result.exit_code in (0, 3), result.output
    assert "3 frames, focus from" in result.output
    for number in (1, 2, 3):
        picture = iio.imread(out / "frames" / f"frame_{number:04d}.png")
        assert picture.shape == (24, 33, 3)
        assert picture.std() > 10
        channels = load_exr(out / "frames" / f"frame_{number:04d}.exr")
        assert set(channels) == {"R", "G", "B", "Z", "blur"}
        assert np.isfinite(channels["blur"]).all()
    report = json.loads((out / "report.json").read_text())
    assert [frame["frame"] for frame in report["frames"]] == [1, 2, 3]
    assert report["solver"]["status"] == "solved"
    assert report["pictures"]["kept"] == 0
    assert set(report["largest_changes"]) == {"focus_per_m", "f_number", "focal_length_mm"}
    # What the wishes were in each frame: the blur's keyframes, and who acts when.
    wished = [[wish["wished_px"] for wish in frame["wishes"]] for frame in report["frames"]]
    assert wished == [[0.0, 1.5], [0.0, pytest.approx(2.0)], [0.0, 2.5]]
    acting = [[wish["share"] for wish in frame["wishes"]] for frame in report["frames"]]
    assert acting == [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    page = (out / "report.html").read_text()
    assert "Two cards" in page
    assert page.count("data:image/png;base64,") == 3
    assert (out / "contact.png").is_file()


def test_frames_after_the_first_compile_nothing(config_file, tmp_path):
    """The same shapes in every frame, whatever moves."""
    config = load_config(config_file, ["shot.formats=['png']"])
    solved, settings = solve_shot(build_shot(config)), build_settings(config)
    render_frames(solved, tmp_path, settings, frames=[1, 2])
    with compilations() as compiled:
        render_frames(solved, tmp_path, settings, frames=[3])
    assert compiled == []


def test_frames_that_are_there_are_kept(filmed, config_file):
    """A frame that was lost is made again, the same; other settings make all of them again."""
    out, _ = filmed
    first, lost = (out / "frames" / f"frame_000{number}.png" for number in (1, 2))
    before, made = lost.read_bytes(), first.stat().st_mtime_ns
    lost.unlink()
    CliRunner().invoke(app, ["shot", str(config_file), "--out", str(out)])
    assert json.loads((out / "report.json").read_text())["pictures"]["kept"] == 2
    assert lost.read_bytes() == before
    assert first.stat().st_mtime_ns == made
    brighter = ["--set", "render.exposure=1", "--frames", "1"]
    CliRunner().invoke(app, ["shot", str(config_file), "--out", str(out), *brighter])
    assert json.loads((out / "report.json").read_text())["pictures"] == {
        "frames": [1], "kept": 0, "rays_per_pixel": 4, "layers_complete": True,
        "layers_left_out": None,
    }  # fmt: skip
    assert iio.imread(first).mean() > iio.imread(lost).mean() + 20


def test_a_frame_of_a_run_that_was_killed_is_made_again(config_file, tmp_path):
    """It was replaced, and its record did not say so yet: it does not pass for what was there before."""
    config = load_config(config_file, ["shot.formats=['png']"])
    solved, settings = solve_shot(build_shot(config)), build_settings(config)
    render_frames(solved, tmp_path, settings, frames=[1])
    frame = tmp_path / "frame_0001.png"
    before = frame.read_bytes()

    def killed(folder, name, record):
        if record.marks:
            raise KeyboardInterrupt
        write_record(folder, name, record)

    brighter = dataclasses.replace(settings, exposure=1.0)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("focusjax.shot._frame.write_record", killed)
        with pytest.raises(KeyboardInterrupt):
            render_frames(solved, tmp_path, brighter, frames=[1])
    assert frame.read_bytes() != before
    assert render_frames(solved, tmp_path, settings, frames=[1]).kept == 0
    assert frame.read_bytes() == before


def test_files_of_a_kind_that_was_left_out_meanwhile_are_made_again(filmed, config_file, tmp_path):
    """A frame's OpenEXR file is not taken for new because its PNG file is."""
    noise = ["--set", "render.seed=5"]
    command = ["shot", str(config_file), "--out", str(tmp_path), "--frames", "1"]
    formats = {name: ["--set", f"shot.formats={name}"] for name in ("['png','exr']", "['png']")}
    both, png = formats.values()
    for options in (both, [*png, *noise], [*both, *noise]):
        assert CliRunner().invoke(app, [*command, *options]).exit_code in (0, 3)
    before, after = (load_exr(out / "frames" / "frame_0001.exr")["G"] for out in (filmed[0], tmp_path))
    assert np.abs(after - before).max() > 0.0


def test_frames_are_exposed_and_developed_alike(filmed, config_file, tmp_path):
    taken = ["exposure.luminance_cd_m2=20", "exposure.time=1/60"]
    options = ["--frames", "1", "--out", str(tmp_path), *(part for key in taken for part in ("--set", key))]
    result = CliRunner().invoke(app, ["shot", str(config_file), *options])
    assert result.exit_code == 2
    assert "give exposure.iso, instead of having them chosen" in " ".join(result.output.split())
    options += ["--set", "film.preset=black_and_white", "--set", "exposure.iso=100"]
    result = CliRunner().invoke(app, ["shot", str(config_file), *options])
    assert result.exit_code in (0, 3), result.output
    names = [folder / "frames" / "frame_0001" for folder in (filmed[0], tmp_path)]
    coloured, grey = (iio.imread(name.with_suffix(".png")).astype(int) for name in names)
    assert np.ptp(grey, axis=-1).max() <= 1 < np.ptp(coloured, axis=-1).max()
    assert grey.std() > 10
    before, after = (load_exr(name.with_suffix(".exr"))["G"] for name in names)
    np.testing.assert_array_equal(before, after)


def test_frames_make_one_long_exposure(filmed, config_file, tmp_path):
    """Of those that are asked for, each with rays of its own; they are kept for the next time."""
    options = ["--out", str(tmp_path), "--set", "shot.long_exposure=true", "--set", "shot.formats=['png']"]
    for frames, kept in (([1, 2], 0), ([1, 2, 3, 3], 2)):
        chosen = ["--frames", ",".join(map(str, frames))]
        result = CliRunner().invoke(app, ["shot", str(config_file), *options, *chosen])
        assert result.exit_code in (0, 3), result.output
        pictures = json.loads((tmp_path / "report.json").read_text())["pictures"]
        assert (pictures["kept"], pictures["long_exposure_frames"]) == (kept, len(set(frames)))
        singles = [load_exr(tmp_path / "frames" / f"frame_{number:04d}.exr") for number in set(frames)]
        together = load_exr(tmp_path / "long_exposure.exr")
        for name in "RGB":
            # Rounding, of single precision.
            np.testing.assert_allclose(
                together[name], np.mean([one[name] for one in singles], axis=0), atol=1e-6
            )
    assert iio.imread(tmp_path / "long_exposure.png").shape == (24, 33, 3)
    assert (tmp_path / "report.html").read_text().count("data:image/png;base64,") == 4
    usual, own = (load_exr(out / "frames" / "frame_0001.exr")["R"] for out in (filmed[0], tmp_path))
    assert np.abs(usual - own).max() > 0.0


def test_frames_taken_with_a_shutter_are_blurred_by_motion(filmed, config_file, tmp_path):
    """The far card and the camera move between frames; with 180 degrees, half of that way is seen."""
    options = ["--out", str(tmp_path), "--frames", "2", "--set", "shutter.angle_deg=180"]
    result = CliRunner().invoke(app, ["shot", str(config_file), *options])
    assert result.exit_code in (0, 3), result.output
    report = json.loads((tmp_path / "report.json").read_text())
    # The card goes up by 0.1 m a frame, 4 m away, where 45.3 px are 1 m ahead: eased, by 1.5 times at its
    # fastest; from its edges, which are scaled as well, it is 0.9 px.
    assert 0.3 < report["pictures"]["largest_motion_px"] < 1.5
    assert report["pictures"]["shutter_spans"] == 1
    sharp, blurred = (load_exr(out / "frames" / "frame_0002.exr")["G"] for out in (filmed[0], tmp_path))
    assert 0.0 < np.abs(sharp - blurred).max() < 0.5
    kept = CliRunner().invoke(app, ["shot", str(config_file), *options])
    assert kept.exit_code in (0, 3)
    assert json.loads((tmp_path / "report.json").read_text())["pictures"]["kept"] == 1


def test_frames_may_be_blurred_from_one_sharp_view(config_file, tmp_path):
    """By defocus and motion, both less than they are wide, as traced but for what only tracing sees."""
    pictures = {}
    for method, rays in (("post", 32), ("trace", 64)):
        out = tmp_path / method
        options = ["--set", f"render.method={method}", "--set", f"render.rays={rays}", "--frames", "2"]
        options += ["--set", "render.supersampling=2", "--set", "shutter.angle_deg=360"]
        command = ["shot", str(config_file), "--out", str(out), *options]
        result = CliRunner().invoke(app, command)
        assert result.exit_code in (0, 3), result.output
        pictures[method] = load_exr(out / "frames" / "frame_0002.exr")
        motion = json.loads((out / "report.json").read_text())["pictures"]["largest_motion_px"]
        # The card that moves by itself goes up while the camera slides.
        assert motion > 0.5
    apart = np.stack([pictures["post"][name] - pictures["trace"][name] for name in "RGB"])
    # Observed: 0.0034.
    assert np.sqrt(np.mean(apart**2)) < 0.015
    slow = ["render.method=post", "shutter.angle_deg=180", "shutter.ramp=0.2"]
    with pytest.raises(ConfigError, match="opens slowly, which post-processing does not know; leave out"):
        build_settings(load_config(config_file, slow))
    with pytest.raises(
        ConfigError, match=r"has a \[shot\] and render.method = 'auto', but frames of a shot are"
    ):
        load_config(config_file, ["render={method = 'auto', quality = 'draft'}"])


def test_a_shutter_and_an_exposure_have_one_time(config_file):
    lit = ["exposure.luminance_cd_m2=20", "exposure.iso=100"]
    config = load_config(config_file, [*lit, "shutter.angle_deg=180"])
    assert config.exposure.time == pytest.approx(1 / 48) == pytest.approx(config.shutter_seconds)
    config = load_config(config_file, [*lit, "exposure.time=1/50", "shutter.ramp=0.2"])
    assert config.shutter_seconds == pytest.approx(0.02)
    motion = build_settings(config).motion
    assert motion.shutter.open_time == pytest.approx(0.024, rel=1e-3)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["shutter.time=0"],
            "shutter.time is 0; expected a number above 0; give the shutter time in seconds",
        ),
        (["shutter.time=inf"], "shutter.time is Infinity; expected a finite number; give the shutter time"),
        (
            ["shutter.time=1/50", "shutter.angle_deg=180"],
            "shutter has time and angle_deg, two times of one shutter",
        ),
        (
            ["shutter.ramp=0.2"],
            "has a [shutter] of no time; give it a time or an angle_deg, or [exposure] a time",
        ),
        (["shutter.curve=[0, 0]", "shutter.time=1"], "shutter has a curve that lets no light through"),
        (["shutter.angle_deg=400"], "shutter.angle_deg is 400; expected a number of at most 360"),
        (
            ["shutter.time=1/50", "exposure.luminance_cd_m2=20", "exposure.time=1/60"],
            "has exposure.time = 0.0166667 s and a [shutter] open for 0.02 s; leave one of the two out",
        ),
    ],
)
def test_what_a_shutter_gets_wrong_is_reported(config_file, overrides, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        load_config(config_file, overrides)


# imageio's reader leaves the pipes to its ffmpeg for the garbage collector to close.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_film_is_of_even_size_and_shows_the_frames(tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="the extra `video` is not installed")
    pictures = []
    for level in (40, 220):
        pictures.append(tmp_path / f"{level}.png")
        iio.imwrite(pictures[-1], np.full((25, 33, 3), level, dtype=np.uint8))
    save_mp4(tmp_path / "film.mp4", pictures, fps=24)
    found = iio.imread(tmp_path / "film.mp4", plugin="FFMPEG")
    assert found.shape == (2, 26, 34, 3)
    # Compressed; observed within 1 of 255.
    assert np.abs(found.mean(axis=(1, 2, 3)) - [40, 220]).max() < 4


def test_a_film_without_ffmpeg_is_refused_before_anything_is_done(config_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    options = ["--out", str(tmp_path / "new"), "--set", "shot.formats=['mp4']"]
    result = CliRunner().invoke(app, ["shot", str(config_file), *options])
    assert result.exit_code == 1
    message = " ".join(result.output.split())
    assert "an mp4 needs the package imageio-ffmpeg, which is not installed; run `pip install" in message
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "shot.wishes.0.name=near crd",
            "shot: wishes: [[focus]] has no 'near crd'; did you mean 'near card'?",
        ),
        ("shot.objects.0.name=fir", "shot: objects: the scene has no 'fir'; did you mean 'far'?"),
        ("shot.objects.0.vertices='walk.npz'", "walk.npz does not exist; check the path"),
        ("shot.camera.1.frame=1", "shot has a keyframe of the camera at frame 1 after one at frame 1; put"),
        ("shot.objects.0.keys.1.frame=-3", "has a keyframe of 'far' at frame -3 after one at frame 1; put"),
        ("shot.wishes.1.to_frame=1", "has from_frame = 2 after to_frame = 1; swap the two"),
        ("shot.camera.0.matrix=[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "give all of one kind"),
        ("shot.frames=0", "shot.frames is 0; expected a number of at least 1; give the number of frames"),
        ("shot.wishes.0.keys=[{frame=1, blur=2}]", "has a blur over time but wishes for no blur"),
        ("shot.lens=[{frame=1, f_number=2}]", "aperture_radius_mm and keyframes of its f-number"),
        ("shot.objects.0.first_frame=3", "has first_frame or frames_per_step without vertices; remove them"),
    ],
)
def test_what_a_config_gets_wrong_is_reported(config_file, override, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        build_shot(load_config(config_file, [override]))


def test_commands_that_cannot_be_done_are_refused(config_file, tmp_path):
    still = tmp_path / "still.toml"
    still.write_text(CONFIG[: CONFIG.index("[shot]")])
    for path, options, status, message in (
        (still, [], 2, "there is no [shot] table; add one with frames = 48"),
        (config_file, ["--frames", "1,x"], 2, "--frames is 1,x; expected frame numbers such as 1,24,48"),
        (config_file, ["--frames", "4"], 1, "frame 4 is not in the shot; it has frames 1 to 3"),
    ):
        result = CliRunner().invoke(app, ["shot", str(path), "--out", str(tmp_path / "out"), *options])
        assert result.exit_code == status, result.output
        assert message in " ".join(result.output.split())


def test_the_shipped_shots_are_of_48_frames_and_more():
    for name in ("rack_focus", "follow_focus"):
        path = Path(__file__).parents[2] / "configs" / f"{name}.toml"
        assert tomllib.loads(path.read_text())["shot"]["frames"] >= 48


def test_a_deforming_mesh_is_followed_from_a_config(config_file):
    """The near card comes nearer by numbered meshes; the wish is on one of its triangles."""
    folder = config_file.parent
    for step, depth in enumerate((-1.0, -0.9, -0.8), start=1):
        (folder / f"walk_{step:04d}.ply").write_text(CARD.format(-0.6, -0.3, 0.0, 0.3, depth))
    wish = "focus=[{object='near', triangle=0, barycentric=[0.2, 0.5, 0.3], sharp=true, name='near card'}]"
    changes = [wish, "shot.wishes=[]", "shot.objects=[{name='near', vertices='walk_####.ply'}]"]
    still = ["shot.camera=[]", "shot.smoothness=0", "shot.steadiness=0"]
    solved = solve_shot(build_shot(load_config(config_file, [*changes, *still])))
    # Observed: 1e-7.
    np.testing.assert_allclose(1 / solved.solution.settings()["focus_per_m"], [1.0, 0.9, 0.8], rtol=1e-5)
    assert solved.diagnosis.sentences == ()


def test_keyframes_outside_the_shot_are_reported(config_file):
    with pytest.warns(
        UserWarning, match=r"shot\.camera has a keyframe at frame 9, outside the shot's frames 1 to"
    ):
        build_shot(load_config(config_file, ["shot.camera.1.frame=9"]))
    with pytest.warns(UserWarning, match=r"shot\.wishes \(far\) has keyframes at frames 0 and 7, outside"):
        build_shot(
            load_config(
                config_file,
                ["shot.wishes.1.keys.0.frame=0", "shot.wishes.1.keys.1.frame=7"],
            )
        )


def test_what_is_refused_names_file_and_key(config_file, tmp_path):
    options = ["--solve-only", "--out", str(tmp_path), "--set", "solve.min_focus_distance_m=0.001"]
    result = CliRunner().invoke(app, ["shot", str(config_file), *options])
    assert result.exit_code == 2, result.output
    assert "cards.toml: solve.min_focus_distance_m: minimum focus distance in metres is 0.001" in " ".join(
        result.output.split()
    )
