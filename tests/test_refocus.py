"""The command `focusjax refocus`: files, wishes, and sentences for what cannot be done."""

import json

import imageio.v3 as iio
import numpy as np
import pytest
from complaints import complaints_in
from depth_photos import disk_scene, gdepth_jpeg, jpeg
from typer.testing import CliRunner

from focusjax.cli import app

FAST = ("--set", "render.rays=4")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("refocus")
    picture, depth = disk_scene()
    (made / "phone.jpg").write_bytes(gdepth_jpeg(picture, depth))
    (made / "plain.jpg").write_bytes(jpeg(picture))
    holes = np.where(np.arange(48) < 12, 0, depth)
    np.save(made / "depth.npy", holes)
    return made


def refocus(*arguments):
    result = CliRunner().invoke(app, ["refocus", *map(str, arguments)], env={"COLUMNS": "200"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.stdout, complaints_in(result.stderr)


def test_a_phone_photograph_is_refocused_and_reported(folder):
    out = folder / "out"
    status, printed, complaints = refocus(
        folder / "phone.jpg",
        "--focal-length-35mm",
        26,
        "--sharp",
        "24,18",
        "--f-number",
        1.4,
        "--out",
        out,
        *FAST,
    )
    assert (status, complaints) == (0, "")
    assert "of the light in this picture was guessed" in printed
    names = ["blur.png", "image.exr", "image.png", "pinhole.png", "report.html", "report.json"]
    assert sorted(path.name for path in out.iterdir()) == names
    facts = json.loads((out / "report.json").read_text())
    assert facts["lens"]["focus_distance_m"] == pytest.approx(0.5, rel=1e-3)
    assert 0 < facts["guessed"]["light_share"] < 0.1
    assert facts["guessed"]["depth_share"] == 0
    assert "was guessed" in (out / "report.html").read_text()
    # The disk is in focus, and stays as it was.
    image, sharp = (iio.imread(out / name).astype(int) for name in ("image.png", "pinhole.png"))
    assert np.abs(image[15:21, 21:27] - sharp[15:21, 21:27]).max() <= 2


def test_holes_are_reported_and_wishes_in_them_get_a_warning(folder):
    out = folder / "holes"
    status, _, complaints = refocus(
        *(
            folder / "plain.jpg",
            "--depth",
            folder / "depth.npy",
            "--depth-unit",
            "m",
            "--focal-length-px",
            40,
        ),
        *("--sharp", "4,4", "--blur", "24,18=3", "--out", out, *FAST),
    )
    assert status == 0
    assert "focus.0 is at [4, 4], where the depth map has a hole" in complaints
    facts = json.loads((out / "report.json").read_text())
    assert facts["guessed"]["depth_share"] > 0.1
    assert "The depth of another" in facts["guessed"]["sentence"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--f-number", "2"), "there is no wish and no focus distance; give --sharp X,Y"),
        (("--sharp", "9,9"), "nothing says how strong the blur is to be; give --f-number"),
        (("--sharp", "here", "--f-number", "2"), "--sharp here: expected X,Y in pixels, such as 320,240"),
        (("--blur", "9,9", "--f-number", "2"), "--blur 9,9: expected X,Y=PIXELS"),
        (("--anchor", "9", "--sharp", "9,9", "--f-number", "2"), "--anchor 9: expected X,Y,METRES or VALUE"),
        (
            ("--sharp", "9,9", "--f-number", "2"),
            "give --focal-length-35mm (mm as on 36 x 24 mm film, about 26 for a phone) or --focal-length-px",
        ),
        (
            ("--anchor", "9,9,2", "--anchor", "48,36", "--sharp", "9,9", "--f-number", "2"),
            "--anchor 9,9,2 and --anchor 48,36: one is a place X,Y,METRES and another a value VALUE,METRES",
        ),
        (("--depth", "none.png", "--sharp", "9,9"), "none.png: there is no such depth map; check the path"),
        (
            ("--set", "camera.position=[0,0,0]", "--sharp", "9,9", "--f-number", "2"),
            "phone.jpg brings the camera that took it, and camera.position is only half of another pose",
        ),
    ],
)
def test_what_is_missing_is_said_in_one_sentence(folder, tmp_path, arguments, said):
    status, _, complaints = refocus(folder / "phone.jpg", *arguments, "--out", tmp_path / "none")
    assert status == 2
    assert said in complaints
    assert "Traceback" not in complaints
    assert not (tmp_path / "none").exists()


def test_messages_name_options(folder, tmp_path):
    wish = ("--sharp", "9,9", "--f-number", "2", "--focal-length-px", "40", "--out", tmp_path / "none")
    depth = ("--depth", folder / "depth.npy")
    status, _, said = refocus(folder / "plain.jpg", *depth, *wish)
    assert status == 2
    assert (
        "depth.npy: nothing says what the values of this depth map mean; give --depth-unit as one of m,"
        in said
    )
    _, _, said = refocus(folder / "plain.jpg", *depth, "--depth-unit", "relative", *wish)
    assert (
        "has 0; give as --anchor two places X,Y,METRES or two values VALUE,METRES of known distance" in said
    )
    _, _, said = refocus(folder / "plain.jpg", *depth, "--depth-unit", "feet", *wish)
    assert '--depth-unit is "feet"; expected' in said
    assert "scene.photo" not in said
    _, _, said = refocus(folder / "plain.jpg", *wish)
    assert "give a depth map of its own with --depth, or a portrait HEIC" in said


def test_a_photograph_that_is_missing_or_a_folder_is_said_first(folder):
    status, _, said = refocus(folder / "nope.png", "--sharp", "30,36")
    assert status == 2
    assert "nope.png: there is no such photograph; check the path" in said
    status, _, said = refocus(folder, "--sharp", "30,36")
    assert status == 2
    assert "this is a folder, not a photograph; name a file in it" in said


def test_help_says_in_which_pixels_places_are(folder):
    printed = " ".join(refocus("--help")[1].replace("│", " ").split())
    assert "X,Y,METRES|VALUE,METRES" in printed
    assert "of a pixel of the photograph's file" in printed
    assert "48,36 is: value 48 is 36 m away" in printed
    assert "A pixel to be sharp, of the picture that is made" in printed
