"""The walk through the layers against a slow twin, ray by ray, in steps much finer."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from small_scenes import HEIGHT, WIDTH, varied_layers

from focusjax.geometry import LensRay
from focusjax.layers import covered, interval
from focusjax.trace._ranges import disparity_range
from focusjax.trace._walk import first_hit, make_volume

RAYS = 600
FINER = 32


@cache
def rays() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Film pixels [n, 2], and random rays from them over the whole lens: a and b [n, 2] on the grid."""
    layers = varied_layers()
    random = np.random.default_rng(3)
    pixel = random.integers(0, (WIDTH, HEIGHT), (RAYS, 2))
    angle, radius = random.uniform(0, 2 * np.pi, RAYS), np.sqrt(random.uniform(0, 1, RAYS))
    b = 12.0 * np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    a = pixel + random.uniform(0, 1, (RAYS, 2)) - b * float(layers.lens.focus_disparity)
    scale = layers.grid.supersampling
    return pixel, a * scale + layers.grid.margin, b * scale


@cache
def intervals() -> tuple[np.ndarray, np.ndarray]:
    """Least and largest disparity [l, h, w] of every sample; an empty one is out of reach."""
    scale = float(varied_layers().disparity_scale)
    least, largest = (np.asarray(a) * scale for a in interval(varied_layers().cells))
    return np.where(largest > 0, least, np.inf), np.where(largest > 0, largest, -np.inf)


def slow_hit(a: np.ndarray, b: np.ndarray) -> int:
    """Index of the first sample that the ray meets, -1 if none, by steps of a small part of a sample."""
    least, largest = intervals()
    words = np.asarray(varied_layers().cells)
    layers, rows, columns = least.shape
    top = float(varied_layers().ranges.overall[1])
    count = int(FINER * (top * np.abs(b).max() + 1))
    for step in range(count):
        near, far = top * (1 - step / count), top * (1 - (step + 1) / count)
        x, y = a + b * (near + far) / 2
        column, row = int(np.floor(x)), int(np.floor(y))
        if 0 <= column < columns and 0 <= row < rows:
            for layer in range(layers):
                within = least[layer, row, column] <= near and largest[layer, row, column] >= far
                if within and on_surface(words[layer, row, column], x - column - 0.5, y - row - 0.5):
                    return (layer * rows + row) * columns + column
    return -1


def on_surface(word: np.ndarray, dx: float, dy: float) -> bool:
    return bool(covered(jnp.asarray(word), jnp.asarray(dx), jnp.asarray(dy)))


@cache
def slow_hits() -> np.ndarray:
    return np.array([slow_hit(a, b) for a, b in zip(*rays()[1:], strict=True)])


@eqx.filter_jit
def ranges_of(layers, films):
    return jax.vmap(lambda film: disparity_range(layers, layers.lens, film, 0.5))(films)


@cache
def ranges() -> tuple[np.ndarray, ...]:
    films = jnp.asarray(rays()[0] + 0.5)
    return tuple(np.asarray(a) for a in ranges_of(varied_layers(), films))


@eqx.filter_jit
def quick_hits(volume, a, b, least, largest):
    def one(a, b, least, largest):
        return first_hit(volume, LensRay(a, b, jnp.ones(())), least, largest)

    return jax.vmap(one)(a, b, least, largest)


def quick(least: np.ndarray, largest: np.ndarray) -> np.ndarray:
    layers = varied_layers()
    volume = make_volume(layers.cells, layers.disparity_scale, None)
    return np.asarray(quick_hits(volume, *rays()[1:], least, largest))


def agreement(hits: np.ndarray) -> np.ndarray:
    """Whether each hit is the slow one, or a neighbour of about its disparity; or both met nothing."""
    size, columns = varied_layers().grid.size, varied_layers().grid.columns
    disparity = np.asarray(varied_layers().disparity).reshape(-1)
    slow = slow_hits()
    (row, column), (slow_row, slow_column) = (np.divmod(h % size, columns) for h in (hits, slow))
    close = (np.abs(row - slow_row) <= 1) & (np.abs(column - slow_column) <= 1)
    # A floor sample spans 0.07 dioptres.
    same = np.abs(disparity[hits] - disparity[slow]) < 0.1
    return np.where((hits < 0) | (slow < 0), hits == slow, close & same)


def test_the_walk_meets_what_the_slow_walk_meets():
    overall = [np.full(RAYS, float(w)) for w in varied_layers().ranges.overall]
    hits = quick(*overall)
    assert 0.05 < (hits < 0).mean() < 0.9
    # Observed: 0.972. Where a coarse step straddles a silhouette, it takes the sample under its middle.
    assert agreement(hits).mean() > 0.95


def test_ranges_leave_nothing_out():
    least, largest, depth = ranges()
    low, high = (a.reshape(-1) for a in intervals())
    slow, size = slow_hits(), varied_layers().grid.size
    met = slow >= 0
    step = float(varied_layers().disparity_scale)
    assert (high[slow] >= least - 2 * step)[met].all()
    assert (low[slow] <= largest + 2 * step)[met].all()
    assert (slow // size < depth)[met].all()
    # They are narrower than the whole, or they would be no use.
    whole = np.ptp(np.asarray(varied_layers().ranges.overall))
    assert (largest - least).mean() < 0.8 * whole


def test_the_walk_within_a_pixels_range_finds_the_same():
    hits = quick(*ranges()[:2])
    # Observed: 0.963
    assert agreement(hits).mean() > 0.95


def test_nothing_to_meet_is_no_hit():
    assert (quick(np.zeros(RAYS), np.zeros(RAYS)) == -1).all()
