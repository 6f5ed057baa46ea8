"""The command that draws a lens: its files, its numbers, and what it refuses."""

import json

import matplotlib.image
import numpy as np
import pytest
from typer.testing import CliRunner

from focusjax.charts import FILES
from focusjax.charts._beams import beam, field_curves, film_at, largest_field
from focusjax.cli import app
from focusjax.optics import first_order, load_lens, seidel_sums

DOUBLET = "50 5 1.5168 18\n-50 2 1 18\n0 0 0 12\n"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("lens") / "biconvex.dat"
    path.write_text(DOUBLET)
    return path


def test_the_command_draws_all_and_lists_what_it_found(file, tmp_path):
    result = CliRunner().invoke(app, ["lens", str(file), "--out", str(tmp_path / "out"), "--f-number", "8"])
    assert result.exit_code == 0, result.output
    assert "focal length" in result.output
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(FILES)
    facts = json.loads((tmp_path / "out" / "lens.json").read_text())
    assert facts["first_order"]["f_number"] == pytest.approx(8.0)
    assert facts["first_order"]["focal_length"] == pytest.approx(49.2, abs=0.1)
    for name in FILES[:-1]:
        picture = matplotlib.image.imread(tmp_path / "out" / name)
        # Something is drawn, and not all over.
        assert 0.01 < np.mean(picture[..., :3].min(axis=-1) < 0.8) < 0.9


def test_charted_curves_are_those_of_the_seidel_sums(file):
    """Near the axis the sagittal and tangential foci bend as S_IV + S_III and S_IV + 3 S_III say."""
    lens = load_lens(file)
    field, seen = 0.02, first_order(lens)
    film = float(lens.vertices()[-1] + seen.back_focal_distance)
    tangential, sagittal, _ = field_curves(lens, np.array([0.0, field]), film)
    sums = seidel_sums(lens, field=field)
    three, four = float(sums.astigmatism.sum()), float(sums.petzval.sum())
    slope = float(seen.entrance_pupil_radius / seen.focal_length)
    # The rest is of the fifth order.
    assert sagittal[1] - sagittal[0] == pytest.approx(-(four + three) / (2 * slope**2), rel=0.03)
    assert tangential[1] - tangential[0] == pytest.approx(-(four + 3 * three) / (2 * slope**2), rel=0.03)


def test_beams_are_what_passes(file):
    lens = load_lens(file)
    rays = beam(lens, 0.0)
    farthest = np.linalg.norm(rays.pupil, axis=1).max()
    assert farthest == pytest.approx(float(first_order(lens).entrance_pupil_radius), rel=0.08)
    # Spherical aberration brings the best focus nearer than the paraxial one.
    assert film_at(lens) < float(lens.vertices()[-1] + first_order(lens).back_focal_distance)
    assert 0.2 < largest_field(lens) < 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["planar"], "there is no lens 'planar'; did you mean planar_us583336_f4.5_1897"),
        (["nowhere.zmx"], "nowhere.zmx: No such file"),
        (["planar_us583336_f4.5_1897", "--f-number", "2"], "opens to f/4.5 at most"),
    ],
)
def test_what_is_refused_is_told_in_one_sentence(arguments, message):
    result = CliRunner().invoke(app, ["lens", *arguments])
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
