"""Openings are sampled uniformly by area, and look as documented."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.lens import AbstractAperture, Disk, polygon

OPENINGS = [
    pytest.param(Disk(), 0, 1.0, id="disk"),
    *(
        pytest.param(polygon(n, rotation=0.4, roundness=r), n, r, id=f"{n} blades, roundness {r}")
        for n, r in ((3, 0.0), (3, 0.5), (5, 0.0), (5, 0.5), (5, 1.0), (11, 0.2))
    ),
]


def grid(count: int) -> jnp.ndarray:
    """Middles of `count` x `count` cells of the unit square."""
    middle = (jnp.arange(count) + 0.5) / count
    return jnp.stack(jnp.meshgrid(middle, middle), axis=-1).reshape(-1, 2)


@eqx.filter_jit
def points_of(opening: AbstractAperture, samples: jnp.ndarray) -> jnp.ndarray:
    return jax.vmap(opening.point)(samples)


@eqx.filter_jit
def stretch(opening: AbstractAperture, samples: jnp.ndarray) -> jnp.ndarray:
    """Jacobian [n, 2, 2] of the map."""
    return jax.vmap(jax.jacfwd(opening.point))(samples)


@eqx.filter_jit
def shares(opening: AbstractAperture) -> jnp.ndarray:
    """Of light, in the middle, within the rim by little, and beyond it [3, n]."""
    rim = jax.vmap(opening.rim)((jnp.arange(40) + 0.5) / 40)
    return jnp.stack([jax.vmap(opening.share)(rim * scale) for scale in (0.0, 0.999, 1.001)])


def area_and_moment(blades: int, roundness: float) -> tuple[float, float]:
    """Area of the opening and the mean of r^2 over it, integrated in closed form over the angle."""
    if blades == 0:
        return np.pi, 0.5
    half = np.pi / blades
    straight, tangent = (1 - roundness) * np.cos(half) ** 2, np.tan(half)
    squared = straight * tangent + roundness * half
    fourth = (
        straight**2 * (tangent + tangent**3 / 3) + 2 * straight * roundness * tangent + roundness**2 * half
    )
    return blades * squared, fourth / (2 * squared)


@pytest.mark.parametrize(("opening", "blades", "roundness"), OPENINGS)
def test_the_map_preserves_area_everywhere(opening: AbstractAperture, blades: int, roundness: float):
    jacobian = stretch(opening, grid(30))
    area, _ = area_and_moment(blades, roundness)
    # Observed: 2e-14 relative.
    np.testing.assert_allclose(np.abs(np.linalg.det(jacobian)), area, rtol=1e-9)


@pytest.mark.parametrize(("opening", "blades", "roundness"), OPENINGS)
def test_moments_match_closed_forms(opening: AbstractAperture, blades: int, roundness: float):
    points = np.asarray(points_of(opening, grid(120)))
    _, expected = area_and_moment(blades, roundness)
    # Observed: centroid 3e-3 at worst (the grid does not divide into the blades), moments 4e-5 relative.
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=5e-3)
    assert (points**2).sum(axis=1).mean() == pytest.approx(expected, rel=1e-3)
    second = points.T @ points / len(points)
    np.testing.assert_allclose(second, np.eye(2) * expected / 2, atol=5e-3)


def test_a_triangle_and_a_square_have_the_moments_of_textbooks():
    assert area_and_moment(3, 0.0) == pytest.approx((3 * np.sqrt(3) / 4, 0.25))
    assert area_and_moment(4, 0.0) == pytest.approx((2.0, 1 / 3))
    assert area_and_moment(7, 1.0) == pytest.approx((np.pi, 0.5))


@pytest.mark.parametrize(("opening", "blades", "roundness"), OPENINGS)
def test_the_opening_fills_the_unit_disk_but_never_leaves_it(
    opening: AbstractAperture, blades: int, roundness: float
):
    side = jnp.linspace(0.0, 1.0, 2 * max(blades, 4) + 1)
    points = points_of(opening, jnp.stack(jnp.meshgrid(side, side), axis=-1).reshape(-1, 2))
    radius = np.linalg.norm(points, axis=1)
    assert radius.max() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("roundness", [0.0, 0.5])
def test_the_first_corner_turns_clockwise_on_screen(roundness: float):
    """Angles run from +x (right) towards +y (down)."""
    for rotation in (0.0, 0.3, -1.0):
        opening = polygon(5, rotation=rotation, roundness=roundness)
        corner, middle = points_of(opening, jnp.array([(0.0, 1.0), (0.1, 1.0)]))
        np.testing.assert_allclose(corner, [np.cos(rotation), np.sin(rotation)], atol=1e-12)
        angle = rotation + np.pi / 5
        distance = np.sqrt((1 - roundness) * np.cos(np.pi / 5) ** 2 + roundness)
        np.testing.assert_allclose(middle, distance * np.array([np.cos(angle), np.sin(angle)]), atol=1e-12)


def test_the_disk_map_keeps_neighbours_together():
    """Along any row or column of the square, points move on by little."""
    points = np.asarray(points_of(Disk(), grid(64))).reshape(64, 64, 2)
    for axis in (0, 1):
        # Observed: 0.049, about twice the grid's step in a disk of diameter 2.
        assert np.linalg.norm(np.diff(points, axis=axis), axis=-1).max() < 0.06


@pytest.mark.parametrize(
    ("blades", "roundness", "message"),
    [
        (2, 0.0, "an aperture has 2 blades; expected a whole number, at least 3, or a disk"),
        (5, -0.1, r"blade roundness is -0\.1; expected between 0 \(straight\) and 1 \(round\)"),
        (5, 1.5, r"blade roundness is 1\.5; expected between 0 \(straight\) and 1 \(round\)"),
        (5, float("nan"), "blade roundness is nan; expected between 0"),
    ],
)
def test_bad_blades_are_refused(blades: int, roundness: float, message: str):
    with pytest.raises(ValueError, match=message):
        polygon(blades, roundness=roundness)


@pytest.mark.parametrize("rotation", [float("nan"), float("inf")])
def test_a_rotation_that_is_not_finite_is_refused(rotation: float):
    with pytest.raises(ValueError, match="rotation is"):
        polygon(5, rotation=rotation)


@pytest.mark.parametrize(("opening", "blades", "roundness"), OPENINGS)
def test_the_share_of_light_is_one_over_the_area_inside_the_rim(
    opening: AbstractAperture, blades: int, roundness: float
):
    area, _ = area_and_moment(blades, roundness)
    middle, inside, outside = map(np.asarray, shares(opening))
    np.testing.assert_allclose(inside, 1 / area, rtol=1e-12)
    assert not outside.any()
    np.testing.assert_allclose(middle, 1 / area, rtol=1e-6)
