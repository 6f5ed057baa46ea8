"""Coverage-weighted means over blocks."""

import jax.numpy as jnp
import numpy as np

from focusjax.post._gather import block_means


def test_means_are_of_what_is_covered_and_inside():
    rng = np.random.default_rng(0)
    planes, coverage = rng.random((2, 6, 7)), rng.random((6, 7))
    coverage[:4, 4:] = 0.0
    means, covered = block_means(jnp.asarray(planes), jnp.asarray(coverage), 4)
    assert means.shape == (2, 2, 2)
    for row in range(2):
        for column in range(2):
            block = np.s_[4 * row : 4 * row + 4, 4 * column : 4 * column + 4]
            weights = coverage[block]
            np.testing.assert_allclose(covered[row, column], weights.mean(), atol=1e-15)
            for plane, mean in zip(planes, means, strict=True):
                expected = np.average(plane[block], weights=weights) if weights.any() else 0.0
                np.testing.assert_allclose(mean[row, column], expected, rtol=1e-14)


def test_a_colour_keeps_out_of_blocks_it_does_not_cover():
    """However bright it is."""
    planes = np.where(np.eye(4, dtype=bool), 1e30, 0.25)[None]
    means, covered = block_means(jnp.asarray(planes), jnp.asarray(1.0 - np.eye(4)), 4)
    assert (float(means[0, 0, 0]), float(covered[0, 0])) == (0.25, 0.75)
