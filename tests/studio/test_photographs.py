"""Photographs with depth in the studio: opened, clicked on and solved like any other scene."""

import pytest
from depth_photos import FAR_M, NEAR_M, disk_scene, gdepth_jpeg

from focusjax.studio import Session

CONFIG = """
[scene.photo]
file = "phone.jpg"
focal_length_35mm = 26
[lens]
f_number = 1.4
[[focus]]
pixel = [24, 18]
sharp = true
"""


def test_a_photograph_is_solved_and_its_places_have_their_depth(tmp_path):
    (tmp_path / "phone.jpg").write_bytes(gdepth_jpeg(*disk_scene()))
    path = tmp_path / "phone.toml"
    path.write_text(CONFIG)
    session = Session(path)
    assert not session.document.problem
    answer = session.solve()
    assert float(answer.outcome.lens.focus_distance()) == pytest.approx(NEAR_M, rel=1e-3)
    wall = session.under(3, 3)
    assert wall.distance == pytest.approx(FAR_M, rel=1e-3)
    assert wall.blur > 0.9
    # Sharp there instead: the same scene, another lens.
    session.wish_for(session.add_point(3, 3), "sharp")
    session.delete_point(0)
    assert float(session.solve().outcome.lens.focus_distance()) == pytest.approx(FAR_M, rel=1e-3)
