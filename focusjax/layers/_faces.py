"""Which of the scene's faces each sample of layers shows."""

import numpy as np
from jaxtyping import Int

from focusjax.layers._joins import NEIGHBOURS
from focusjax.layers._layers import Layers

_SIDES = 4
"""Neighbours beside a sample, which come first."""


def faces_of_samples(layers: Layers) -> Int[np.ndarray, " n"]:
    """The scene's face [n] of each sample in `layers.samples`; -1 after the last.

    A fringe sample shows the surface that reaches into its square from beside it: of the samples there, in
    all layers, that of the nearest disparity.
    """
    samples, grid = layers.samples, layers.grid
    face, disparity = np.array(samples.triangle), np.asarray(samples.disparity)
    held, before = np.asarray(layers.places.held), np.asarray(layers.places.before)
    count = int(before[-1]) + int(np.bitwise_count(held[-1]))
    fringe = np.flatnonzero(face[:count] < 0)
    size = grid.rows * grid.columns
    row, column = np.divmod(np.asarray(samples.index)[fringe] % size, grid.columns)
    least, found = np.full(len(fringe), np.inf), np.full(len(fringe), -1, dtype=face.dtype)
    for dx, dy in NEIGHBOURS[:_SIDES]:
        inside = (column + dx >= 0) & (column + dx < grid.columns) & (row + dy >= 0) & (row + dy < grid.rows)
        for layer in range(layers.count):
            place = np.where(inside, layer * size + (row + dy) * grid.columns + column + dx, 0)
            below = (np.uint32(1) << (place & 31).astype(np.uint32)) - np.uint32(1)
            word = held[place >> 5]
            there = inside & ((word & (below + np.uint32(1))) > 0)
            number = np.where(there, before[place >> 5] + np.bitwise_count(word & below), 0)
            apart = np.abs(disparity[number] - disparity[fringe])
            nearer = np.flatnonzero(there & (face[number] >= 0) & (apart < least))
            least[nearer], found[nearer] = apart[nearer], face[number[nearer]]
    face[fringe] = found
    return face
