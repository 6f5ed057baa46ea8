"""The work of a picture in blocks of one size: some rays of a pixel at a time, pixels that lie together."""

import dataclasses

import numpy as np
from jaxtyping import Int

from focusjax.trace._samples import z_order


@dataclasses.dataclass(frozen=True)
class Block:
    """Parts of pixels' rays to be traced together.

    Attributes:
        pixels: row-major number [p] of each part's pixel; parts of one pixel follow each other. The last one
            is repeated to fill the block.
        part: which [p] of the pixel's parts it is.
        places: numbers of the pixels that it has parts of, each once.
        place: which [p] of these each part belongs to; for what only fills the block as many as there are
            parts.
        depth: layers that any of them can meet, rounded up to one of a few numbers.
    """

    pixels: Int[np.ndarray, " p"]
    part: Int[np.ndarray, " p"]
    places: Int[np.ndarray, " d"]
    place: Int[np.ndarray, " p"]
    depth: int


class Blocks:
    """Blocks of `size` parts (or of the next power of two, if all there are is less), one made at a time.

    Pixels are in Z-order, so that a block reads few places of the layers, those with few layers under their
    rays apart from those with many: there are as many `kinds` of blocks as programs for them.
    """

    def __init__(
        self,
        parts: Int[np.ndarray, " n"],
        depth: Int[np.ndarray, " n"],
        most_layers: int,
        columns: int,
        size: int,
    ) -> None:
        """Blocks of so many `parts` of each pixel.

        Args:
            parts: of each pixel.
            depth: layers under its rays.
            most_layers: number of layers.
            columns: pixels per row.
            size: parts of a block.
        """
        variants = np.unique(np.minimum([4, 8, 16, most_layers], most_layers))
        level = np.searchsorted(variants, np.maximum(depth, 1))
        row, column = np.divmod(np.arange(len(parts), dtype=np.int32), np.int32(columns))
        order = np.lexsort((z_order(column, row), level)).astype(np.int32)
        self._order = order[parts[order] > 0]
        self._parts = parts[self._order]
        self._ends = np.cumsum(self._parts, dtype=np.int64)
        self.size = min(size, 1 << max(int(self._ends[-1]) - 1, 0).bit_length())
        last = np.searchsorted(level[self._order], np.arange(len(variants)), side="right")
        bounds = [0, *(int(self._ends[k - 1]) if k else 0 for k in last)]
        spans = [
            [(start, end, int(variant)) for start in range(begin, end, self.size)]
            for begin, end, variant in zip(bounds, bounds[1:], variants, strict=False)
        ]
        # One block of each kind first, so that their programs are compiled side by side.
        self.kinds = sum(map(bool, spans))
        self._spans = [some[0] for some in spans if some] + [span for some in spans for span in some[1:]]

    def __len__(self) -> int:
        return len(self._spans)

    def __getitem__(self, number: int) -> Block:
        start, end, variant = self._spans[number]
        work = np.minimum(np.arange(start, start + self.size), end - 1)
        low, high = np.searchsorted(self._ends, [work[0], work[-1]], side="right")
        pixel = low + np.searchsorted(self._ends[low : high + 1], work, side="right")
        part = work - (self._ends[pixel] - self._parts[pixel])
        place = (pixel - low).astype(np.int32)
        place[end - start :] = self.size
        places = self._order[low : high + 1]
        return Block(self._order[pixel].astype(part.dtype), part, places, place, variant)
