"""What is refused of the way layers are to be made."""

import pytest
from small_scenes import front_camera, varied_scene, wide_lens

from focusjax.layers import decompose, peel


@pytest.mark.parametrize("near", [0, -1.0, float("inf"), float("nan")])
@pytest.mark.parametrize("make", [peel, lambda *view, **how: decompose(*view, count=2, **how)])
def test_near_is_a_depth(make, near):
    camera = front_camera()
    with pytest.raises(ValueError, match=f"near is {near}; expected a positive depth in metres, or None"):
        make(varied_scene(), camera, wide_lens(camera), near=near)
