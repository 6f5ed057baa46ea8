"""Focusing by rays: the smallest spots, whatever the lens, and derivatives through the search."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import biconvex

from focusjax.focus import ImagePoints, focus_by_rays, solve, spots
from focusjax.focus._by_rays import _search
from focusjax.geometry import make_camera
from focusjax.lens import (
    AberratedLens,
    FocalSurfaceLens,
    focal_surface,
    focal_surface_lens,
    moved_film,
    power_profile,
    prescription_lens,
    thin_lens,
)

CAMERA = make_camera(jnp.eye(4), width=60, height=40, focal_length=0.05)
AXIS, CORNER = (30.0, 20.0), (55.0, 35.0)


def sharp(*rows: tuple[tuple[float, float], float], weight: float = 1.0, target: float = 0.0) -> ImagePoints:
    """Points (pixel, disparity) wished sharp; two rows, so that one program serves all."""
    count = len(rows)
    return ImagePoints(
        xy=jnp.array([xy for xy, _ in rows]),
        disparity=jnp.stack([jnp.asarray(w, dtype=float) for _, w in rows]),
        target=jnp.full(count, target),
        signed=jnp.ones(count, dtype=bool),
        weight=jnp.full(count, weight),
        tolerance=jnp.ones(count),
        wish=jnp.arange(count),
        names=tuple(f"wish {number}" for number in range(count)),
    )


@pytest.fixture(scope="module")
def thin():
    return thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)


@pytest.fixture(scope="module")
def single():
    return prescription_lens(biconvex(), CAMERA, focus_distance=2.0, f_number=4)


def test_a_thin_lens_is_focused_as_by_its_blur(thin):
    points = sharp((AXIS, 0.5), (CORNER, 0.6))
    found = focus_by_rays(points, CAMERA, thin)
    wanted = solve(points, CAMERA, thin).lens
    # Observed: 1e-12.
    assert float(found.lens.focus_disparity) == pytest.approx(float(wanted.focus_disparity), abs=1e-9)
    # A disk's RMS diameter is its diameter over the root of two. Observed: 4e-4.
    blur = abs(float(wanted.blur(CAMERA, jnp.array(AXIS), jnp.asarray(0.5))))
    assert float(found.spots[0]) == pytest.approx(blur / np.sqrt(2), rel=3e-3)


def test_aberrations_have_their_say(thin):
    """A rim that focuses nearer by 0.1 dioptre draws the best focus to where that is made up for."""
    soft = AberratedLens(thin, (power_profile([0.0, 0.1]),))
    found = focus_by_rays(sharp((AXIS, 0.5), (AXIS, 0.5)), CAMERA, soft)
    # Power rises as r^2, and r (w_0 + 0.1 r^2 - 0.5) is least over a disk at 0.5 - 0.1 mean(r^4) / mean(r^2).
    # Observed: 6e-5 off.
    assert float(found.focus_disparity) == pytest.approx(0.5 - 0.1 * 2 / 3, abs=1e-3)


def test_a_real_lens_has_its_smallest_spots_there(single):
    """The field of a simple lens is curved: the corner's focus is far from the axis's."""
    focused = {}
    for name, place in (("axis", AXIS), ("corner", CORNER)):
        found = focus_by_rays(sharp((place, 0.5), (place, 0.5)), CAMERA, single)
        focus = focused[name] = float(found.focus_disparity)
        xy, disparity = jnp.array([place] * 2), jnp.full(2, 0.5)
        beside = [
            float(spots(xy, disparity, CAMERA, moved_film(single, CAMERA, jnp.asarray(focus + step)))[0])
            for step in (-0.02, 0.0, 0.02)
        ]
        assert beside[1] < min(beside[0], beside[2])
        assert beside[1] == pytest.approx(float(found.spots[0]))
    # Observed: 0.502 and -2.37, as the film has to come nearer to the lens by 7 mm.
    assert focused["axis"] == pytest.approx(0.5, abs=0.01)
    assert focused["corner"] < -1.5


@pytest.mark.slow
def test_derivatives_are_those_of_focusing_again(single):
    """By where a point is, and by the curvature of the glass."""
    curvature = lambda lens: lens.prescription.surfaces[0].curvature  # noqa: E731

    xy, weight = jnp.array([AXIS, (40.0, 26.0)]), jnp.ones(2)

    def focus(given):
        lens = eqx.tree_at(curvature, single, given[1])
        # What `focus_by_rays` compiles, without the bounds of the lens that it returns.
        return _search(xy, jnp.stack([jnp.asarray(0.5), given[0]]), weight, CAMERA, lens, 64)[0]

    given = jnp.stack([jnp.asarray(0.55), curvature(single)])
    step = jnp.array([1.0, 0.02])
    slope = jax.jvp(focus, (given,), (step,))[1]
    difference = (focus(given + 1e-5 * step) - focus(given - 1e-5 * step)) / 2e-5
    assert float(slope) == pytest.approx(float(difference), rel=1e-6)


def test_what_cannot_be_focused_is_refused(thin):
    points = sharp((AXIS, 0.5), (CORNER, 0.6))
    with pytest.raises(ValueError, match="nothing is wished sharp; rays are focused on what is"):
        focus_by_rays(sharp((AXIS, 0.5), (CORNER, 0.6), target=5.0), CAMERA, thin)
    with pytest.raises(ValueError, match="the lens is a pinhole, to which all is sharp; open it"):
        focus_by_rays(points, CAMERA, thin_lens(focus_distance=2.0, aperture_radius=0.0))
    surface = focal_surface([AXIS, CORNER], [0.5, 0.6])
    bent = focal_surface_lens(surface, CAMERA, thin)
    assert isinstance(bent, FocalSurfaceLens)
    with pytest.raises(ValueError, match="a FocalSurfaceLens has no one focus to set"):
        focus_by_rays(points, CAMERA, bent)
