"""Film offsets have their filter's density, by its formula."""

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.geometry import film_offsets, filter_radius

DENSITIES = {
    "box": lambda x: float(abs(x) < 0.5),
    "tent": lambda x: max(0.0, 1.0 - abs(x)),
    "gaussian": lambda x: np.exp(-2.0 * x * x) * (abs(x) < 1.5),
}


@pytest.mark.parametrize("name", DENSITIES)
def test_offsets_have_the_density(name: str):
    radius, density = filter_radius(name), DENSITIES[name]
    places = np.asarray(film_offsets(name, (jnp.arange(1000) + 0.5) / 1000)) - 0.5
    assert (np.diff(places) > 0).all()
    assert np.abs(places).max() < radius
    x = (np.arange(-2000, 2000) + 0.5) / 1000
    weight = np.array([density(place) for place in x])
    for edge in (-1.2, -0.4, 0.0, 0.3, 0.9):
        # Observed: 0.0005, half of one sample.
        assert (places < edge).mean() == pytest.approx(weight[x < edge].sum() / weight.sum(), abs=1e-3)


def test_the_ends_are_at_the_radius():
    for name in DENSITIES:
        ends = film_offsets(name, jnp.array([0.0, 1.0], dtype=jnp.float32))
        # Observed: 1.2e-6.
        np.testing.assert_allclose(np.abs(ends - 0.5), filter_radius(name), atol=1e-5)


def test_other_filters_are_refused():
    with pytest.raises(ValueError, match="pixel_filter is 'lanczos'; expected one of box, tent, gaussian"):
        filter_radius("lanczos")
