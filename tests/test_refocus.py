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
        (("--sharp", "9,9", "--f-number", "2"), "EXIF does not say the focal length; give focal_length_35mm"),
    ],
)
def test_what_is_missing_is_said_in_one_sentence(folder, tmp_path, arguments, said):
    status, _, complaints = refocus(folder / "phone.jpg", *arguments, "--out", tmp_path / "none")
    assert status == 2
    assert said in complaints
    assert "Traceback" not in complaints
    assert not (tmp_path / "none").exists()
