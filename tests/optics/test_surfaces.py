"""Where rays meet surfaces, what happens there, and what happens where they do not."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from optics_lenses import GLASS, asphere, biconvex

from focusjax.optics import (
    BLOCKED,
    Conic,
    HeightField,
    air,
    line,
    make_prescription,
    singlet,
    sphere,
    trace,
)

ACROSS = jnp.linspace(-12.0, 12.0, 97)
SPHERE = sphere(1 / 40.0)
SURFACES = {
    "sphere": SPHERE,
    "plane": sphere(0.0),
    "paraboloid": Conic(jnp.asarray(-1 / 30.0), jnp.asarray(-1.0)),
    "oblate": Conic(jnp.asarray(1 / 30.0), jnp.asarray(1.5)),
    "asphere": asphere().surfaces[0],
    "height field": HeightField(
        jax.vmap(lambda y: jax.vmap(lambda x: SPHERE.sag(x, y) + 0.02 * jnp.sin(0.5 * x) * y)(ACROSS))(
            ACROSS
        ),
        jnp.asarray(0.25),
    ),
}
every_surface = pytest.mark.parametrize("surface", SURFACES.values(), ids=SURFACES)
RAY = (3.0, -4.0, 0.2, 0.3, float(np.sqrt(1 - 0.13)))


def heights_of(surface, across):
    return jax.vmap(lambda y: jax.vmap(lambda x: surface.sag(x, y))(across))(across)


def rescaled(tree, factors):
    """Every number multiplied by one, so that derivatives by `factors` are of like size."""
    flat, restore = ravel_pytree(tree)
    return restore(flat * factors)


def check_slope(function, argument):
    """Derivatives of a mix of answers along a mix of arguments: forwards, in reverse, by differences."""
    flat, restore = ravel_pytree(argument)
    along = jnp.cos(jnp.arange(flat.size) + 1.0) * 0.3

    @jax.jit
    def slopes(flat):
        def mix(flat):
            answers = ravel_pytree(function(restore(flat)))[0]
            return answers @ jnp.cos(jnp.arange(answers.size) + 0.5)

        ends = jax.vmap(mix)(flat[None] + jnp.asarray([1e-5, -1e-5])[:, None] * along[None])
        return jax.jvp(mix, (flat,), (along,))[1], jax.grad(mix)(flat) @ along, (ends[0] - ends[1]) / 2e-5

    forward, reverse, difference = slopes(flat)
    assert abs(float(forward)) > 1e-3
    assert float(reverse) == pytest.approx(float(forward), rel=1e-12)
    # The differences' own error is near that.
    assert float(difference) == pytest.approx(float(forward), rel=1e-7)


@eqx.filter_jit
def met_point(surface, ray):
    x, y, u, v, w = ray
    distance, met = surface.meet(x, y, u, v, w)
    point = (x + distance * u, y + distance * v, distance * w)
    nx, ny, nz = surface.normal(*point)
    length = jnp.sqrt(nx**2 + ny**2 + nz**2)
    return (*point, nx / length, ny / length, nz / length), met


@every_surface
@pytest.mark.parametrize("ahead", [1.0, -1.0])
def test_rays_meet_the_surface_at_right_angles_to_its_slope(surface, ahead):
    ray = [jnp.asarray(value) for value in (*RAY[:4], ahead * RAY[4])]
    (x, y, z, nx, ny, nz), met = met_point(surface, ray)
    assert bool(met)
    # Observed: 4e-16.
    assert float(z) == pytest.approx(float(surface.sag(x, y)), abs=1e-13)
    slopes = jax.grad(surface.sag, argnums=(0, 1))(x, y)
    np.testing.assert_allclose([-nx / nz, -ny / nz], slopes, atol=1e-13)


@every_surface
def test_gradients_match_differences(surface):
    """By the surface's shape and the ray: through Newton's method as well."""
    ray = [jnp.asarray(value) for value in RAY]
    if isinstance(surface, HeightField):
        # By the heights there are thousands.
        check_slope(lambda ray: met_point(surface, ray)[0], ray)
    else:
        factors = jnp.ones(ravel_pytree(surface)[0].shape)
        check_slope(lambda given: met_point(rescaled(surface, given[0]), given[1])[0], (factors, ray))


@every_surface
def test_the_osculating_sphere_and_what_is_beyond_it(surface):
    if isinstance(surface, HeightField):
        surface = HeightField(heights_of(SPHERE, ACROSS), jnp.asarray(0.25))
    c, fourth = (float(value) for value in surface.osculating())
    r = 0.5
    expected = c * r**2 / 2 + (c**3 / 8 + fourth) * r**4
    found = float(surface.sag(jnp.asarray(r), jnp.asarray(0.0)))
    # What is left is of r^6, or from the height field's differences.
    assert found == pytest.approx(expected, rel=2e-4, abs=1e-12)


@every_surface
def test_scaling_scales_all_lengths(surface):
    scaled = surface.scaled(jnp.asarray(3.0))
    at, larger = (jnp.asarray(1.7), jnp.asarray(-2.1)), (jnp.asarray(5.1), jnp.asarray(-6.3))
    assert float(scaled.sag(*larger)) == pytest.approx(3 * float(surface.sag(*at)), rel=1e-12)


def test_a_height_field_meets_rays_as_the_surface_that_it_samples():
    """The error of points and normals falls nearly with the second power of the spacing."""
    starts = jnp.asarray(np.random.default_rng(1).uniform(-6, 6, (2, 64)))
    u, v, w = (jnp.full(64, value) for value in RAY[2:])
    errors = []
    for count in (25, 49):
        across = jnp.linspace(-12.0, 12.0, count)
        field = HeightField(heights_of(SPHERE, across), jnp.asarray(24.0 / (count - 1)))
        found, wanted = (
            np.array(jax.vmap(lambda *ray, one=one: met_point(one, ray)[0])(*starts, u, v, w))
            for one in (field, SPHERE)
        )
        errors.append(np.abs(found - wanted).max())
    # Observed: 3.6e-5 and 1.0e-5.
    assert errors[1] < errors[0] / 3
    assert errors[1] < 2e-5


@eqx.filter_jit
def through(lens, y, slope=0.0, backward=False):
    start = jnp.asarray([0.0, y, 60.0 if backward else -20.0])
    way = jnp.asarray([0.0, slope, -1.0 if backward else 1.0])
    return trace(lens, lens.indices(line()), start, way / jnp.linalg.norm(way), backward=backward)


@eqx.filter_jit
def rim_ray_and_slopes(lens, y, slope=0.0):
    """A ray, and its derivatives by everything."""

    def answer(arguments):
        ray = through(arguments[0], arguments[1], arguments[2])
        return jnp.concatenate([ray.position, ray.direction, ray.clearance[None]])

    arguments = (lens, jnp.asarray(y), jnp.asarray(slope))
    slopes = eqx.filter_grad(lambda arguments: answer(arguments) @ jnp.arange(1.0, 8.0))(arguments)
    return answer(arguments), jax.tree.leaves(slopes)


@pytest.mark.parametrize(
    ("lens", "y", "slope"),
    [
        pytest.param(singlet(12.0, -50.0, thickness=12, semi_diameter=11, glass=GLASS), 13.0, 0.0, id="miss"),
        pytest.param(
            singlet(float("inf"), -10.0, thickness=12, semi_diameter=9.9, glass=GLASS),
            9.5,
            0.0,
            id="reflection",
        ),
        pytest.param(asphere(), 60.0, 0.0, id="beyond an asphere"),
        pytest.param(biconvex(), 0.0, 40.0, id="nearly at right angles to the axis"),
    ],
)
def test_rays_that_do_not_get_through_are_blocked_and_finite(lens, y, slope):
    answer, slopes = rim_ray_and_slopes(lens, y, slope)
    assert float(answer[-1]) == BLOCKED
    np.testing.assert_array_equal(answer[:2], 0.0)
    np.testing.assert_array_equal(answer[3:6], [0.0, 0.0, 1.0])
    assert all(np.isfinite(leaf).all() for leaf in [answer, *slopes])


def test_clearance_is_what_is_left_to_the_rim():
    lens = biconvex()
    assert float(through(lens, 0.0).clearance) == 1.0
    # The stop is the first surface, of 9 mm.
    assert float(through(lens, 4.5).clearance) == pytest.approx(0.5)
    assert float(through(lens, 10.8).clearance) == pytest.approx(-0.2)
    assert all(np.isfinite(leaf).all() for leaf in rim_ray_and_slopes(lens, 0.0)[1])


def test_a_ball_lens_brings_rays_to_its_focus():
    """Two hemispheres: the focal length is n R / (2 (n - 1)), from the centre."""
    ball = singlet(10.0, -10.0, thickness=20.0, semi_diameter=10.0, glass=GLASS)
    ray = through(ball, 1e-4)
    n = float(GLASS.index(line()))
    crossing = float(ray.position[2] - ray.position[1] * ray.direction[2] / ray.direction[1]) - 10.0
    assert crossing == pytest.approx(n * 10.0 / (2 * (n - 1)), rel=1e-8)


@pytest.mark.parametrize("thickness", [0.0, 4.0])
def test_index_one_and_zero_thickness_bend_nothing(thickness):
    nothing = make_prescription(
        [sphere(1 / 20.0), sphere(1 / 20.0)], [thickness, 0.0], [8.0, 8.0], [air(), air()], stop=0
    )
    ray = through(nothing, 5.0, 0.1)
    np.testing.assert_allclose(ray.direction[1] / ray.direction[2], 0.1, rtol=1e-14)
    np.testing.assert_allclose(ray.position[1], 5.0 + 0.1 * (ray.position[2] + 20.0), rtol=1e-14)


def test_a_ray_goes_back_the_way_it_came():
    for lens in (biconvex(), asphere()):
        ray = through(lens, 6.0, 0.05)
        start, way = ray.position + 7.0 * ray.direction, -ray.direction
        back = trace(lens, lens.indices(line()), start, way, backward=True)
        along = (back.position[1] - 6.0) / (back.position[2] + 20.0)
        # Observed: 1e-15.
        np.testing.assert_allclose(along, 0.05, rtol=1e-12)
        np.testing.assert_allclose(back.direction[1] / back.direction[2], 0.05, rtol=1e-12)
        assert float(back.clearance) == pytest.approx(float(ray.clearance), abs=1e-12)


def test_a_traced_ray_has_the_derivatives_of_differences():
    lens = asphere()

    def landing(given):
        factors, y, slope = given
        ray = through(rescaled(lens, factors), y, slope)
        return ray.position, ray.direction, ray.clearance

    # By all of glass, curvature, thickness, asphere and ray.
    factors = jnp.ones(ravel_pytree(lens)[0].shape)
    check_slope(landing, (factors, jnp.asarray(5.0), jnp.asarray(0.04)))
