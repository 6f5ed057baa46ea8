"""Mipmaps keep light and coverage, and show a surface's colour however much of it is missing."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_scenes import front_camera, patch, varied_layers, wide_lens

from focusjax.layers import ColourMipmaps, colour_mipmaps, peel
from focusjax.scene import make_scene


@eqx.filter_jit
def look_up(mipmaps: ColourMipmaps, layer: jax.Array, level: jax.Array, places: jax.Array) -> jax.Array:
    return jax.vmap(lambda place: mipmaps(layer, level, place))(places)


def test_light_and_coverage_are_kept_from_level_to_level():
    mipmaps = colour_mipmaps(varied_layers(), 5)
    rows, columns = varied_layers().cells.shape[1:]
    for number, texels in enumerate(mipmaps.levels):
        assert texels.shape[1:3] == (-(-rows // 2**number), -(-columns // 2**number))
        np.testing.assert_allclose(texels.sum(axis=(1, 2)) * 4**number, mipmaps.levels[0].sum(axis=(1, 2)))
    assert mipmaps.nbytes == sum(texels.size for texels in mipmaps.levels) * texels.dtype.itemsize


def test_a_square_in_pieces_has_its_colour_at_every_level():
    """Bars of one colour with gaps: colour over coverage is that colour, coverage is their share."""
    camera = front_camera()
    bars = [patch(f"bar {k}", camera, (4 + 4 * k, 4, 6 + 4 * k, 20), 0.5, (0.2, 0.4, 0.8)) for k in range(6)]
    layers = peel(make_scene(bars, unlit=True), camera, wide_lens(camera), supersampling=1)
    margin = layers.grid.margin
    mipmaps = colour_mipmaps(layers, 4)
    places = jnp.asarray(np.array([(12.0, 12.0), (16.0, 12.0), (20.0, 12.0)]) + margin)
    for level in range(4):
        found = np.asarray(look_up(mipmaps, jnp.int32(0), jnp.int32(level), places))
        np.testing.assert_allclose(found[:, :3] / found[:, 3:], np.tile([0.2, 0.4, 0.8], (3, 1)), rtol=1e-5)
    # Texels of four samples span one bar and one gap. Observed: 0.5 exactly.
    np.testing.assert_allclose(found[:, 3], 0.5, atol=0.02)


def test_look_ups_interpolate_and_find_nothing_beyond_the_grid():
    mipmaps = colour_mipmaps(varied_layers(), 3)
    texels = np.asarray(mipmaps.levels[1][0])
    centre = jnp.asarray([[2 * 9 + 1.0, 2 * 7 + 1.0], [2 * 9 + 2.0, 2 * 7 + 1.0], [-9.0, -9.0]])
    found = np.asarray(look_up(mipmaps, jnp.int32(0), jnp.int32(1), centre))
    np.testing.assert_allclose(found[0], texels[7, 9], atol=1e-12)
    np.testing.assert_allclose(found[1], (texels[7, 9] + texels[7, 10]) / 2, atol=1e-12)
    np.testing.assert_array_equal(found[2], 0.0)
    with pytest.raises(ValueError, match="levels is 0"):
        colour_mipmaps(varied_layers(), 0)
