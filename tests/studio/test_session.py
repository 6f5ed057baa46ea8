"""A session without any page: what its edits do to the config and to the lens."""

import numpy as np
import pytest
from boxes_config import CONFIG, write_boxes
from compilations import compilations

from focusjax import job
from focusjax.config import load_config
from focusjax.studio import EditError, Session
from focusjax.studio._answer import NO_WISH

NEAR, FAR, SKY = (8, 15), (30, 15), (20, 1)


@pytest.fixture
def session(tmp_path):
    return Session(write_boxes(tmp_path))


def test_what_is_under_a_pixel(session):
    session.solve()
    near, far, sky = (session.under(*place) for place in (NEAR, FAR, SKY))
    assert (near.object, far.object, sky.object) == ("near box", "far box", "")
    assert near.distance == pytest.approx(1.75, rel=1e-6)
    assert far.distance == pytest.approx(4.75, rel=1e-6)
    assert sky.distance == np.inf
    # The far box is to be blurred by 3 px, behind the near one, which is sharp; the sky more.
    assert abs(near.blur) < 0.05
    assert 2.5 < far.blur < 3.5 < sky.blur
    assert far.sentence() == f"far box, 4.75 m away, blur {far.blur:.1f} px behind the focus"
    assert session.under(-5, 400) == session.under(0, 29)


def test_a_saved_session_gives_the_same_lens_from_the_command_line(session):
    number = session.add_point(*FAR)
    session.wish_for(number, "at_least", pixels=2.5)
    session.limit("f_number", "low", 0.5)
    session.free("tilt")
    session.limit("tilt", "high", 5.0)
    answer = session.solve()
    session.document.save()
    outcome = job.run(load_config(session.document.path), rendering=False)
    found, again = answer.outcome.lens, outcome.lens
    np.testing.assert_allclose(again.plane, found.plane, rtol=1e-6, atol=1e-9)  # observed: equal
    np.testing.assert_allclose(again.aperture_radius, found.aperture_radius, rtol=1e-6)


def test_new_points_are_called_after_what_they_are_on(session):
    numbers = [session.add_point(*place) for place in (NEAR, FAR, SKY, SKY)]
    names = [session.config.focus[number].name for number in numbers]
    assert names == ["near box", "far box 2", "background", "background 2"]
    assert session.config.focus[numbers[0]].pixel == NEAR


def test_every_kind_of_wish(session):
    number = session.add_point(*FAR)
    session.wish_for(number, "same_blur_as", other="box's front")
    assert session.config.focus[number].same_blur_as == "box's front"
    session.rename(0, "front")
    assert session.config.focus[number].same_blur_as == "front"
    for kind in ("blur", "at_most", "at_least"):
        session.wish_for(number, kind, pixels=4.0)
        assert session.config.focus[number].wish_key == f"{kind}_px"
    session.wish_for(number, "sharp")
    session.set_weight(number, 3.0)
    session.set_tolerance(number, 0.5)
    wish = session.config.focus[number]
    assert (wish.sharp, wish.weight, wish.tolerance_px) == (True, 3.0, 0.5)


def test_a_wish_that_is_switched_off_counts_no_more_and_again(session):
    session.set_weight(1, 2.0)
    with_both = session.solve().values()["f_number"]
    session.switch(1, on=False)
    assert not session.solve().wishes[1].counts
    session.switch(1, on=True)
    assert session.config.focus[1].weight == 2.0
    assert session.solve().values()["f_number"] == pytest.approx(with_both, rel=1e-6)


def test_a_wish_moves_and_spreads_over_its_object(session):
    number = session.add_point(*NEAR)
    session.solve()
    session.move_point(number, *FAR)
    answer = session.solve()
    assert answer.wishes[number].distance == pytest.approx(4.75, rel=1e-6)
    session.spread(number, whole=True)
    answer = session.solve()
    assert session.config.focus[number].object == "far box"
    assert answer.wishes[number].samples > 1
    session.spread(number, whole=False)
    assert session.config.focus[number].pixel == FAR
    session.move_point(number, *SKY)
    session.solve()
    with pytest.raises(EditError, match="on the background, which is no object"):
        session.spread(number, whole=True)


def test_a_drag_is_one_step_back(session):
    number = session.add_point(*NEAR)
    for x in (10, 20, 30):
        session.move_point(number, x, 15, drag="1")
    session.end_drag()
    session.undo()
    assert session.config.focus[number].pixel == NEAR
    session.redo()
    assert session.config.focus[number].pixel == (30, 15)


def test_a_setting_is_fixed_where_it_is_and_freed_again(session):
    solved = session.solve().values()["f_number"]
    session.fix("f_number")
    assert session.config.solve.free == ("focus",)
    assert "f_number_min" not in session.config.solve.model_fields_set
    assert session.solve().values()["f_number"] == pytest.approx(solved, rel=1e-8)
    with pytest.raises(EditError, match="one setting at least has to stay free"):
        session.fix("focus")
    session.free("swing")
    session.fix("focus", 2.0)
    assert session.solve().values()["focus"] == pytest.approx(2.0, rel=1e-6)


def test_a_limit_moves_the_start_with_it(session):
    session.limit("f_number", "low", 4.0)
    answer = session.solve()
    assert answer.values()["f_number"] == pytest.approx(4.0, rel=1e-6)
    assert any("widest aperture" in sentence for sentence in answer.with_sentences().sentences)
    with pytest.raises(EditError, match=r"f_number_min.*not below"):
        session.limit("f_number", "high", 3.0)


def test_without_wishes_the_lens_is_the_configs_own(session):
    session.delete_point(1)
    session.delete_point(0)
    assert session.solve().values()["focus"] == pytest.approx(4.0, rel=1e-6)
    session.fix("focus", 3.0)
    assert session.solve().values()["focus"] == pytest.approx(3.0, rel=1e-6)
    session.set_text(session.document.text.replace("focus_distance_m = 3.0\n", ""))
    assert session.solve().problem == NO_WISH


def test_what_cannot_be_solved_is_reported(session):
    session.set_text(CONFIG.replace("object =", "object ="[:-1] + '= "wall" #'))
    answer = session.solve()
    assert answer.outcome is None
    assert "'wall'" in answer.problem
    assert answer.wishes == ()


def test_no_solver_is_compiled_when_wishes_come_and_move(session):
    session.solve().with_sentences()
    number = session.add_point(*NEAR)
    session.solve().with_sentences()
    with compilations() as compiled:
        session.move_point(number, *FAR)
        session.limit("f_number", "low", 1.0)
        session.solve().with_sentences()
    assert compiled == []
    with compilations() as compiled:
        other = session.add_point(20, 20)
        session.wish_for(other, "blur", pixels=2.0)
        session.solve().with_sentences()
    # JAX copies, converts and masks arrays of one row more by programs that do nothing else.
    assert set(compiled) <= {"jit(stage)", "jit(convert_element_type)", "jit(_where)"}


def test_a_focal_length_is_fixed_and_freed_within_a_range(session):
    session.fix("focal_length", 35.0)
    assert session.solve().values()["focal_length"] == pytest.approx(35.0, rel=1e-6)
    session.free("focal_length")
    solve = session.config.solve
    assert (solve.focal_length_min_mm, solve.focal_length_max_mm) == pytest.approx((25.0, 49.0))


def test_exposure_is_set_and_its_limits_go(session):
    session.set_text(CONFIG + '[exposure]\nlight_ev = 8\niso_max = 800\n[film]\npreset = "filmic"\n')
    session.set_exposure("exposure", "iso", 400.0)
    assert (session.config.exposure.iso, session.config.exposure.iso_max) == (400.0, None)
    session.set_exposure("exposure", "time", "1/60")
    assert session.config.exposure.time == pytest.approx(1 / 60)
    session.set_exposure("film", "preset", None)
    assert session.config.film.preset is None
    with pytest.raises(EditError, match=r'exposure\.iso is "fast"; expected a number'):
        session.set_exposure("exposure", "iso", "fast")
