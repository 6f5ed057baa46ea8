"""The work of a picture in blocks of one size: some rays of a pixel at a time, pixels that lie together."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from focusjax.trace._samples import z_order


@dataclasses.dataclass(frozen=True)
class Block:
    """Parts of pixels' rays to be traced together.

    Attributes:
        pixels: row-major number [p] of each part's pixel; parts of one pixel follow each other. The last one
            is repeated to fill the block.
        part: which [p] of the pixel's parts it is.
        count: how many parts there are but for what fills the block.
        depth: layers that any of them can meet, rounded up to one of a few numbers.
    """

    pixels: Int[np.ndarray, " p"]
    part: Int[np.ndarray, " p"]
    count: int
    depth: int

    def add_to(self, picture: Float[np.ndarray, "n c"], values: Float[np.ndarray, "p c"]) -> None:
        """Add what each part brought to its pixel."""
        pixels = self.pixels[: self.count]
        start = np.flatnonzero(np.diff(pixels, prepend=-1))
        picture[pixels[start]] += np.add.reduceat(values[: self.count], start, axis=0)


def make_blocks(
    parts: Int[np.ndarray, " n"], depth: Int[np.ndarray, " n"], most_layers: int, columns: int, size: int
) -> list[Block]:
    """Blocks of `size` parts (or of the next power of two, if all there are is less).

    Pixels are in Z-order, so that a block reads few places of the layers, those with few layers under their
    rays apart from those with many.

    Args:
        parts: of each pixel.
        depth: layers under its rays.
        most_layers: number of layers.
        columns: pixels per row.
        size: parts of a block.
    """
    variants = np.unique(np.minimum([4, 8, 16, most_layers], most_layers))
    level = np.searchsorted(variants, np.maximum(depth, 1))
    row, column = np.divmod(np.arange(len(parts)), columns)
    order = np.lexsort((z_order(column, row), level))
    ends = np.cumsum(parts[order])
    size = min(size, 1 << max(int(ends[-1]) - 1, 0).bit_length())
    blocks: list[list[Block]] = []
    for number, variant in enumerate(variants):
        first, last = np.searchsorted(level[order], [number, number + 1])
        begin, end = (int(ends[k - 1]) if k else 0 for k in (first, last))
        some = []
        for start in range(begin, end, size):
            work = np.minimum(np.arange(start, start + size), end - 1)
            low, high = np.searchsorted(ends, [work[0], work[-1]], side="right")
            pixel = low + np.searchsorted(ends[low : high + 1], work, side="right")
            pixels = order[pixel]
            part = work - (ends[pixel] - parts[pixels])
            some.append(Block(pixels, part, min(size, end - start), int(variant)))
        blocks.append(some)
    # One block of each kind first, so that their programs are compiled side by side.
    return [some[0] for some in blocks if some] + [block for some in blocks for block in some[1:]]
