"""Straight lines in space are straight lines in (x, y, disparity)."""

import jax
import jax.numpy as jnp
import numpy as np

from focusjax.geometry import LensRay, look_at


def test_any_straight_ray_is_a_line_in_disparity():
    """Points along random rays through the lens plane, projected one by one, lie on a + b w."""
    camera = look_at((1.0, 2.0, 3.0), (0.0, 0.5, -1.0), width=64, height=48, field_of_view=1.0)
    random = np.random.default_rng(0)
    pose, focal = np.asarray(camera.world_from_camera), float(camera.focal_px)
    project = jax.jit(jax.vmap(camera.project))
    for _ in range(10):
        start, slope = random.normal(size=2), random.normal(size=2)
        depth = random.uniform(0.1, 50.0, (20, 1))
        local = np.concatenate([start + slope * depth, -depth], axis=1)
        xy, disparity = project(jnp.array(local @ pose[:3, :3].T + pose[:3, 3]))
        a = np.asarray(camera.principal_point) + focal * slope * (1, -1)
        b = focal * start * (1, -1)
        ray = LensRay(*(jnp.array(np.broadcast_to(v, (20, 2))) for v in (a, b)), weight=jnp.ones(20))
        np.testing.assert_allclose(ray.at(disparity), xy, atol=1e-9)


def test_rays_come_in_batches():
    a, b = jnp.arange(12.0).reshape(2, 3, 2), jnp.ones((2, 3, 2))
    disparity = jnp.arange(6.0).reshape(2, 3)
    at = LensRay(a, b, jnp.ones((2, 3))).at(disparity)
    np.testing.assert_array_equal(at, np.asarray(a) + np.asarray(disparity)[..., None])
