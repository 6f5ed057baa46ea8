"""Shots in the studio: frames as answers, tracks, and drafts that are kept."""

import numpy as np
import pytest
from boxes_config import CONFIG, write_boxes

from focusjax.config import load_config
from focusjax.exchange import TARGETS
from focusjax.shot import build_shot, solve_shot
from focusjax.studio import EditError, Session, Studio
from focusjax.studio._timing import keys_of, span_of
from focusjax.studio._tracks import tracks_svg

SHOT = """
[shot]
frames = 5
fade_frames = 0
[[shot.camera]]
frame = 1
position = [0, 0, 0]
[[shot.camera]]
frame = 5
position = [0.2, 0, 0]
[[shot.wishes]]
name = "box's front"
to_frame = 2
[[shot.wishes]]
name = "far box"
from_frame = 3
"""


@pytest.fixture
def path(tmp_path):
    path = write_boxes(tmp_path)
    path.write_text(
        CONFIG.replace('free = ["focus", "f_number"]\nf_number_min = 0.2', 'free = ["focus"]') + SHOT
    )
    return path


def test_frames_are_those_of_the_shot(path):
    session = Session(path)
    reel = session.solve_shot()
    wanted = solve_shot(build_shot(load_config(path))).solution
    np.testing.assert_allclose(reel.curves["focus"], wanted.settings()["focus_per_m"], rtol=1e-6)
    for frame in (1, 5):
        answer = session.frame_of(reel, frame)
        assert answer.values()["focus"] == pytest.approx(1 / reel.curves["focus"][frame - 1], rel=1e-5)
        assert [row.counts for row in answer.wishes] == ([True, False] if frame == 1 else [False, True])
        assert session.under(*answer.marks()[0]).object == "near box"
    assert 'class="focus"' in tracks_svg(session.config, reel, 2, 900)


def test_tracks_are_edited_and_follow_their_wish(path):
    session = Session(path)
    session.act(0, "from", 2)
    session.act(1, "from", None)
    session.set_key(1, 4, "blur", 6.0)
    session.set_key(1, 1, "blur", 2.0)
    session.set_key(0, 2, "weight", 3.0)
    assert span_of(session.config, 0) == (2, 2)
    assert keys_of(session.config, 1, "blur") == {1: 2.0, 4: 6.0}
    assert session.value_at(1, 4, "blur") == 6.0
    session.rename(1, "behind")
    assert keys_of(session.config, 1, "blur") == {1: 2.0, 4: 6.0}
    session.delete_key(1, 1)
    session.delete_key(1, 4)
    assert len(session.config.shot.wishes) == 1
    session.delete_point(0)
    assert session.config.shot.wishes == ()
    with pytest.raises(EditError, match="frame 9 is not in the shot; it has frames 1 to 5"):
        session.act(0, "to", 9)
    for _ in range(9):
        session.undo()
    assert session.document.text == path.read_text()


@pytest.mark.slow
def test_a_frame_that_was_drafted_is_shown_again_at_once(path):
    studio = Studio(Session(path))
    try:
        assert studio.wait(600)
        assert studio.state.word == "refined"
        assert (studio.frame, studio.reel.count) == (1, 5)
        for frame in (2, 3, 2, 99):
            studio.show_frame(frame)
            assert studio.wait(600)
            assert studio.answer.frame == min(frame, 5)
        assert studio.drafts == 4 + 1  # frames 1, 2, 3 and 5, and the sharp view before all was solved
    finally:
        studio.close()


def test_values_are_those_of_the_frame_where_there_are_keyframes(path):
    session = Session(path)
    session.set_pixels(1, 4.0, 3)
    assert (session.config.focus[1].blur_px, keys_of(session.config, 1, "blur")) == (4.0, {})
    session.set_key(1, 3, "blur", 4.0)
    session.set_pixels(1, 9.0, 5)
    assert keys_of(session.config, 1, "blur") == {3: 4.0, 5: 9.0}
    assert session.value_at(1, 4, "blur") == pytest.approx(6.5)
    session.set_key(0, 1, "weight", 2.0)
    session.set_weight(0, 5.0, 2)
    assert keys_of(session.config, 0, "weight") == {1: 2.0, 2: 5.0}


def test_a_wish_with_keyframes_of_its_weight_is_switched_off_and_on(path):
    session = Session(path)
    session.set_key(0, 1, "weight", 2.0)
    session.set_key(0, 2, "weight", 3.0)
    session.switch(0, on=False)
    rows = session.frame_of(session.solve_shot(), 1).wishes
    assert not rows[0].counts
    session.switch(0, on=True)
    assert keys_of(session.config, 0, "weight") == {1: 2.0, 2: 3.0}
    assert session.frame_of(session.solve_shot(), 1).wishes[0].counts


@pytest.mark.parametrize("kind", ["sharp", "same_blur_as", "at_most"])
@pytest.mark.slow
def test_keyframes_of_a_blur_stay_where_they_mean_the_same(path, kind):
    session = Session(path)
    session.act(1, "from", 1)
    session.set_key(1, 2, "blur", 2.0)
    session.set_key(1, 3, "weight", 2.0)
    session.wish_for(1, kind, pixels=3.0, other="box's front")
    assert keys_of(session.config, 1, "blur") == ({2: 2.0} if kind == "at_most" else {})
    assert keys_of(session.config, 1, "weight") == {3: 2.0}
    assert session.solve_shot().count == 5


def test_the_cameras_of_all_frames_are_written_for_every_program(path, tmp_path):
    pytest.importorskip("pxr", reason="no USD (usd-core)")
    studio = Studio(Session(path))
    try:
        assert studio.wait(600)
        for name, target in TARGETS.items():
            said = studio.export(name, tmp_path / "cameras")
            written = list((tmp_path / "cameras").glob(f"boxes*{target.suffix}"))
            assert written, name
            assert all(file.stat().st_size > 0 for file in written), name
            assert said, name
    finally:
        studio.close()
