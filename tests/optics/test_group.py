"""Focusing by a group of elements that moves, the film where it is."""

import jax.numpy as jnp
import pytest
from compilations import compilations

from focusjax.geometry import look_at
from focusjax.lens import prescription_lens
from focusjax.optics import (
    air,
    film_distance,
    first_order,
    focused_by_group,
    index_glass,
    lens_preset,
    line,
    make_prescription,
    shifted_group,
    sphere,
)

GLASS = index_glass(1.5)


def two_thin_lenses():
    """Focal lengths of 80 and 100 mm, 20 mm apart; so narrow that surfaces without thickness hardly cross."""
    curvatures = [1 / 80.0, -1 / 80.0, 1 / 100.0, -1 / 100.0]
    return make_prescription(
        [sphere(c) for c in curvatures],
        [0.0, 20.0, 0.0, 0.0],
        [5e-3] * 4,
        [GLASS, air(), GLASS, air()],
        stop=0,
    )


@pytest.mark.parametrize("distance", [500.0, 2000.0])
def test_a_thin_front_group_moves_as_newton_says(distance):
    """By f^2 / (s - f), which keeps its image where the rest expects it."""
    lens = two_thin_lenses()
    nearer = focused_by_group(lens, 0, 1, 1.0 / distance)
    moved = float(nearer.thicknesses[1] - lens.thicknesses[1])
    # Observed: 1e-13.
    assert moved == pytest.approx(80.0**2 / (distance - 80.0), rel=1e-9)
    assert float(nearer.thicknesses[0]) == 0.0


@pytest.mark.parametrize("group", [(0, 1), (2, 4), (5, 6)])
def test_the_film_stays(group):
    lens = lens_preset("cooke_triplet_50mm_f4")
    nearer = focused_by_group(lens, *group, 1 / 3000)
    indices = lens.indices(line())
    places = []
    for one, disparity in ((lens, 0.0), (nearer, 1 / 3000)):
        behind = film_distance(one, indices, jnp.asarray(disparity))[0]
        places.append(float(behind if group[0] == 0 else behind + one.vertices()[-1]))
    # Observed: 1e-14.
    assert places[1] == pytest.approx(places[0], abs=1e-9)


def test_a_real_lens_focuses_by_its_front_group():
    camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
    triplet = lens_preset("cooke_triplet_50mm_f4")
    lens = prescription_lens(
        triplet, camera, focus_distance=2.0, f_number=11.0, group=(0, 1), focus="paraxial"
    )
    assert float(lens.film_place) == pytest.approx(
        float(first_order(triplet).back_focal_distance) * 50.0 / float(first_order(triplet).focal_length),
        rel=1e-6,
    )
    # Where the rays of the middle are closest together, which spherical aberration moves. Observed: 0.525.
    assert float(lens.bounds.focus[0]) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    ("group", "distance", "message"),
    [
        ((0, 3), 2000.0, "is surfaces 0 to 3; expected some of 0 to 3, not all of them"),
        ((2, 1), 2000.0, "is surfaces 2 to 1; expected some of 0 to 3"),
        ((2, 3), 150.0, "would have to move by .* into their neighbours|which does not do"),
    ],
)
def test_groups_that_cannot_focus_are_refused(group, distance, message):
    with pytest.raises(ValueError, match=message):
        focused_by_group(two_thin_lenses(), *group, 1.0 / distance)


def test_shifting_keeps_all_else_in_place():
    moved = shifted_group(two_thin_lenses(), 2, 3, 4.0)
    assert moved.thicknesses.tolist() == [0.0, 24.0, 0.0, -4.0]


def test_another_distance_compiles_nothing():
    lens = two_thin_lenses()
    focused_by_group(lens, 0, 1, 1.0 / 500.0)
    with compilations() as compiled:
        focused_by_group(lens, 0, 1, 1.0 / 700.0)
    assert compiled == []
