"""Whether post-processing reaches a quality is known before it is chosen."""

import dataclasses
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, varied_scene, wide_lens

from focusjax.layers import Layers, peel
from focusjax.metrics import psnr
from focusjax.post import PinholeView, plan_post, post_process, view_in_layers
from focusjax.trace import render


@cache
def layers() -> Layers:
    camera = front_camera(96, 72)
    return peel(varied_scene(), camera, wide_lens(camera), supersampling=1)


@cache
def view() -> PinholeView:
    return view_in_layers(layers(), varied_scene())


def test_what_is_expected_is_reached():
    lens = layers().lens
    plan = plan_post(view(), layers(), lens, "draft")
    picture = np.asarray(post_process(view(), layers().camera, lens, taps=plan.taps))
    reached = psnr(picture, np.asarray(render(layers(), lens, rays=512, smooth=False, seed=50)))
    # Observed: 0.1 dB apart.
    assert plan.decibels == pytest.approx(reached, abs=0.5)
    assert reached - 1.5 < plan.at_least < reached + 0.3
    assert plan.seconds > 0
    assert plan.fewest_seconds > 0


def test_what_is_just_expected_is_not_sure_enough():
    plan = plan_post(view(), layers(), layers().lens, 30)
    for wanted, reaches in ((plan.at_least - 0.01, True), (0.5 * (plan.at_least + plan.decibels), False)):
        assert plan_post(view(), layers(), layers().lens, wanted).reaches == reaches


def test_views_that_move_are_refused():
    moving = dataclasses.replace(view(), velocity=jnp.zeros((72, 96, 2)))
    with pytest.raises(ValueError, match="layers are of one moment; leave its velocities out"):
        plan_post(moving, layers(), layers().lens, "draft")
    with pytest.raises(ValueError, match="quality is 'best'; expected 10 to 80 dB"):
        plan_post(view(), layers(), layers().lens, "best")
