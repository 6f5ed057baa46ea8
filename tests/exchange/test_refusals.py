"""What a target cannot have is refused in words, or approximated with its error."""

import dataclasses

import numpy as np
import pytest
from exchange_cameras import HEIGHT, WIDTH, bladed_lens, round_lens, slid_camera, turned_lens

import focusjax as fj
from focusjax._arguments import ArgumentError
from focusjax.exchange import TARGETS, ExportError
from focusjax.lens import AberratedLens, seidel


def upright_camera():
    return slid_camera(shift=0.0, rise=0.0)


def surface_lens(camera):
    surface = fj.focal_surface([(10, 20), (50, 20), (30, 50)], [0.5, 1.0, 0.8])
    return fj.focal_surface_lens(surface, camera, round_lens())


CASES = {
    ("mitsuba", "tilt"): (
        "Mitsuba cannot express a lens turned against the sensor (tilt 5.73, swing -2.86 degrees); export to"
        " blender or gltf, which can, or add --approximate"
    ),
    ("usd", "tilt and shift"): (
        "USD cannot express a lens turned against the sensor (tilt 5.73, swing -2.86 degrees); export to"
        " blender, which can, or add --approximate"
    ),
    ("usd", "surface"): "USD cannot express a focal surface; export to blender, which can",
    ("gltf", "surface"): "glTF cannot express a focal surface; export to blender, which can",
    ("mitsuba", "blades"): (
        "Mitsuba cannot express an opening of 5 blades; export to usd, blender or gltf, which can"
    ),
    ("pbrt", "blades"): "pbrt cannot express an opening of 5 blades; export to usd, blender or gltf",
    ("gltf", "shift"): "glTF cannot express a shifted lens (shift 2.025, rise -0.9 mm)",
    ("usd", "aberrations"): "USD cannot express aberrations; add --approximate (approximate=True)",
    ("blender", "mask"): "Blender cannot express an opening of class Obstructed; add --approximate",
}


def pair(what):
    camera = slid_camera() if "shift" in what else upright_camera()
    lens = {
        "tilt": turned_lens,
        "tilt and shift": turned_lens,
        "surface": lambda: surface_lens(camera),
        "blades": bladed_lens,
        "shift": round_lens,
        "aberrations": lambda: AberratedLens(round_lens(), (seidel(round_lens(), camera, w131=2.0),)),
        "mask": lambda: round_lens(aperture=fj.lens.obstructed(0.4)),
    }[what]()
    return camera, lens


@pytest.mark.parametrize(("to", "what"), CASES)
def test_refused_in_words_and_approximated_where_asked(tmp_path, to, what):
    camera, lens = pair(what)
    file = tmp_path / f"c{TARGETS[to].suffix}"
    with pytest.raises(ExportError) as refused:
        fj.export_camera(camera, lens, file, to=to)
    assert CASES[to, what] in str(refused.value)
    assert not file.exists()
    made = fj.export_camera(camera, lens, file, to=to, approximate=True)
    assert file.exists()
    assert made.sentence.startswith("Approximated: ")
    assert (made.blur_error_px == 0.0) == (what == "shift")


def test_the_stated_error_of_a_lens_set_upright_is_that_of_its_blur(tmp_path):
    """Blur differs by what focus does, wherever things are: by half of its range over the frame."""
    camera = upright_camera()
    lens = dataclasses.replace(turned_lens(), aperture=fj.Disk())
    made = fj.export_camera(camera, lens, tmp_path / "c.xml", to="mitsuba", approximate=True)
    tangents = np.array([[x, y] for x in (-0.36, 0.36) for y in (-0.27, 0.27)])
    focus = tangents @ np.asarray(lens.plane)[:2]
    expected = float(camera.focal_px) * 2 * 0.0125 * (focus.max() - focus.min()) / 2
    # A turned opening is foreshortened, too: observed 8 % more.
    assert made.blur_error_px == pytest.approx(expected, rel=0.1)
    assert made.record.frames[0].focus_distance == pytest.approx(1.2)


def test_a_disk_in_place_of_blades_has_their_light(tmp_path):
    """The error is small, and vanishes as blades get round."""
    errors = []
    for roundness in (0.0, 0.6, 1.0):
        lens = round_lens(aperture=fj.polygon(9, roundness=roundness))
        made = fj.export_camera(
            upright_camera(), lens, tmp_path / "c.xml", to="mitsuba", approximate=True, disparities=(0.0, 2.0)
        )
        errors.append(made.blur_error_px)
    # Blur reaches 2 x 111 px x 14 mm x 1.23 / m = 3.8 px; observed 0.16, 0.06 and 0.
    assert 0.3 > errors[0] > errors[1] > 0.0
    assert errors[2] == 0.0


def test_shifts_are_rounded_where_asked(tmp_path):
    camera = slid_camera(shift=0.0031, rise=0.0)
    with pytest.raises(ExportError, match=r"shift 3.1, rise 0 mm\) that is not a whole number"):
        fj.export_camera(camera, round_lens(), tmp_path / "c.xml", to="mitsuba")
    made = fj.export_camera(camera, round_lens(), tmp_path / "c.xml", to="mitsuba", approximate=True)
    assert "the frame is off by 0.11 px" in made.sentence
    assert made.blur_error_px == pytest.approx(0.0, abs=1e-6)


BAD = {
    "there is no target 'usdz'; did you mean 'usd'?": {"to": "usdz"},
    "c.txt does not end in .usda, which USD expects": {"path": "c.txt"},
    "up_axis is 'X'; expected 'Y' or 'Z'": {"up_axis": "X"},
    "metres_per_unit is 0; expected a length above 0": {"metres_per_unit": 0},
    "disparities is (1, -2); expected the least and the largest": {"disparities": (1, -2)},
    "fps is 0; expected frames per second above 0": {"fps": 0},
    "has 1 cameras and 2 lenses; expected one each per frame": {"lens": [round_lens()] * 2},
}


@pytest.mark.parametrize("message", BAD)
def test_bad_arguments(tmp_path, message):
    given = {"camera": slid_camera(), "lens": round_lens(), "path": "c.usda", "to": "usd"} | BAD[message]
    path = tmp_path / given.pop("path")
    with pytest.raises(ArgumentError) as refused:
        fj.export_camera(given.pop("camera"), given.pop("lens"), path, **given)
    assert message in str(refused.value)
    assert not path.exists()


def test_sizes_of_a_shot_agree(tmp_path):
    other = slid_camera(width=WIDTH * 2, height=HEIGHT * 2)
    with pytest.raises(ArgumentError, match="differ in their pixels"):
        fj.export_camera([slid_camera(), other], [round_lens()] * 2, tmp_path / "c.usda", to="usd")
