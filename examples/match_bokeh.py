"""Which zones of a lens have to focus where, for lights behind the focus to be blobs with soft edges?

Of light that is spread evenly over the opening, the share r^2 comes through its inner r. Where that share
ends in the wished-for blob, the ring at r has to land; so a power profile is fitted to where rings land. The
wish is a bell curve that a disk cuts off, as an apodisation filter makes it, but without its loss of light.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx

import focusjax as fj
from focusjax.lens import AberratedLens, power_profile

jax.config.update("jax_enable_x64", True)
camera = fj.look_at((0, 0, 0), (0, 0, -1), width=640, height=480, focal_length=0.05)
ideal = fj.thin_lens(focus_distance=1.0, f_number=1.4, focal_length=0.05)
lights = jnp.asarray(1 / 3)  # dioptres
size = 0.5 * float(
    ideal.blur(camera, camera.principal_point, lights)
)  # of the blob: as large as the disk was
width = 0.45 * size
rings = (jnp.arange(40) + 0.5) / 40
wished = width * jnp.sqrt(-2.0 * jnp.log1p(-(rings**2) * -jnp.expm1(-0.5 * (size / width) ** 2)))
start = AberratedLens(ideal, (power_profile(jnp.zeros(9)),))


def landed(values):
    """How far in pixels each ring lands from the light's middle."""
    lens = eqx.tree_at(lambda lens: lens.aberrations[0].dioptres.values, start, values)

    def off(ring):
        ray = lens.ray(camera, camera.principal_point, jnp.stack([ring, 0.0]))
        return (camera.principal_point - ray.at(lights))[0]

    return jax.vmap(off)(rings)


solver = optx.LevenbergMarquardt(rtol=1e-8, atol=1e-8)
found = optx.least_squares(lambda values, _: landed(values) - wished, solver, jnp.zeros(9)).value
missed = jnp.abs(landed(found) - wished).max()
print(
    f"a disk of {size:.1f} px becomes a blob whose rings are within {missed:.3f} px of where they should be"
)
print(
    "from the middle to the rim the zones focus nearer by, in dioptres:", [round(float(v), 3) for v in found]
)
