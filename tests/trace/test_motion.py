"""The flow of rays against derivatives of pictures that are smooth, for every parameter of every lens."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from focusjax.geometry import Camera, make_camera
from focusjax.lens import (
    AberratedLens,
    AbstractLens,
    Disk,
    FocalSurfaceLens,
    apodized,
    obstructed,
    polygon,
    power_profile,
    seidel,
    squeezed,
    thin_lens,
    tilt_shift_lens,
)
from focusjax.trace._motion import divergence, film_flow, gain, hole_flow, rim_flow

PIXEL = np.array([2.0, 1.0])


def camera() -> Camera:
    return make_camera(np.eye(4), width=5, height=4, focal_length=0.05, sensor_width=0.036)


def surface() -> FocalSurfaceLens:
    """Focus and opening that differ from corner to corner."""
    random = np.random.default_rng(3)
    return FocalSurfaceLens(
        focus_disparity=jnp.array(random.uniform(0.4, 0.6, (5, 6))),
        aperture_scale=jnp.array(random.uniform(0.8, 1.0, (5, 6))),
        aperture_radius=jnp.array(0.1),
        aperture=Disk(),
    )


def aberrated() -> AberratedLens:
    opening = squeezed(1.5, apodized([1.0, 0.4], obstructed(0.3, polygon(5, roundness=0.3))))
    thin = thin_lens(focus_distance=2.0, aperture_radius=0.1, aperture=opening)
    terms = seidel(thin, camera(), w040=0.1, w131=-0.2, w222=0.1, w220=-0.1, w311=0.2)
    return AberratedLens(thin, (terms, power_profile([0.0, 0.05])))


class Vignetted(AbstractLens):
    """A thin lens whose light falls off towards the rim and away from the axis."""

    lens: AbstractLens
    falls: jax.Array

    def opening(self):
        return self.lens.opening()

    def ray(self, camera, film_point, pupil_point):
        ray = self.lens.ray(camera, film_point, pupil_point)
        weight = jnp.exp(-self.falls * (pupil_point @ pupil_point + 0.1 * film_point @ film_point))
        return dataclasses.replace(ray, weight=weight)

    def blur(self, camera, film_point, disparity):
        return self.lens.blur(camera, film_point, disparity)

    def footprint(self, camera, film_point, disparity):
        return self.lens.footprint(camera, film_point, disparity)

    def reach(self, camera, disparity):
        return self.lens.reach(camera, disparity)

    def parallax(self, camera):
        return self.lens.parallax(camera)


LENSES = {
    "thin": lambda: thin_lens(focus_distance=2.0, aperture_radius=0.1),
    "polygon": lambda: thin_lens(
        focus_distance=2.0, aperture_radius=0.1, aperture=polygon(5, rotation=0.4, roundness=0.3)
    ),
    "tilted": lambda: tilt_shift_lens(
        focus_distance=2.0, focal_length=0.05, tilt=0.05, swing=-0.03, aperture_radius=0.1
    ),
    "surface": surface,
    "aberrated, of uneven opening": aberrated,
    "vignetted": lambda: Vignetted(thin_lens(focus_distance=2.0, aperture_radius=0.1), jnp.array(0.4)),
}


def radiance(ray) -> jax.Array:
    """A smooth radiance of rays, that differs in all four directions."""
    a, b = ray.a - jnp.array([2.4, 1.6]), ray.b / 3.0
    return ray.weight * (
        jnp.exp(-0.1 * (a @ a)) * (1.0 + 0.5 * b[0] - 0.3 * b[1] + 0.4 * b[0] * b[1])
        + 0.2 * jnp.sin(a[0] + b[1])
    )


def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def grid(*axes) -> tuple[jax.Array, jax.Array]:
    """Nodes [n, d] and weights [n] of a product of rules."""
    nodes = np.stack(np.meshgrid(*[axis[0] for axis in axes], indexing="ij"), axis=-1)
    weights = np.ones(())
    for axis in axes:
        weights = np.multiply.outer(weights, axis[1])
    return jnp.asarray(nodes.reshape(-1, len(axes))), jnp.asarray(weights.reshape(-1))


@pytest.mark.parametrize(
    "name",
    # The opening of the aberrated one is a polygon as well, and the vignetted one is thin.
    [pytest.param(name, marks=pytest.mark.slow) if name in ("thin", "polygon") else name for name in LENSES],
)
def test_what_crosses_and_gathers_is_the_derivative(name: str):
    """The three integrals together, by Gauss's rule, against the derivative of the mean by the same rule."""
    lens, cam = LENSES[name](), camera()
    flat, restore = ravel_pytree(lens)
    side = gauss(5)
    # s = rho^2 takes the root out; each of the five blades has a rule of its own.
    nodes, weights = gauss(7)
    inward = nodes**2, 2 * nodes * weights
    blades = 5
    around = ((np.arange(blades)[:, None] + nodes) / blades).ravel(), np.tile(weights, blades) / blades

    @jax.jit
    def both(flat):
        films, by_film = grid(side, side)
        places, by_place = grid(inward, around)
        still = restore(jax.lax.stop_gradient(flat))

        def over(function, first, second):
            return jax.vmap(lambda p: jax.vmap(lambda s: function(p, s))(second))(first)

        def mean(flat):
            lens = restore(flat)
            opening = lens.opening()

            def light(film, place):
                point = opening.at(place)
                return opening.density(point) * radiance(lens.ray(cam, PIXEL + film, point))

            return by_film @ over(light, films, places) @ by_place

        def seen(film, place):
            ray = still.ray(cam, film, still.opening().at(place))
            # The flow carries the weight.
            return radiance(dataclasses.replace(ray, weight=jnp.ones(())))

        def gathering(moved, film, place):
            at = still, moved, cam, film, place
            return gain(*at) - divergence(*at)

        def flow(flat):
            moved = restore(flat)
            total = (
                by_film
                @ over(lambda p, s: seen(PIXEL + p, s) * gathering(moved, PIXEL + p, s), films, places)
                @ by_place
            )
            turns, by_turn = (jnp.asarray(a) for a in around)
            edges = [(1.0, rim_flow)] + ([] if still.opening().hole() is None else [(0.0, hole_flow)])
            for end, out in edges:

                def leaving(p, t, end=end, out=out):
                    return seen(PIXEL + p, jnp.stack([end, t])) * out(still, moved, cam, PIXEL + p, t)

                total += by_film @ over(leaving, films, turns) @ by_turn
            along, by_along = (jnp.asarray(a) for a in side)

            def through(normal, end):
                def crossing(t, s):
                    # Just inside the pixel, whose flow may not be its neighbour's.
                    inside = jnp.where(end > 0, 1.0 - 1e-9, 1e-9)
                    film = PIXEL + normal * inside + (1.0 - normal) * t
                    return seen(film, s) * (film_flow(still, moved, cam, film, s) @ normal)

                return (2.0 * end - 1.0) * (by_along @ over(crossing, along, places) @ by_place)

            normals, ends = jnp.array([(1.0, 0.0), (0.0, 1.0)] * 2), jnp.array([0.0, 0.0, 1.0, 1.0])
            total += jax.vmap(through)(normals, ends).sum()
            return total

        return jax.grad(mean)(flat), jax.grad(flow)(flat)

    expected, found = both(flat)
    scale = np.abs(expected).max()
    assert scale > 1e-3
    # Observed: 4.6e-10, and by the pixel's inside being 1e-9 smaller; by Gauss's rule 2e-8 when aberrated.
    np.testing.assert_allclose(found, expected, rtol=0, atol=(1e-7 if "aberrated" in name else 3e-9) * scale)
