"""The blur of a point by rays of a lens as it is used, by what nothing in the product computes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens


@eqx.filter_jit
def rms_diameter(lens: AbstractLens, camera: Camera, seen, disparity):
    """sqrt(8 x mean square distance) of where the light of a point lands, in pixels.

    A ray through each place of the opening starts where it meets the point, found by fixed-point steps.
    """
    square = jnp.asarray(qmc.Sobol(2, rng=np.random.default_rng(5)).random(1024))

    def landed(sample):
        v = lens.pupil_point(sample)

        def step(_, place):
            ray = lens.ray(camera, place, v)
            return place + seen - (ray.a + ray.b * disparity)

        place = jax.lax.fori_loop(0, 6, step, seen)
        return place, lens.ray(camera, place, v).weight

    place, weight = jax.vmap(landed)(square)
    share = weight / jnp.sum(weight)
    return jnp.sqrt(8.0 * (share @ jnp.sum((place - (share @ place)[None]) ** 2, axis=1)))
