"""The picture is one function of arrays: compiled, mapped, differentiated, and for other devices."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compilations import compilations
from small_scenes import varied_layers

from focusjax._arguments import ArgumentError
from focusjax._counts import require_seed
from focusjax.layers import Layers
from focusjax.lens import ThinLens
from focusjax.trace import render
from focusjax.trace._picture import picture
from focusjax.trace._render import render_settings, seed_of

RAYS = 8


def refocused(layers: Layers, focus: jax.Array) -> ThinLens:
    return ThinLens(focus, layers.lens.aperture_radius)


def plain(focus: float, seed: int = 0) -> np.ndarray:
    layers = varied_layers()
    return np.asarray(render(layers, refocused(layers, jnp.asarray(focus)), rays=RAYS, seed=seed))


def test_under_jit_it_is_the_same_picture():
    layers = varied_layers()
    found = eqx.filter_jit(
        lambda layers, focus, seed: render(layers, refocused(layers, focus), rays=RAYS, seed=seed)
    )
    np.testing.assert_allclose(found(layers, jnp.asarray(0.4), jnp.asarray(3)), plain(0.4, 3), atol=1e-12)


def dimmed(layers: Layers, share: jax.Array) -> Layers:
    look = layers.samples.radiance * share, layers.background * share
    return eqx.tree_at(lambda a: (a.samples.radiance, a.background), layers, look)


def test_lenses_seeds_and_layers_of_one_shape_are_mapped_over():
    layers = varied_layers()
    each = jnp.array([0.5, 1.0]), jnp.array([0.3, 0.45]), jnp.array([0, 7])

    def of(share: jax.Array, focus: jax.Array, seed: jax.Array) -> jax.Array:
        return render(dimmed(layers, share), refocused(layers, focus), rays=RAYS, seed=seed)

    found = jax.vmap(of)(*each)
    for one, (share, focus, seed) in zip(found, zip(*each, strict=True), strict=True):
        np.testing.assert_allclose(one, of(share, focus, int(seed)), atol=1e-12)


def test_a_seed_alone_may_be_traced():
    layers = varied_layers()
    found = jax.jit(lambda seed: render(layers, layers.lens, rays=RAYS, seed=seed))(4)
    np.testing.assert_allclose(found, render(layers, layers.lens, rays=RAYS, seed=4), atol=1e-12)


def test_the_delivered_picture_has_a_gradient():
    """Of the adaptive, denoised picture: forward and reverse agree."""
    layers = varied_layers()

    def brightness(focus: jax.Array) -> jax.Array:
        return render(layers, refocused(layers, focus), rays=RAYS).mean()

    @jax.jit
    def both(at: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.jvp(brightness, (at,), (jnp.ones(()),))[1], jax.grad(brightness)(at)

    forward, reverse = both(jnp.asarray(0.4))
    assert float(forward) != 0.0
    assert float(reverse) == pytest.approx(float(forward), rel=1e-9)


@pytest.mark.slow
def test_radiance_has_a_gradient_in_the_delivered_picture():
    layers = varied_layers()
    random = np.random.default_rng(0)
    change = jnp.asarray(random.random(layers.samples.radiance.shape)) * (layers.samples.radiance < 0.95)

    def mean(share: jax.Array) -> jax.Array:
        radiance = layers.samples.radiance + share * change
        changed = eqx.tree_at(lambda a: a.samples.radiance, layers, radiance)
        return (render(changed, layers.lens, rays=RAYS) * jnp.linspace(0, 1, 32)[None, :, None]).mean()

    slope = jax.grad(mean)(jnp.zeros(()))
    assert slope == pytest.approx(float(jax.jvp(mean, (jnp.zeros(()),), (jnp.ones(()),))[1]), rel=1e-9)
    # A step so small that no pixel gets another number of rays. Observed: 4e-7.
    assert slope == pytest.approx(
        float((mean(jnp.asarray(1e-6)) - mean(jnp.asarray(-1e-6))) / 2e-6), rel=1e-4
    )


def test_white_is_no_exception_to_the_gradient_by_radiance():
    """White, 1, is where what is denoised and what is brighter part."""
    layers = varied_layers()
    radiance = jnp.ones_like(layers.samples.radiance), jnp.ones_like(layers.background)

    def mean(brightness: jax.Array) -> jax.Array:
        look = tuple(brightness * part for part in radiance)
        white = eqx.tree_at(lambda a: (a.samples.radiance, a.background), layers, look)
        return render(white, layers.lens, rays=RAYS).mean()

    slope = jax.jit(lambda at: jax.jvp(mean, (at,), (jnp.ones(()),))[1])(jnp.ones(()))
    assert float(slope) == pytest.approx(1.0, rel=1e-12)


def test_another_lens_and_seed_compile_nothing():
    plain(0.4)
    with compilations() as compiled:
        plain(0.2, seed=9)
        assert not compiled


def settings_of(layers: Layers):
    return render_settings(layers, layers.lens, rays=RAYS)


def test_nothing_leaves_the_device():
    layers = varied_layers()
    seed, settings = jnp.uint32(0), settings_of(layers)
    picture(layers, layers.lens, seed, settings=settings)
    with jax.transfer_guard("disallow"):
        found = picture(layers, layers.lens, seed, settings=settings)
    assert np.isfinite(found).all()


@pytest.mark.parametrize("differentiated", [False, True])
def test_it_lowers_for_cuda_without_callbacks(differentiated: bool):
    layers = varied_layers()
    settings = settings_of(layers)
    arrays, rest = eqx.partition(layers, eqx.is_array)

    def of(arrays: Layers, focus: jax.Array) -> jax.Array:
        layers = eqx.combine(arrays, rest)
        return picture(layers, refocused(layers, focus), jnp.uint32(0), settings=settings).var()

    function = jax.grad(of, argnums=1) if differentiated else of
    lowered = jax.jit(function).trace(arrays, jnp.asarray(0.4)).lower(lowering_platforms=("cuda",))
    text = lowered.as_text()
    assert "callback" not in text
    assert len(text) > 1000


def test_what_seeds_cannot_be_is_refused():
    layers = varied_layers()
    for seed in (-1, 2**32, jnp.asarray(-3)):
        with pytest.raises(ArgumentError, match=r"seed is .*; expected a whole number from 0 to 4294967295"):
            render(layers, layers.lens, rays=RAYS, seed=seed)
    with pytest.raises(ArgumentError, match=r"seed is traced as float.*\[\]; expected one whole number"):
        jax.jit(lambda seed: render(layers, layers.lens, rays=RAYS, seed=seed))(1.5)


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_traced_seeds_out_of_range_are_refused(seed: int):
    with pytest.raises(
        RuntimeError, match="seed is out of range; expected a whole number from 0 to 42949672"
    ):
        eqx.filter_jit(seed_of)(jnp.asarray(seed))


@pytest.mark.parametrize("kind", [jnp.asarray, np.int64, jnp.uint32])
def test_seeds_may_be_arrays(kind):
    assert int(seed_of(kind(3))) == 3
    assert require_seed(kind(3)) == 3
