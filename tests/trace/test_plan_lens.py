"""Polynomials or glass, by what their error does to a picture."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import biconvex
from small_scenes import varied_layers

from focusjax.lens import prescription_lens
from focusjax.optics import HeightField
from focusjax.trace import plan_lens
from focusjax.trace._plan_lens import picture_slope


def test_slopes_cost_what_a_shift_by_a_pixel_does():
    """A smooth picture, shifted by 0.2 px in each of two directions: the rule against what it is off by."""
    y, x = np.mgrid[:36, :48] + 0.5

    def at(across: float, down: float) -> np.ndarray:
        waves = 0.5 + 0.3 * np.sin(0.5 * (x + across)) * np.cos(0.4 * (y + down))
        return np.repeat(waves[..., None], 3, axis=2)

    wrong = 0.5 * sum(((at(*shift) - at(0, 0)) ** 2).mean() for shift in ((0.2, 0.0), (0.0, 0.2)))
    # Observed: 1.5 %, as slopes are differences over a pixel.
    assert 0.5 * 0.2**2 * picture_slope(at(0, 0))[0] == pytest.approx(wrong, rel=0.04)


def test_highlights_cost_their_outline():
    """A light of radiance 100, 2 px wide: by squares its border would cost 100 times as much as it may."""
    light = np.zeros((36, 48, 3))
    light[10:12, 20:22] = 100.0
    slope, brightness = picture_slope(light)
    # Of 8 pixels around it all but one has a slope of 100, the last one of 141; the root counts.
    assert slope == pytest.approx((6 * 10 + 141.42**0.5) / (35 * 47), rel=0.05)
    assert brightness == pytest.approx(4 / (36 * 48))


@pytest.mark.slow
def test_the_glass_is_taken_for_references_and_where_nothing_else_will_do():
    layers = varied_layers()
    glass = prescription_lens(biconvex(), layers.camera, focus_distance=2.0, f_number=8)
    reference = plan_lens(layers, glass, "reference")
    assert reference.lens is glass
    assert reference.decibels is None
    assert "a reference is made with the glass itself" in reference.why_glass
    # The best polynomials in four variables are off by 1.1 px (by 0.08 px with heights a third of these).
    uneven = eqx.tree_at(
        lambda lens: lens.prescription.surfaces,
        glass,
        (
            glass.prescription.surfaces[0],
            HeightField(jnp.asarray(0.3 * np.random.default_rng(0).random((17, 17))), jnp.asarray(3.0)),
        ),
        is_leaf=lambda node: isinstance(node, tuple),
    )
    plan = plan_lens(layers, uneven, "draft")
    assert plan.lens is uneven
    assert "the best polynomials for biconvex are off by" in plan.why_glass
    with pytest.raises(ValueError, match="expected 10 to 80 dB"):
        plan_lens(layers, glass, "best")
