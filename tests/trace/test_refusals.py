"""What `render` refuses of a lens that JAX traces."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from jax.experimental import jet
from small_scenes import varied_layers

from focusjax._arguments import ArgumentError
from focusjax.lens import ThinLens
from focusjax.trace import render

OUT_OF_REACH = "rays of the lens leave what the layers were peeled for; keep its focus and aperture within"

LAYERS = varied_layers()


def picture(focus: jax.Array, share: jax.Array, brightness: float | jax.Array = 1.0) -> jax.Array:
    """Through a lens focused there, with that share of the aperture."""
    layers = LAYERS
    bright = eqx.tree_at(lambda a: a.samples.radiance, layers, brightness * layers.samples.radiance)
    return render(bright, ThinLens(focus, share * layers.lens.aperture_radius), rays=2, smooth=False)


def test_a_traced_lens_beyond_the_layers_is_refused_in_words():
    wide = jnp.asarray(0.4), jnp.asarray(2.0)
    with pytest.raises(RuntimeError, match=f"^(?s:.*)EquinoxRuntimeError: {OUT_OF_REACH}"):
        eqx.filter_jit(picture)(*wide)
    with pytest.raises(jax.errors.JaxRuntimeError, match=OUT_OF_REACH):
        jax.jit(picture)(*wide).block_until_ready()


@pytest.mark.parametrize(
    ("focus", "share", "message"),
    [
        (
            -0.01,
            1.0,
            r"focus_disparity of the lens is out of range; expected zero \(infinity\) or a positive",
        ),
        (0.4, -0.5, r"aperture_radius of the lens is out of range; expected zero \(a pinhole\) or a posi"),
        (jnp.nan, 1.0, "focus_disparity of the lens is out of range"),
    ],
)
def test_traced_settings_out_of_range_are_named(focus: float, share: float, message: str):
    with pytest.raises(RuntimeError, match=message):
        eqx.filter_jit(picture)(jnp.asarray(focus), jnp.asarray(share))


@pytest.mark.parametrize("compiled", [pytest.param(False, marks=pytest.mark.slow), True])
def test_second_derivatives_by_the_lens_are_refused(compiled: bool):
    def mean(focus: jax.Array, brightness: jax.Array) -> jax.Array:
        return picture(focus, jnp.asarray(1.0), brightness).mean()

    at = jnp.asarray(0.4), jnp.asarray(0.5)
    for twice in (
        jax.hessian(mean),
        jax.grad(jax.grad(mean, argnums=0), argnums=1),
        jax.grad(jax.grad(mean, argnums=1), argnums=0),
    ):
        with pytest.raises(ArgumentError, match="second derivatives of a picture by its lens"):
            (jax.jit(twice) if compiled else twice)(*at)


def test_series_by_the_lens_are_refused():
    def mean(focus: jax.Array) -> jax.Array:
        return picture(focus, jnp.asarray(1.0)).mean()

    with pytest.raises(ArgumentError, match=r"series of a picture .* first derivatives can, by `jax.jvp`"):
        jet.jet(mean, (jnp.asarray(0.4),), ((jnp.asarray(1.0), jnp.asarray(0.0)),))


@pytest.mark.slow
def test_what_the_gradient_is_multiplied_by_may_be_differentiated():
    def weighted(weight: jax.Array) -> jax.Array:
        return jax.grad(lambda focus: weight * picture(focus, jnp.asarray(1.0)).mean())(jnp.asarray(0.4))

    assert jax.grad(weighted)(jnp.asarray(2.0)) == pytest.approx(float(weighted(jnp.asarray(1.0))))
