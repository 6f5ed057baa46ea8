"""The final picture: made beside what the page does, stopped, and refused where it cannot be written."""

import threading

import pytest
from boxes_config import CONFIG, write_boxes

from focusjax import job
from focusjax.studio import EditError, Session, Studio
from focusjax.studio import _final as finals

SHOT = """
[shot]
frames = 3
"""


@pytest.fixture
def studio(tmp_path):
    made = Studio(Session(write_boxes(tmp_path)))
    assert made.wait(600)
    yield made
    made.close()


@pytest.mark.slow
def test_the_final_picture_is_not_stopped_by_edits_and_is_of_what_held_before(studio, tmp_path, monkeypatch):
    edited, run, ran = threading.Event(), job.run, []

    def slow(config, **settings):
        if settings.get("rendering", True):
            ran.append(config)
            edited.wait(60)
        return run(config, **settings)

    monkeypatch.setattr(finals.job, "run", slow)
    studio.render(tmp_path / "out")
    assert studio.final.busy
    studio.apply(lambda session: session.set_weight(0, 7.0))
    edited.set()
    assert studio.wait(600)
    assert studio.final.state.word == "rendered"
    assert studio.final.state.detail == f"Report: {tmp_path / 'out' / 'report.html'}"
    assert ran[0].focus[0].weight == 1.0
    # The page's own picture is refined after it.
    assert studio.state.word == "refined"
    assert studio.answer.config.focus[0].weight == 7.0


def test_a_final_picture_that_is_stopped_leaves_nothing_and_the_page_goes_on(studio, tmp_path, monkeypatch):
    at_it, stopped, run = threading.Event(), threading.Event(), job.run

    def slow(config, **settings):
        at_it.set()
        stopped.wait(60)
        return run(config, **settings)

    monkeypatch.setattr(finals.job, "run", slow)
    studio.render(tmp_path / "out")
    at_it.wait(60)
    studio.final.cancel()
    assert studio.final.state.detail == "The final picture was cancelled."
    stopped.set()
    assert studio.wait(600)
    assert (studio.final.state.word, studio.state.word) == ("cancelled", "refined")
    assert not list((tmp_path / "out").iterdir())


def test_all_frames_of_a_shot_with_their_share_of_time(tmp_path):
    path = write_boxes(tmp_path)
    path.write_text(CONFIG + SHOT)
    studio, shares = Studio(Session(path)), []
    try:
        assert studio.wait(600)
        change = studio.final._changed
        studio.final._changed = lambda: (shares.append(studio.final.state), change())
        studio.render(tmp_path / "out")
        assert studio.wait(600)
        assert studio.final.state.word == "rendered"
        assert len(list((tmp_path / "out").rglob("frame_*.png"))) == 3
        assert (tmp_path / "out" / "report.html").is_file()
        rendered = {state.share for state in shares if state.detail == "tracing rays"}
        assert len(rendered & {0.0, 1 / 3, 2 / 3, 1.0}) >= 3
    finally:
        studio.close()


def test_a_folder_that_cannot_be_written_to_is_refused(studio, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(EditError, match="pictures cannot be written there"):
        studio.render(tmp_path / "file" / "out")
    assert not studio.final.busy
    assert studio.state.word == "refined"


def test_what_goes_wrong_is_said(studio, tmp_path, monkeypatch):
    def broken(config, **settings):
        raise ValueError("the mesh is gone; bring it back")

    monkeypatch.setattr(finals.job, "run", broken)
    studio.render(tmp_path / "out")
    assert studio.wait(600)
    assert (studio.final.state.word, studio.final.state.detail) == (
        "failed",
        "the mesh is gone; bring it back",
    )
    assert studio.state.word == "refined"
