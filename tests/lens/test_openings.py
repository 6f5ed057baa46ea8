"""Openings that are not whole and even: their light is where it should be, and exposure stays."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gradients import central_differences

from focusjax.lens import (
    AbstractAperture,
    Disk,
    apodized,
    mask,
    obstructed,
    polygon,
    radial_spline,
    squeezed,
)

PICTURE = np.random.default_rng(0).uniform(size=(5, 8)) * np.array([[1.0, 0.0, 1.0, 1.0, 0.2, 0.0, 0.6, 1.0]])

OPENINGS = [
    # The last: how far means over samples may be from means weighted by density. Observed: 1e-17, 1e-17,
    # 6e-5 (the density falls to 0 within a step of the table), 4e-4 (a cusp at each corner), 4e-5, 3e-4.
    pytest.param(obstructed(0.4), 1e-12, id="obstructed"),
    pytest.param(squeezed(1.5, obstructed(0.4, polygon(5))), 1e-12, id="squeezed, obstructed, blades"),
    pytest.param(apodized([1.0, 0.0]), 2e-4, id="apodized"),
    pytest.param(apodized([1.0, 0.5, 2.0], polygon(5, roundness=0.3)), 1e-3, id="apodized blades"),
    pytest.param(apodized([1.0, 0.2], obstructed(0.3)), 2e-4, id="apodized, obstructed"),
    pytest.param(squeezed(2.0, mask(PICTURE)), 1e-3, id="squeezed mask"),
]


def grid(count: int) -> jnp.ndarray:
    middle = (jnp.arange(count) + 0.5) / count
    return jnp.stack(jnp.meshgrid(middle, middle), axis=-1).reshape(-1, 2)


@eqx.filter_jit
def drawn_and_even(opening: AbstractAperture) -> tuple[jnp.ndarray, jnp.ndarray, jnp.ndarray]:
    """Points as rays are drawn, points that are uniform by area, and the density there."""
    even = jax.vmap(opening.at)(grid(240))
    return jax.vmap(opening.point)(grid(240)), even, jax.vmap(opening.density)(even)


@eqx.filter_jit
def shares_over_the_plane(opening: AbstractAperture) -> tuple[jnp.ndarray, jnp.ndarray]:
    """Of places all over the square around the opening, and of where rays are drawn."""
    all_over = jax.vmap(opening.share)(2.0 * grid(400) - 1.0)
    return all_over, jax.vmap(opening.share)(0.9999 * jax.vmap(opening.point)(grid(60)))


@pytest.mark.parametrize(
    "opening",
    [
        pytest.param(Disk(), id="disk"),
        pytest.param(polygon(5, rotation=0.4, roundness=0.3), id="blades"),
        *(pytest.param(each.values[0], id=each.id) for each in OPENINGS),
    ],
)
def test_light_is_shared_out_over_the_plane(opening: AbstractAperture):
    shares, within = map(np.asarray, shares_over_the_plane(opening))
    assert (shares >= 0).all()
    # Of a sum over squares of a 200th of the radius. Observed: at most 1.1e-3.
    assert 4.0 * shares.mean() == pytest.approx(1.0, abs=5e-3)
    # Each ray is drawn where light is, but for rounding at the rims.
    assert (within > 0).mean() > 0.99


@pytest.mark.parametrize(("opening", "off"), OPENINGS)
def test_rays_are_drawn_with_the_density_of_light(opening: AbstractAperture, off: float):
    drawn, even, density = (np.asarray(a) for a in drawn_and_even(opening))
    assert density.mean() == pytest.approx(1.0, abs=off)
    assert (density >= 0).all()
    assert np.linalg.norm(drawn, axis=1).max() <= 1.0
    for moment in (
        lambda p: p[:, 0],
        lambda p: p[:, 1] ** 2,
        lambda p: (p**2).sum(axis=1) ** 2,
        lambda p: np.cos(5 * p[:, 0] + 3 * p[:, 1]),
    ):
        assert moment(drawn).mean() == pytest.approx((moment(even) * density).mean(), abs=off)


def test_an_obstruction_leaves_a_ring():
    drawn, even, _ = (np.asarray(a) for a in drawn_and_even(obstructed(0.4)))
    for points in (drawn, even):
        radius = np.linalg.norm(points, axis=1)
        assert radius.min() > 0.4
        # r^2 is uniform between the edges. Observed: 3e-17.
        assert (radius**2).mean() == pytest.approx((1 + 0.4**2) / 2, abs=1e-12)


def test_a_squeezed_disk_is_an_ellipse():
    points, _, _ = (np.asarray(a) for a in drawn_and_even(squeezed(2.0, Disk())))
    # Observed: 1e-5 relative.
    np.testing.assert_allclose((points**2).mean(axis=0), [1 / 16, 1 / 4], rtol=1e-4)


def test_a_transmission_of_1_less_r_squared():
    """Of which the share within r is 2 r^2 - r^4."""
    points = np.asarray(drawn_and_even(apodized([1.0, 0.0]))[0])
    radius = np.sort(np.linalg.norm(points, axis=1))
    share = (np.arange(len(radius)) + 0.5) / len(radius)
    # Observed: 2.1e-3, half a step of the samples' grid.
    np.testing.assert_allclose(2 * radius**2 - radius**4, share, atol=5e-3)


def test_a_mask_is_its_image():
    """Light per pixel, of a picture blurred by the bilinear kernel; upright, its middle in the middle."""
    opening = mask(PICTURE)
    points, _, _ = (np.asarray(a) for a in drawn_and_even(opening))
    steps = 2 * np.asarray(opening.half) / np.array([9, 6])
    place = points / steps + np.array([3.5, 2.0])
    found = np.zeros(PICTURE.shape)
    for (row, column), _ in np.ndenumerate(PICTURE):
        near = np.abs(place - np.array([column, row]))
        found[row, column] = (np.clip(1 - near, 0, None).prod(axis=1)).mean()
    kernel = np.array([1, 4, 1]) / 6
    wide = np.pad(PICTURE, 1)
    expected = (
        sum(kernel[i] * kernel[j] * wide[i : i + 5, j : j + 8] for i in range(3) for j in range(3))
        / PICTURE.sum()
    )
    # Observed: 1e-4.
    np.testing.assert_allclose(found, expected, atol=5e-4)
    corner = np.abs(points).max(axis=0) / np.asarray(opening.half)
    assert (corner < 1).all()


def test_a_profile_meets_its_values_and_any_parabola():
    radii = np.linspace(0, 1, 101)
    at = eqx.filter_jit(lambda profile: (profile(jnp.asarray(radii)), profile.extent(), profile.defocus()))
    found, (least, most), _ = at(radial_spline([0.3, -0.2, 0.9, 0.5, 0.1]))
    np.testing.assert_allclose(found[::25], [0.3, -0.2, 0.9, 0.5, 0.1], atol=1e-15)
    assert (found >= least).all()
    assert (found <= most).all()
    for count in (2, 3, 7):
        found, _, defocus = at(radial_spline(1.0 - 2.0 * np.linspace(0, 1, count) ** 2))
        # Observed: 4e-16.
        np.testing.assert_allclose(found, 1.0 - 2.0 * radii**2, atol=1e-14)
        assert float(defocus) == pytest.approx(1.0 - 2.0 * 2 / 3, abs=1e-14)


@eqx.filter_jit
def slopes_of_a_point(opening: AbstractAperture, sample: jnp.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
    """By the sample, forwards and by differences [2, 2]."""
    return jax.jacfwd(opening.point)(sample).T, central_differences(opening.point, sample)


def test_derivatives_of_drawn_points_by_the_sample():
    """By the values of an image and a transmission: test_contract."""
    for opening in (
        squeezed(1.5, mask(PICTURE[:, :3])),
        apodized([1.0, 0.5, 0.7], obstructed(0.3, polygon(5))),
    ):
        # Observed: 6e-10.
        np.testing.assert_allclose(*slopes_of_a_point(opening, jnp.array([0.37, 0.61])), atol=1e-7)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: obstructed(1.0), "obstruction is 1.0; expected a share of the diameter"),
        (lambda: obstructed(0.5, obstructed(0.5)), "stands in a Obstructed; expected a disk or blades"),
        (lambda: squeezed(0.5, Disk()), "squeeze is 0.5; expected 1 or more"),
        (lambda: apodized([1.0]), r"values of shape \(1,\); give two or more"),
        (lambda: apodized([1.0, -0.1]), r"transmission is \[1.0, -0.1\]; expected light"),
        (lambda: apodized([0.0, 0.0]), "expected light, 0 or more, not all 0"),
        (lambda: apodized([1.0, 0.5], mask([[1.0]])), "given to a Mask; expected a disk or blades"),
        (lambda: apodized([1.0, float("nan")]), "expected finite numbers"),
        (lambda: mask([[0.0, 0.0]]), "black all over; leave something white"),
        (lambda: mask([[-1.0, 2.0]]), "negative or not finite; expected light"),
        (lambda: mask(np.ones((2, 2, 3))), r"has shape \(2, 2, 3\); expected rows and columns"),
    ],
)
def test_openings_that_cannot_be_are_refused(make, message: str):
    with pytest.raises(ValueError, match=message):
        make()
