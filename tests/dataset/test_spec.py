"""What can be drawn, against closed forms; and what is refused."""

import math
import re

import numpy as np
import pytest
import scipy.stats

from focusjax.config import ConfigError
from focusjax.dataset import Distribution, load_spec, spec_of


@pytest.mark.parametrize(
    ("drawn", "known"),
    [
        (Distribution(uniform=(1.0, 3.0)), scipy.stats.uniform(1.0, 2.0)),
        (Distribution(log_uniform=(1.0, 16.0)), scipy.stats.loguniform(1.0, 16.0)),
        (
            Distribution(normal=(1.0, 2.0), within=(0.0, 2.0)),
            scipy.stats.truncnorm(-0.5, 0.5, loc=1.0, scale=2.0),
        ),
    ],
    ids=["uniform", "log_uniform", "normal"],
)
def test_numbers_have_the_distribution_that_is_named(drawn, known):
    random = np.random.default_rng(0)
    values = [drawn.draw(random) for _ in range(2000)]
    # Observed 0.5, 0.5 and 0.5: the same generator.
    assert scipy.stats.kstest(values, known.cdf).pvalue > 0.01
    assert drawn.ends == pytest.approx(known.support())


def test_whole_numbers_are_all_as_frequent():
    random = np.random.default_rng(0)
    drawn = Distribution(uniform=(2.0, 4.0))
    counts = np.bincount([drawn.draw_whole(random) for _ in range(900)], minlength=6)
    assert counts[[0, 1, 5]].tolist() == [0, 0, 0]
    assert scipy.stats.chisquare(counts[2:5]).pvalue > 0.01
    chosen = [Distribution(choice=(1.0, 8.0)).draw_whole(random) for _ in range(50)]
    assert set(chosen) == {1, 8}


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"lens": {"f_number": {"uniform": [8, 2]}}}, "lens.f_number has uniform = [8, 2], from the larger"),
        ({"lens": {"f_number": -2}}, "lens.f_number may be -2; expected numbers from 0.5 to 128"),
        ({"lens": {"f_number": {"choice": []}}}, "lens.f_number.choice is []; expected at least 1 entries"),
        ({"lens": {"f_number": {"log_uniform": [0, 2]}}}, "expected two ends above 0, or uniform"),
        ({"lens": {"f_number": {"normal": [2, 1]}}}, "lens.f_number has normal without within"),
        (
            {"lens": {"f_number": {"normal": [2, 0.1], "within": [8, 9]}}},
            "lens.f_number has normal = [2, 0.1], which is hardly ever within [8, 9]; move the mean",
        ),
        ({"lens": {"f_number": {"normal": [2, 0], "within": [1, 9]}}}, "expected one above 0"),
        ({"lens": {"f_number": {}}}, "lens.f_number has no distribution; expected one of uniform, log_"),
        ({"lens": {"f_number": {"uniform": [1, 2], "choice": [1]}}}, "has uniform and choice; expected one"),
        (
            {"lens": {"f_number": {"unifrom": [1, 2]}}},
            "unknown key lens.f_number.unifrom; did you mean uniform",
        ),
        ({"lens": {"f_number": "wide"}}, 'lens.f_number is "wide"; give a number, or a table such as'),
        ({"lens": {"focus": "a wall"}}, 'lens.focus is "a wall"; expected'),
        (
            {"lens": {"focus": "an object", "focus_distance_m": 2}},
            "lens has focus_distance_m and focus; leave",
        ),
        (
            {"lens": {"focus_distance_m": 0.04}},
            "has a lens.focus_distance_m that may be 0.04 m, within a focal",
        ),
        (
            {"scene": {"objects": 2.5}},
            "scene.objects is of numbers that may not be whole; give a whole number",
        ),
        (
            {"scene": {"wall_m": 3}},
            "scene has a wall_m that may be 3 m and a distance_m that may be 6 m; put",
        ),
        ({"scene": {"kinds": ["mesh"]}}, "scene has kinds with 'mesh', but no meshes; give meshes"),
        ({"scene": {"kinds": []}}, "scene.kinds is []; expected at least 1 entries"),
        (
            {"scene": {"meshes": "none"}},
            "scene.meshes is 'none', but there is no such folder; check the path",
        ),
        ({"camera": {"pitch_deg": 60, "field_of_view_deg": 90}}, "camera sees up to 115 degrees from the"),
        ({"camera": {"focal_length_mm": 50, "field_of_view_deg": 9}}, "and field_of_view_deg; leave one"),
    ],
)
def test_an_impossible_spec_is_refused_by_key(data, sentence):
    with pytest.raises(ConfigError, match=re.escape(sentence)):
        spec_of(data)


def test_a_folder_without_meshes_is_refused(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "spec.toml").write_text("[scene]\nmeshes = 'meshes'\n")
    with pytest.raises(ConfigError, match="meshes is 'meshes', a folder without mesh files; expected some"):
        load_spec(tmp_path / "spec.toml")

    (tmp_path / "spec.toml").write_text("[scene]\nmeshes = '..'\n")
    with pytest.raises(ConfigError, match=r"scene\.meshes is '\.\.', outside the folder .* --root DIR"):
        load_spec(tmp_path / "spec.toml")


def test_angles_of_view_are_focal_lengths():
    camera = spec_of({"camera": {"field_of_view_deg": {"uniform": [20, 40]}}}).camera
    assert camera.longest == pytest.approx(0.018 / math.tan(math.radians(10)))
    assert camera.focal_length(40.0) == pytest.approx(0.018 / math.tan(math.radians(20)))
    # The corner of a square frame is sqrt(2) times as far off as its side.
    assert camera.corner == pytest.approx(math.sqrt(2) * math.tan(math.radians(20)))
