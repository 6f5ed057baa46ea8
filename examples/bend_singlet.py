"""How should a singlet be bent so that light from afar meets in the smallest spot?

Bending changes both curvatures and keeps the power. Third-order optics of a thin lens answers with a shape
factor q = (R2 + R1) / (R2 - R1) of 2 (n^2 - 1) / (n + 2) (Jenkins and White, Fundamentals of Optics, section
9.4); here rays that are traced through the glass answer, by least squares over the bend and the film's place.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

from focusjax.optics import find_glass, line, singlet, trace

FOCAL_LENGTH, SEMI_DIAMETER, THICKNESS = 100.0, 10.0, 0.5  # mm; as thin as can be at f/5.
glass = find_glass("N-BK7")
n = glass.index(line())
flat = singlet(100.0, -100.0, thickness=3.0, semi_diameter=SEMI_DIAMETER, glass=glass)
heights = SEMI_DIAMETER * jnp.sqrt((jnp.arange(64) + 0.5) / 64)


def bent(q):
    """The singlet with shape factor q: 0 is biconvex, 1 has a plane back."""
    power = 1.0 / (FOCAL_LENGTH * (n - 1.0))
    curvatures = 0.5 * power * (q + 1.0), 0.5 * power * (q - 1.0)
    where = lambda lens: (*(surface.curvature for surface in lens.surfaces), lens.thicknesses[0])  # noqa: E731
    return eqx.tree_at(where, flat, (*curvatures, jnp.asarray(THICKNESS)))


def landings(variables, _):
    """Where rays of rings of equal area cross the film, in mm from the axis."""
    q, beyond = variables
    lens = bent(q)

    def land(height):
        start = jnp.stack([height, 0.0, -1.0])
        ray = trace(lens, lens.indices(line()), start, jnp.array([0.0, 0.0, 1.0]))
        return ray.position[0] + ray.direction[0] / ray.direction[2] * (
            FOCAL_LENGTH + beyond - ray.position[2]
        )

    return jax.vmap(land)(heights)


def spot(q):
    """RMS diameter in micrometres at the film's best place."""
    found = optx.least_squares(
        lambda beyond, _: landings((q, beyond), None), optx.LevenbergMarquardt(1e-10, 1e-10), jnp.zeros(())
    )
    return 2e3 * jnp.sqrt(jnp.mean(landings((q, found.value), None) ** 2))


solver = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
best, _ = optx.least_squares(landings, solver, (jnp.zeros(()), jnp.zeros(()))).value
textbook = 2.0 * (n**2 - 1.0) / (n + 2.0)
print(f"rays: q = {best:.3f}, a spot of {spot(best):.1f} um; the textbook says {textbook:.3f}")
print(f"biconvex {spot(jnp.zeros(())):.1f} um, plane behind {spot(jnp.ones(())):.1f} um")
