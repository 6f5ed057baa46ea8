"""The command that draws a lens: its files, its numbers, and what it refuses."""

import json

import jax
import matplotlib.image
import numpy as np
import pytest
from typer.testing import CliRunner

from focusjax.charts import FILES, draw_lens
from focusjax.charts._beams import beam, field_curves, film_at, largest_field, paths
from focusjax.cli import app
from focusjax.optics import first_order, lens_preset, load_lens, seidel_sums

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
    found = field_curves(lens, np.array([0.0, field]), film)
    tangential, sagittal = found.tangential, found.sagittal
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


def test_the_tangential_curve_is_smooth_in_single_precision(tmp_path):
    """It is made of differences of near rays: in float32 it had second differences of 0.05 mm."""
    with jax.enable_x64(False):
        facts = draw_lens(lens_preset("gauss_jp62087922_f1.8_1987"), tmp_path / "out")
    curve = np.array(facts["over_field"]["tangential_focus_mm"])
    # Observed: 0.0093 mm.
    assert np.abs(np.diff(curve, 2)).max() < 0.012


def test_the_section_shows_the_marginal_rays(file):
    """The outermost rays of a point on the axis graze the stop, or what is narrower."""
    with jax.enable_x64(True):
        lens = load_lens(file)
        rays = paths(lens, 0.0, 11, film_at(lens))
    assert len(rays) == 11
    stop = np.array([points[3, 1] for points in rays])
    np.testing.assert_allclose([stop[0], stop[-1]], [-6.0, 6.0], rtol=1e-3)
    assert paths(lens, 1.5, 11, 60.0) == []


def test_warnings_are_one_line_each(tmp_path):
    """Not Python's, with its path and the source's line."""
    path = tmp_path / "odd [bold].json"
    path.write_text(
        '{"surfaces": [{"type": "Spheric", "k": -1, "r": 9, "roc": 50, "d_next": 5, "mat2": "N-BK7"},'
        ' {"type": "Spheric", "r": 9, "roc": -50, "d_next": 2, "mat2": "air"},'
        ' {"type": "Stop", "r": 5, "d_next": 40, "mat2": "air"}]}'
    )
    result = CliRunner().invoke(app, ["lens", str(path), "--out", str(tmp_path / "out [/x]")])
    assert result.exit_code == 0, result.output
    said = [line for line in result.output.splitlines() if line.startswith("Warning: ")]
    assert len(said) == 1
    assert "surfaces[0] is of the type Spheric" in said[0]
    assert ".py" not in result.output
    assert "odd [bold]" in result.output
    assert "out [/x]" in result.output


def test_glass_from_a_file(tmp_path):
    (tmp_path / "a.zmx").write_text(
        "SURF 0\nDISZ INFINITY\nSURF 1\nCURV 0.02\nSTOP\nDISZ 5\nGLAS OURS 0 0 1.5 40\nDIAM 9\n"
        "SURF 2\nCURV -0.02\nDISZ 45\nDIAM 9\nSURF 3\nDISZ 0\n"
    )
    (tmp_path / "our.agf").write_text("NM OURS 5 0 1.514379 50 0 1\nCD 1.49 1.2e-2 6.17e-4\nLD 0.3 2\n")
    arguments = ["lens", str(tmp_path / "a.zmx"), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "--glass FILE" in result.output
    result = CliRunner().invoke(app, [*arguments, "--glass", str(tmp_path / "our.agf")])
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["planar"], "there is no lens 'planar'; did you mean planar_us583336_f4.5_1897"),
        (["nowhere.zmx"], "nowhere.zmx: No such file"),
        (["planar_us583336_f4.5_1897", "--f-number", "2"], "opens to f/4.5 at most"),
    ],
)
def test_what_is_refused_is_reported_in_one_sentence(arguments, message):
    result = CliRunner().invoke(app, ["lens", *arguments])
    assert result.exit_code == 2
    assert message in " ".join(result.output.split())
