"""What makes a result out of date, and how that is said."""

import json

import pytest

from focusjax.batch._fingerprint import Fingerprints, changed_since
from focusjax.config import load_config


def fingerprint(config, *overrides, solve_only=False):
    made = Fingerprints().of(load_config(config, overrides), solve_only=solve_only)
    # As it comes back from a file.
    return json.loads(json.dumps(made, allow_nan=False))


def test_the_files_that_a_config_names_are_part_of_it(boxes):
    made = fingerprint(boxes)
    assert list(made["files"]) == ["box.ply"]
    mesh = boxes.with_name("box.ply")
    mesh.write_bytes(mesh.read_bytes().replace(b"ply", b"PLY", 1))
    assert changed_since(made, fingerprint(boxes)) == "the file box.ply has changed"
    mesh.unlink()
    assert changed_since(made, fingerprint(boxes)) == "the file box.ply has changed"


def test_what_does_not_change_the_result_does_not_change_it(boxes):
    made = fingerprint(boxes)
    boxes.write_text("# A remark.\n" + boxes.read_text())
    assert changed_since(made, fingerprint(boxes, "render.rays=4")) == ""
    assert made["config"]["solve"]["max_focus_distance_m"] == "inf"


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["render.rays=5"], "render.rays has changed"),
        (["focus.1.weight=2", "lens.f_number=3"], "lens.f_number, focus.1.weight have changed"),
        (["focus=[{pixel=[3, 3], sharp=true}]"], "focus has changed"),
        (
            ["camera.rise_mm=1", "camera.shift_mm=1", "title=x", "render.seed=2", "render.rays=8"],
            "title, camera.shift_mm, camera.rise_mm and 2 more have changed",
        ),
    ],
)
def test_the_keys_that_differ_are_named(boxes, overrides, said):
    assert changed_since(fingerprint(boxes), fingerprint(boxes, *overrides)) == said


def test_with_and_without_pictures(boxes):
    solved, rendered = fingerprint(boxes, solve_only=True), fingerprint(boxes)
    assert changed_since(solved, rendered) == "it was solved without a picture"
    assert changed_since(rendered, solved) == "it had a picture made"


def test_a_fingerprint_that_says_nothing_is_out_of_date(boxes):
    assert changed_since({}, fingerprint(boxes)) == "nothing is known of how it was done"
