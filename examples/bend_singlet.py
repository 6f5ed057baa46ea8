"""How should a singlet be bent so that light from afar meets in the smallest spot?

Bending changes both curvatures and keeps the power. Third-order optics of a thin lens answers with a shape
factor q = (R2 + R1) / (R2 - R1) of 2 (n^2 - 1) / (n + 2) (Jenkins and White, Fundamentals of Optics, section
9.4); here rays that are traced through the glass answer, by least squares.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from focusjax.optics import find_glass, line, singlet, trace

jax.config.update("jax_enable_x64", True)
FOCAL_LENGTH, SEMI_DIAMETER, THICKNESS = 100.0, 10.0, 0.5  # mm, as thin as can be
glass = find_glass("N-BK7")
n = glass.index(line())
flat = singlet(math.inf, math.inf, thickness=THICKNESS, semi_diameter=SEMI_DIAMETER, glass=glass)
heights = SEMI_DIAMETER * jnp.sqrt((jnp.arange(64) + 0.5) / 64)  # of rings of equal area


def landings(q, _):
    """Where the rays cross the film, in mm from the axis, when that stands where they are closest."""
    power = 1.0 / (FOCAL_LENGTH * (n - 1.0))
    curvatures = 0.5 * power * (q + 1.0), 0.5 * power * (q - 1.0)
    lens = eqx.tree_at(lambda lens: [surface.curvature for surface in lens.surfaces], flat, curvatures)

    def leave(height):
        start, way = jnp.stack([height, 0.0, -1.0]), jnp.array([0.0, 0.0, 1.0])
        ray = trace(lens, lens.indices(line()), start, way)
        slope = ray.direction[0] / ray.direction[2]
        return ray.position[0] + slope * (FOCAL_LENGTH - ray.position[2]), slope

    place, slope = jax.vmap(leave)(heights)
    return place - slope * (place @ slope) / (slope @ slope)


def spot(q):
    """RMS diameter in micrometres."""
    return 2e3 * float(jnp.sqrt(jnp.mean(landings(jnp.asarray(q), None) ** 2)))


solver = optx.LevenbergMarquardt(rtol=1e-6, atol=1e-6)
best = float(optx.least_squares(landings, solver, jnp.zeros(())).value)
textbook = float(2.0 * (n**2 - 1.0) / (n + 2.0))
print(f"rays: q = {best:.3f}, a spot of {spot(best):.1f} um; the textbook says {textbook:.3f}")
print(f"biconvex {spot(0.0):.1f} um, plane behind {spot(1.0):.1f} um")
