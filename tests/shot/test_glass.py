"""A shot through a real lens: focused in every frame as a still is, and without a jump in between."""

import re

import numpy as np
import pytest
from boxes_config import write_boxes

from focusjax.config import ConfigError, load_config
from focusjax.job import run
from focusjax.shot import build_shot, solve_shot

CHANGES = [
    'lens.prescription="gauss_jp62087922_f1.8_1987"',
    "lens.focus_distance_m=inf",
    "solve={free=['focus']}",
    "focus=[{name='front', point=[-0.4, 0, -1.75], sharp=true}]",
]


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return write_boxes(tmp_path_factory.mktemp("boxes"))


@pytest.mark.slow
def test_every_frame_is_focused_as_a_still_is(boxes):
    """The wish counts in full in the first two of three frames; the last one keeps their offset."""
    shot = ["shot={frames=3, fade_frames=0, wishes=[{name='front', to_frame=2}]}"]
    solved = solve_shot(build_shot(load_config(boxes, [*CHANGES, *shot])))
    glass, thin = solved.glass, solved.solution.settings()["focus_per_m"]
    assert glass.by_wishes == (1, 2)
    assert set(glass.blur[0]) == {"front"}
    assert glass.blur[2] == {}
    still = run(load_config(boxes, CHANGES), rendering=False).glass
    for frame in (0, 1):
        assert glass.focus_per_m[frame] == pytest.approx(1 / float(still.exact.focus_distance()), rel=1e-4)
    np.testing.assert_allclose(glass.focus_per_m - thin, glass.focus_per_m[0] - thin[0], rtol=1e-3)
    _, lens = solved.seen_with(3, fit=False)
    assert 1 / float(lens.focus_distance()) == pytest.approx(glass.focus_per_m[2], rel=1e-5)


def test_glass_is_not_turned(boxes):
    turned = "shot={frames=2, lens=[{frame=1, tilt_deg=3}]}"
    message = "keyframes of tilt_deg and a lens.prescription, which has no such setting; leave one out"
    with pytest.raises(ConfigError, match=re.escape(message)):
        build_shot(load_config(boxes, [*CHANGES, turned]))
