"""Many rays walked together end where each ends alone."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import varied_layers

from focusjax.geometry import LensRay
from focusjax.trace import _march, _walk
from focusjax.trace._march import first_hits
from focusjax.trace._walk import Passing, first_hit, make_volume, path_of

COUNT = 3000


def all_ways(volume, rays, least, largest, chance):
    paths = jax.vmap(path_of)(rays, least, largest)
    alone = jax.vmap(lambda *one: first_hit(volume, *one))(rays, least, largest, chance)
    passing = None if volume.opacity is None else Passing(jnp.zeros_like(chance), chance)
    lanes = _march._in_lanes(volume, paths, passing)
    kernels = _march._in_kernels(volume, paths, passing, interpret=True)
    return alone, first_hits(volume, paths, chance), lanes, kernels


@pytest.mark.parametrize(("together", "translucent"), [(512, True), (4096, False)])
def test_many_rays_hit_what_each_hits(together: int, translucent: bool, monkeypatch: pytest.MonkeyPatch):
    """Rays of no length, short and long ones, some with nothing to meet; also fewer than go together."""
    monkeypatch.setattr(_march, "_PART", together)
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
    # A program of its own, as one that is there does not know of the number that go together.
    ways = eqx.filter_jit(lambda *given: all_ways(*given))(volume, rays, least, largest, chance)
    alone, compacted, lanes, kernels = (np.asarray(a) for a in ways)
    assert 0.2 < (alone < 0).mean() < 0.8
    np.testing.assert_array_equal(compacted, alone)
    np.testing.assert_array_equal(lanes, alone)
    np.testing.assert_array_equal(kernels, alone)


def test_layers_beyond_those_of_every_step_are_looked_at_as_well(monkeypatch: pytest.MonkeyPatch):
    layers = varied_layers()
    volume = make_volume(layers.cells, layers.disparity_scale, None)
    least, largest = layers.ranges.overall
    random = np.random.default_rng(4)
    size = np.array([layers.grid.columns, layers.grid.rows])
    b = random.uniform(-9, 9, (COUNT, 2))
    rays = LensRay(jnp.asarray(random.uniform(0, 1, (COUNT, 2)) * size), jnp.asarray(b), jnp.ones(COUNT))
    hits = [jax.vmap(lambda ray: first_hit(volume, ray, least, largest))(rays)]
    monkeypatch.setattr(_walk, "_UNROLLED", 1)
    hits.append(jax.vmap(lambda ray: first_hit(volume, ray, least, largest))(rays))
    assert (np.asarray(hits[0]) >= layers.grid.size).any()
    np.testing.assert_array_equal(*hits)


def rays_of(layers, count: int):
    """Volume and paths of rays that cross it."""
    volume = make_volume(layers.cells, layers.disparity_scale, None)
    random, size = np.random.default_rng(5), np.array([layers.grid.columns, layers.grid.rows])
    a, b = random.uniform(0, 1, (count, 2)) * size, random.uniform(-9, 9, (count, 2))
    rays = LensRay(jnp.asarray(a), jnp.asarray(b), jnp.ones(count))
    ends = (jnp.full(count, float(w)) for w in layers.ranges.overall)
    return volume, jax.vmap(path_of)(rays, *ends)


def test_kernels_are_mapped_over_volumes_and_rays():
    volume, paths = rays_of(varied_layers(), 200)
    given = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), (volume, paths))
    hits = jax.vmap(lambda v, p: _march._in_kernels(v, p, None, interpret=True))(*given)
    wanted = _march._in_lanes(volume, paths, None)
    np.testing.assert_array_equal(hits, [wanted, wanted])


@pytest.mark.skipif(
    jax.__version_info__ >= (0, 11), reason="JAX 0.11 lowers kernels of Triton only where a GPU is"
)
def test_kernels_lower_for_cuda():
    text = jax.jit(_march._in_kernels).trace(*rays_of(varied_layers(), 200), None)
    assert "xla.gpu.triton" in text.lower(lowering_platforms=("cuda",)).as_text()
