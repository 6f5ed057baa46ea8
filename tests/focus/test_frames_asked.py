"""What a solve of all frames is asked: what is refused, and what compiles nothing anew."""

import dataclasses

import numpy as np
import pytest
from compilations import compilations

from focusjax.focus import Prior, solve_frames
from focusjax.solvers import JaxoptLBFGSB


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"smoothness": -1.0}, "smoothness is -1; expected zero or a positive finite number"),
        ({"solver": JaxoptLBFGSB()}, "solver is a JaxoptLBFGSB; frames are solved together by one solver"),
        ({"free": ("zoom",)}, "free parameters are"),
        ({"f_number_range": (4.0, 2.0)}, "the f-number range's end is 2"),
    ],
)
def test_bad_options_are_refused(make_setup, make_frames, change, message):
    camera, lens = make_setup()
    with pytest.raises(ValueError, match=message):
        solve_frames(make_frames(np.full((2, 1), 0.5)), camera, lens, **change)


def test_frames_that_do_not_fit_are_refused(make_setup, make_frames):
    camera, lens = make_setup()
    points = make_frames(np.full((3, 1), 0.5))
    with pytest.raises(ValueError, match="there are no frames"):
        solve_frames([], camera, lens)
    with pytest.raises(ValueError, match="there are 2 cameras for 3 frames"):
        solve_frames(points, [camera, camera], lens)
    with pytest.raises(ValueError, match="no wish counts in any frame"):
        solve_frames(make_frames(np.full((3, 1), 0.5), weight=0.0), camera, lens)
    other = dataclasses.replace(points[1], names=(*points[1].names[:-1], "another"))
    with pytest.raises(ValueError, match="frame 1 has the wishes"):
        solve_frames([points[0], other], camera, lens)


def test_other_lengths_and_priors_do_not_compile(make_setup, make_frames):
    camera, lens = make_setup()
    points = make_frames(np.linspace(0.3, 0.9, 6)[:, None])
    priors = {"f_number": Prior(2.8, 1.0)}
    solve_frames(points, camera, lens, free=("focus", "f_number"))
    with compilations() as compiled:
        found = solve_frames(points[:5], camera, lens, free=("focus", "f_number"), priors=priors)
    assert found.count == len(found.points.weight) == len(found.settings()["f_number"]) == 5
    assert compiled == []
