"""Coverage-weighted mipmaps of the layers' colour (Lee09 section 4.4).

Level 0 holds, at each sample, its radiance times the share of its square that its surface covers (and, of
what may be seen through, hides), and that share; a texel of the next level is the mean of four of the one
before. Colour over coverage is then the mean colour of the surface under a texel, whatever the holes in it,
and light is kept from level to level.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from focusjax._counts import require_counts
from focusjax.layers._cells import covered_share
from focusjax.layers._layers import Layers


class ColourMipmaps(eqx.Module):
    """Weighted colours [l, h_i, w_i, 4] of each level: red, green and blue times coverage, and coverage."""

    levels: tuple[Float[Array, "l _ _ 4"], ...]

    def __call__(
        self, layer: Int[Array, ""], level: Int[Array, ""], position: Float[Array, "2"]
    ) -> Float[Array, "4"]:
        """Bilinear look-up at a grid `position` (x, y) in samples; nothing is beyond the grid.

        Args:
            layer: number of the layer.
            level: number of the level, from 0; one beyond the last is the last.
            position: grid coordinates, sample (i, j) having its centre at (i + 0.5, j + 0.5).
        """

        def at_level(texels: Float[Array, "l h w 4"], scale: int) -> Float[Array, "4"]:
            place = position / scale - 0.5
            first = jnp.floor(place).astype(jnp.int32)
            share = place - first
            total = jnp.zeros(4, dtype=texels.dtype)
            for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
                weight = jnp.abs(1 - dx - share[0]) * jnp.abs(1 - dy - share[1])
                texel = texels.at[layer, first[1] + dy, first[0] + dx].get(mode="fill", fill_value=0.0)
                inside = (first[0] + dx >= 0) & (first[1] + dy >= 0)
                total = total + jnp.where(inside, weight, 0.0) * texel
            return total

        branches = [
            lambda number=number, texels=texels: at_level(texels, 1 << number)
            for number, texels in enumerate(self.levels)
        ]
        return jax.lax.switch(jnp.clip(level, 0, len(self.levels) - 1), branches)

    @property
    def nbytes(self) -> int:
        """Bytes of all levels together."""
        return sum(level.nbytes for level in self.levels)


@eqx.filter_jit
def colour_mipmaps(layers: Layers, levels: int) -> ColourMipmaps:
    """The first `levels` levels for `layers`; each is half as wide and high as the one before, rounded up.

    Raises:
        ValueError: fewer than one level.
    """
    require_counts(levels=levels)
    radiance, opacity = layers.radiance, layers.opacity
    share = covered_share(layers.cells)[..., None].astype(radiance.dtype)
    if opacity is not None:
        share = share * opacity[..., None]
    texels = [jnp.concatenate([radiance * share, share], axis=-1)]
    for _ in range(levels - 1):
        finer = texels[-1]
        odd = [(0, 0), (0, finer.shape[1] % 2), (0, finer.shape[2] % 2), (0, 0)]
        padded = jnp.pad(finer, odd)
        upper, lower = (padded[:, row::2, 0::2] + padded[:, row::2, 1::2] for row in (0, 1))
        texels.append((upper + lower) / 4)
    return ColourMipmaps(tuple(texels))
