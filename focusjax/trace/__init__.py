"""Tracing lens rays through layers."""

from focusjax.trace._body_motion import moved_ray as moved_ray
from focusjax.trace._exposed import Span as Span
from focusjax.trace._exposed import exposed as exposed
from focusjax.trace._known_light import light_map as light_map
from focusjax.trace._moving import MovingLayers as MovingLayers
from focusjax.trace._moving import moving_layers as moving_layers
from focusjax.trace._nearest import nearest_in_layers as nearest_in_layers
from focusjax.trace._pinhole import render_pinhole as render_pinhole
from focusjax.trace._plan import RayPlan as RayPlan
from focusjax.trace._plan import decibels_of as decibels_of
from focusjax.trace._plan import plan_rays as plan_rays
from focusjax.trace._plan_lens import NO_TILTED_FIT as NO_TILTED_FIT
from focusjax.trace._plan_lens import LensPlan as LensPlan
from focusjax.trace._plan_lens import plan_lens as plan_lens
from focusjax.trace._quality import QualityEstimate as QualityEstimate
from focusjax.trace._quality import estimate_quality as estimate_quality
from focusjax.trace._reach import check_reach as check_reach
from focusjax.trace._reach import widest_opening as widest_opening
from focusjax.trace._render import render as render
from focusjax.trace._timed import Timing as Timing
