"""The command line from outside: files, exit statuses, and the sentence for everything that goes wrong."""

import codecs
import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
import typer.main
from boxes_config import CONFIG, write_boxes
from complaints import complaints_in
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import load_config
from focusjax.io import load_exr

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def scene_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    write_boxes(folder)
    return folder


def focusjax(*arguments):
    """The exit status, what was printed to stdout, and to stderr beside the progress."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], env={"COLUMNS": "200"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, complaints_in(result.stderr)


@pytest.fixture(scope="module")
def finished(scene_folder):
    """One complete run: its folder and what it printed."""
    folder = scene_folder / "finished"
    status, printed, complaints = focusjax("run", scene_folder / "boxes.toml", "--out", folder)
    assert (status, complaints) == (0, "")
    return folder, printed


def test_a_run_leaves_all_its_files(finished):
    folder, printed = finished
    names = ["blur.png", "image.exr", "image.png", "pinhole.png", "report.html", "report.json"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert iio.imread(folder / "image.png").shape == (30, 40, 3)
    assert "box's front" in printed
    assert str(folder / "report.html") in printed.replace("\n", "")


def test_the_exr_holds_radiance_depth_and_blur(finished):
    folder, _ = finished
    channels = load_exr(folder / "image.exr")
    assert set(channels) == {"R", "G", "B", "Z", "blur"}
    # Emission above 1 survives; the near box's front is 1.75 m away and in focus.
    assert channels["R"].max() > 2.0
    front = channels["Z"][15, 8]
    np.testing.assert_allclose(front, 1.75, rtol=1e-5)  # observed 1e-7
    # The other wish pulls the focus off it by a trace.
    np.testing.assert_allclose(channels["blur"][15, 8], 0.0, atol=1e-3)  # observed 1.2e-4
    assert np.isinf(channels["Z"][0, 0])


def test_the_report_in_numbers(finished):
    report = json.loads((finished[0] / "report.json").read_text())
    assert report["lens"]["focus_distance_m"] == pytest.approx(1.75, rel=1e-4)
    assert report["lens"]["solved"]
    assert report["solver"]["status"] == "solved"
    assert report["solver"]["steps"] >= 0
    assert report["solver"]["active_bounds"] == []
    assert [wish["name"] for wish in report["wishes"]] == ["box's front", "far box"]
    assert all(wish["met"] for wish in report["wishes"])
    assert report["picture"]["layers_complete"]
    assert report["picture"]["layer_samples"] > 0
    # Observed: 0.43. A sample has a colour, and where it is, in at least 8 bytes.
    assert report["picture"]["layers_mib"] * 2**20 > 8 * report["picture"]["layer_samples"]
    assert report["picture"]["rays_per_pixel"] == 4
    assert report["config"]["solve"]["max_focus_distance_m"] == "inf"
    stages = {"load", "locate", "solve", "peel", "render", "pinhole", "compile"}
    assert set(report["seconds"]) == stages
    assert {"python", "focusjax", "jax", "equinox"} <= set(report["versions"])


def test_the_page_stands_alone_and_escapes_names(finished):
    page = (finished[0] / "report.html").read_text()
    assert "Two &lt;boxes&gt;" in page
    assert "box&#39;s front" in page
    assert page.count("data:image/png;base64,") == 3
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "Focus distance" in page
    assert "1.75 m" in page


def test_solve_makes_no_picture(scene_folder, tmp_path):
    status, _, _ = focusjax("solve", scene_folder / "boxes.toml", "--out", tmp_path / "out")
    assert status == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["blur.png", "report.html", "report.json"]


def test_render_takes_the_lens_as_it_is(scene_folder, tmp_path):
    status, _, _ = focusjax(
        "render", scene_folder / "boxes.toml", "--out", tmp_path / "out", "--set", "focus=[]"
    )
    assert status == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["lens"]["focus_distance_m"] == pytest.approx(4.0, rel=1e-6)
    assert report["solver"] is None
    assert not report["lens"]["solved"]


def test_a_missed_wish_is_status_3(scene_folder, tmp_path):
    status, printed, complaint = focusjax(
        "solve", scene_folder / "boxes.toml", "--out", tmp_path / "out", "--set", "focus.1.blur_px=2000"
    )
    assert status == 3, complaint
    assert "missed" in printed
    assert "The widest aperture stands in the way" in " ".join(printed.split())
    assert "widest aperture stands in the way" in (tmp_path / "out" / "report.html").read_text()


def test_sharp_at_infinity_is_a_wish_like_any_other(scene_folder, tmp_path):
    status, printed, complaint = focusjax(
        "solve", scene_folder / "boxes.toml", "--out", tmp_path / "out",
        "--set", "focus=[{pixel=[20.5, 1.5], sharp=true}]", "--set", "solve.free=['focus']",
    )  # fmt: skip
    assert status == 0
    assert "Focus ∞" in printed
    assert "solve.f_number_min limits nothing, since f_number is not free; add 'f_number' to" in complaint
    assert json.loads((tmp_path / "out" / "report.json").read_text())["lens"]["focus_distance_m"] == "inf"


BAD_MESHES = {
    "garbage.ply": "this is no mesh",
    "empty.obj": "# nothing\n",
    "nan.obj": "v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n",
    "range.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
}


@pytest.mark.parametrize(
    ("overrides", "status", "sentence"),
    [
        (["scene.objects.0.file=gone.ply"], 2, r"mesh file .*gone\.ply does not exist; check the path"),
        (["scene.objects.0.file=gone.ply"], 2, r"boxes\.toml: scene\.objects\.0: mesh file"),
        (["scene.objects.0.scale=1e-30"], 2, r"scene\.objects\.0\.scale: mesh file .* give a larger scale"),
        (["scene.objects.1.file=''"], 2, r"scene\.objects\.1: mesh file .* is a folder; name a file in it"),
        (
            ["camera.resolution=[1, 2000]"],
            2,
            r"toml: camera has resolution = \[1, 2000\], which makes a sensor 36 mm wide 72000 mm high, for a"
            r" field of view of 179\.8 degrees from top to bottom; expected 160 at most, so give a smaller",
        ),
        (["camera.resolution=[10, 600]"], 2, r"2160 mm high"),
        (["title=" + "[" * 3000 + "]" * 3000], 2, r"is nested too deep to read; write it flatter"),
        (["scene.objects.0.file=garbage.ply"], 2, r"mesh file .*garbage\.ply cannot be read"),
        (["scene.objects.0.file=empty.obj"], 2, r"mesh file .*empty\.obj "),
        (["scene.objects.0.file=nan.obj"], 2, r"nan\.obj has 1 vertices with NaN or infinite coordinates"),
        (["scene.objects.0.file=range.off"], 2, r"range\.off .*(vertex|vertices)"),
        (["scene.objects.0.name=far box"], 2, r"two objects are named 'far box'"),
        (["camera.fov=3"], 2, r"unknown key camera\.fov; "),
        (["focus=[]"], 2, r"there are no focus points; add a \[\[focus\]\] table such as pixel = \[20, 15\]"),
        (
            ["focus.1.object=far bix"],
            2,
            r"toml: focus\.1\.object: there is no object named 'far bix'; did you mean 'far box'\?",
        ),
        (
            ["focus=[{pixel=[400, 3], sharp=true}]"],
            2,
            r"boxes\.toml: focus\.0\.pixel: focus point 'pixel \(400, 3\)' .*(screen|frame|picture)",
        ),
        (["focus.0.point=[0, 0, 3]", "focus.1.weight=0"], 2, r"focus\.0\.point: .*box's front.* behind the"),
        (
            ["focus=[{triangle=1, barycentric=[0.7, 0.7, 0.1], sharp=true}]"],
            2,
            r"boxes\.toml: focus\.0\.triangle: .* barycentric coordinates \[0\.7, 0\.7, 0\.1\]; expected",
        ),
        (
            ["focus.1={object='far box', same_blur_as=\"box's frnt\"}"],
            2,
            r"boxes\.toml: focus\.1\.same_blur_as: .* does not exist; did you mean \"box's front\"\?",
        ),
        (["focus.0.weight=0", "focus.1.weight=0"], 2, r"boxes\.toml: focus: every focus point's weight is 0"),
        (["lens.f_number=64"], 2, r"boxes\.toml: lens\.f_number: the starting f-number is 64; expected"),
        (["focus=[{triangle=99, barycentric=[1,0,0], object='far box', sharp=true}]"], 2, r"0 to 11"),
        (["lens.focus_distance_m=0.04"], 2, r"focus distance 0\.04 m is within the focal length 0\.05 m"),
        (
            ["solve.min_focus_distance_m=0.04"],
            2,
            r"boxes\.toml: solve\.min_focus_distance_m: minimum focus distance in metres is 0\.04; expected",
        ),
        (["solve.f_number_min=33"], 2, r"f_number_min = 33, which is not below f_number_max = 32"),
        (["camera.look_at=[0, 0, 0]"], 2, r"the camera looks at its own position"),
        (["camera.up=[0, 0, 1]"], 2, r"along the view axis; choose another up direction"),
        (["lens.f_number=0"], 2, r"lens\.f_number is 0; expected a number above 0"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_bad_input_is_one_sentence_and_writes_nothing(scene_folder, tmp_path, overrides, status, sentence):
    for name, text in BAD_MESHES.items():
        (scene_folder / name).write_text(text)
    options = [part for override in overrides for part in ("--set", override)]
    got, printed, complaint = focusjax(
        "run", scene_folder / "boxes.toml", "--out", tmp_path / "a" / "b", *options
    )
    assert re.search(sentence, complaint), complaint
    assert (got, printed) == (status, "")
    assert complaint.startswith("focusjax: ")
    assert complaint.count("\n") == 1
    assert "Traceback" not in complaint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["post [/x]", "ring [left]", "[bold]", "a\\", "[link=x]y[/link]"])
def test_names_are_no_markup(scene_folder, tmp_path, name):
    """Neither lost nor taken as commands to the terminal, once everything is done."""
    folder = tmp_path / "out [red]"
    status, printed, complaint = focusjax(
        "solve", scene_folder / "boxes.toml", "--out", folder, "--set", f"focus.0.name={json.dumps(name)}"
    )
    assert (status, complaint) == (0, "")
    assert name in printed
    assert "out [red]" in printed
    assert (folder / "report.json").exists()


def test_names_do_not_steer_the_terminal_and_need_no_glyphs(scene_folder, tmp_path):
    """Control characters are written out, and letters that a font lacks warn of nothing."""
    name = json.dumps("\x1b[2J\u732b" + "x" * 300)
    status, printed, complaint = focusjax(
        "solve", scene_folder / "boxes.toml", "--out", tmp_path / "out", "--set", f"focus.0.name={name}"
    )
    assert (status, complaint) == (0, "")
    assert "\x1b" not in printed
    assert r"\x1b[2J" in printed


@pytest.fixture
def apart(scene_folder, tmp_path):
    """A config in a folder of its own, whose meshes are elsewhere."""
    folder = tmp_path / "theirs"
    folder.mkdir()
    text = (scene_folder / "boxes.toml").read_text()
    (folder / "boxes.toml").write_text(text.replace('file = "', f'file = "{scene_folder}/'))
    return folder / "boxes.toml"


def test_files_outside_the_root_are_refused(scene_folder, apart, tmp_path):
    status, printed, complaint = focusjax("solve", apart, "--out", tmp_path / "out")
    assert (status, printed) == (2, "")
    assert re.search(
        rf"boxes\.toml: scene\.objects\.0\.file is '{scene_folder}/.*', outside the folder {apart.parent},"
        r" below which a config may name files; move it there, or allow more with --root DIR",
        complaint,
    )
    assert not (tmp_path / "out").exists()
    for root in (scene_folder, "/"):
        assert focusjax("solve", apart, "--out", tmp_path / "out", "--root", root)[0] == 0


def test_what_the_command_line_names_may_be_anywhere(scene_folder, tmp_path):
    """A way out by .. or by a link is none for the config, but is for who runs it."""
    names = [item.file for item in load_config(scene_folder / "boxes.toml").scene.objects]
    folder = tmp_path / "theirs"
    folder.mkdir()
    text = (scene_folder / "boxes.toml").read_text()
    for name in set(names) - {names[0]}:
        shutil.copy(scene_folder / name, folder / name)
    (folder / "boxes.toml").write_text(text)
    (folder / names[0]).symlink_to(scene_folder / names[0])
    options = ["--out", tmp_path / "out"]
    assert "outside the folder" in focusjax("solve", folder / "boxes.toml", *options)[2]
    for number, name in enumerate(names):
        if name == names[0]:
            options += ["--set", f"scene.objects.{number}.file={json.dumps(str(scene_folder / name))}"]
    assert focusjax("solve", folder / "boxes.toml", *options)[0] == 0


def _commands(group, path=()):
    """All commands below a group, each with the words that call it; groups as well."""
    yield path, group.found() if hasattr(group, "found") else group
    for name, command in getattr(group, "commands", {}).items():
        yield from _commands(command, (*path, name))


@pytest.mark.parametrize(("path", "command"), list(_commands(typer.main.get_command(app))))
def test_help_keeps_its_brackets(path, command):
    status, printed, _ = focusjax(*path, "--help")
    assert status == 0
    texts = [command.help, *(getattr(parameter, "help", None) for parameter in command.params)]
    names = re.findall(r"\[+[\w.]+\]+", " ".join(text for text in texts if text))
    assert [name for name in names if name not in printed] == []
    assert "\\[" not in printed
    assert "[]" not in printed


def test_the_version_is_that_of_the_package():
    status, printed, _ = focusjax("--version")
    assert status == 0
    assert printed.startswith(f"focusjax {importlib.metadata.version('focusjax')} (jax ")


def test_the_package_is_the_command():
    words = [sys.executable, "-m", "focusjax", "--version"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.startswith(f"focusjax {importlib.metadata.version('focusjax')} (jax ")


def test_a_config_may_begin_with_a_byte_order_mark(scene_folder, tmp_path):
    marked = scene_folder / "marked.toml"
    marked.write_bytes(codecs.BOM_UTF8 + (scene_folder / "boxes.toml").read_bytes())
    assert load_config(marked).camera == load_config(scene_folder / "boxes.toml").camera


def test_a_config_nested_too_deep_is_one_sentence(tmp_path):
    deep = tmp_path / "deep.toml"
    deep.write_text("title = " + "[" * 3000 + "]" * 3000)
    status, printed, complaint = focusjax("run", deep, "--out", tmp_path / "out")
    assert (status, printed) == (2, "")
    assert complaint == f"focusjax: {deep}: has tables or arrays nested too deep to read; write it flatter\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is always full")
def test_a_full_disk_is_reported_with_its_folder(scene_folder, tmp_path):
    """Writing to a full disk fails without the file's name."""

    def save(stage, outcome):
        with open("/dev/full", "w") as stream:
            stream.write("x")

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("focusjax._carry_out.save_outcome", save)
        status, printed, complaint = focusjax("solve", scene_folder / "boxes.toml", "--out", tmp_path / "out")
    assert (status, printed) == (1, "")
    assert complaint == (
        f"focusjax: {tmp_path / 'out'}: No space left on device; make room there, or choose another place\n"
    )
    assert not list(tmp_path.iterdir())


def test_a_lens_that_is_not_solved_needs_a_focus_distance(scene_folder, tmp_path):
    text = CONFIG.replace("focus_distance_m = 4.0", "")
    (scene_folder / "unfocused.toml").write_text(text)
    status, _, complaint = focusjax("render", scene_folder / "unfocused.toml", "--out", tmp_path / "out")
    assert status == 2
    assert "lens.focus_distance_m is missing; give it, or solve for it with `focusjax run`" in complaint


def test_an_output_folder_that_cannot_be_written_is_reported_early(scene_folder, tmp_path):
    (tmp_path / "file").write_text("in the way")
    status, _, complaint = focusjax("run", scene_folder / "boxes.toml", "--out", tmp_path / "file" / "out")
    assert status == 1
    assert re.search(r"output folder .* is not writable .*; choose another with --out", complaint)


@pytest.mark.parametrize(
    "arguments", [["run"], ["paint", "x.toml"], ["run", "a.toml", "b.toml"], ["run", "a.toml", "--fast"]]
)
def test_bad_usage_is_status_2(arguments):
    assert focusjax(*arguments)[0] == 2


def test_the_real_command_says_one_sentence(scene_folder, tmp_path):
    """As a process of its own, with everything other libraries may print on the way."""
    done = subprocess.run(
        [sys.executable, "-m", "focusjax.cli", "run", "missing.toml"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == "focusjax: missing.toml: there is no such config file; check the path\n"
    assert done.stdout == ""
