"""Many rays walked together end where each ends alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import varied_layers

from focusjax.geometry import LensRay
from focusjax.trace import _march
from focusjax.trace._march import first_hits
from focusjax.trace._walk import first_hit, make_volume, path_of

COUNT = 3000


@eqx.filter_jit
def both(volume, rays, least, largest, chance, depth):
    alone = jax.vmap(lambda *one: first_hit(volume, *one, depth=depth))(rays, least, largest, chance)
    return alone, first_hits(volume, jax.vmap(path_of)(rays, least, largest), chance, depth=depth)


@pytest.mark.parametrize("translucent", [False, True])
@pytest.mark.parametrize("together", [512, 4096])
def test_many_rays_hit_what_each_hits(together: int, translucent: bool, monkeypatch: pytest.MonkeyPatch):
    """Rays of no length, short and long ones, some with nothing to meet; also fewer than go together."""
    monkeypatch.setattr(_march, "_TOGETHER", together)
    layers, random = varied_layers(), np.random.default_rng(2)
    opacity = jnp.asarray(random.choice([0.3, 1.0], layers.cells.shape)) if translucent else None
    volume = make_volume(layers.cells, layers.disparity_scale, opacity)
    size = np.array([layers.grid.columns, layers.grid.rows])
    reach = random.choice([0.0, 2.0, 30.0], (COUNT, 1))
    rays = LensRay(
        a=jnp.asarray(random.uniform(0, 1, (COUNT, 2)) * size),
        b=jnp.asarray(random.uniform(-1, 1, (COUNT, 2)) * reach),
        weight=jnp.ones(COUNT),
    )
    least, largest = (jnp.full(COUNT, float(w)) for w in layers.ranges.overall)
    largest = jnp.where(jnp.arange(COUNT) % 7 == 0, 0.0, largest)
    chance = jnp.asarray(random.integers(0, 1 << 32, COUNT, dtype=np.uint32))
    alone, together_ = (np.asarray(a) for a in both(volume, rays, least, largest, chance, layers.count))
    assert 0.2 < (alone < 0).mean() < 0.8
    np.testing.assert_array_equal(together_, alone)
