"""Rays are spread evenly over pixel and lens, alone and together with their neighbours."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.lens import Disk, ThinLens, polygon
from focusjax.trace._samples import RaySamples, ray_samples


def lens(aperture: object = None) -> ThinLens:
    return ThinLens(jnp.array(0.5), jnp.array(0.1), Disk() if aperture is None else aperture)


def samples_of(rays: int, seed: int = 0, aperture: object = None) -> RaySamples:
    return ray_samples(lens(aperture), (rays,), jnp.uint32(seed))


def planes(samples: RaySamples, name: str) -> np.ndarray:
    """Points [t, s, 2]."""
    return np.stack(getattr(samples, name), axis=-1).reshape(samples.edge**2, samples.per_pixel, 2)


@pytest.mark.parametrize("rays", [1, 5, 16])
def test_samples_lie_in_the_pixel_and_on_the_lens(rays: int):
    samples = samples_of(rays, aperture=polygon(5))
    place, pupil = planes(samples, "place"), planes(samples, "pupil")
    assert place.shape == pupil.shape == (samples.edge**2, rays, 2)
    assert place.min() >= 0.0
    assert place.max() < 1.0
    assert np.linalg.norm(pupil, axis=-1).max() <= 1.0


def test_rays_of_a_pixel_are_stratified():
    """Of 16 rays one falls in each sixteenth of the pixel's width, and of its height."""
    cells = np.sort(np.floor(16 * planes(samples_of(16), "place")).astype(int), axis=1)
    np.testing.assert_array_equal(cells, np.broadcast_to(np.arange(16)[None, :, None], cells.shape))


def test_pixels_together_cover_the_lens():
    """Moments of the disk, over 16 rays of each of 2 x 2 pixels: far nearer than at random."""
    samples = samples_of(16)
    pupil = planes(samples, "pupil").reshape(samples.edge // 2, 2, samples.edge // 2, 2, 16, 2)
    block = pupil.swapaxes(1, 2).reshape(-1, 64, 2)
    # Observed: 0.0034; the mean of 64 random points is off by 0.0625.
    assert block.mean(axis=1).std() < 0.01
    assert (block**2).sum(axis=-1).mean() == pytest.approx(0.5, abs=1e-3)


def test_the_tile_repeats_and_levels_follow_one_another():
    samples = ray_samples(lens(), (4, 8), jnp.uint32(0))
    assert samples.per_pixel == 12
    column, row, number = jnp.array([37, 37]), jnp.array([5, 5]), jnp.array([0, 11])
    here = samples.at(column, row, number)
    again = samples.at(column - samples.edge, row + 3 * samples.edge, number)
    np.testing.assert_array_equal(again.u, here.u)
    np.testing.assert_allclose(again.x + samples.edge, here.x, atol=1e-12)
    level = planes(samples, "pupil")[5 * samples.edge + 5, 4:]
    assert len(np.unique(np.floor(8 * (0.5 + 0.5 * level[:, 0])))) > 4


def test_seeds_are_independent():
    """Means over the tile of the products of what two seeds miss, per pixel: as of numbers at random."""
    first, second = (planes(samples_of(4, seed), "pupil").mean(axis=1) for seed in (0, 1))
    assert not np.allclose(first, second)
    alike = (first * second).mean() / np.sqrt((first**2).mean() * (second**2).mean())
    # Observed: 0.011, of 2048 numbers.
    assert abs(alike) < 0.08


def test_a_traced_seed_gives_the_same_samples():
    plain = samples_of(8, 5)
    traced = jax.jit(lambda seed: ray_samples(lens(), (8,), seed))(jnp.uint32(5))
    np.testing.assert_array_equal(traced.pupil[0], plain.pupil[0])
