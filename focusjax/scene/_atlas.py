"""All textures with their mip pyramids in one flat array, so that a lookup is only gathers."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from skimage.transform import resize_local_mean


class Atlas(eqx.Module):
    """Textures as box-filtered pyramids; looked up trilinearly, repeating beyond 0 to 1.

    Williams 1983. Level 0 is the picture itself, each further level half as wide and high, down
    to a single texel.

    Attributes:
        texels: linear red, green and blue of all levels of all textures, each flat.
        first_level: number of a texture's level 0 in the level tables [texture].
        level_count: levels of a texture [texture].
        offset: where a level's texels begin [level].
        width: texels per row of a level [level].
        height: rows of a level [level].
    """

    texels: tuple[Float[Array, "n"], Float[Array, "n"], Float[Array, "n"]]
    first_level: Int[Array, "textures"]
    level_count: Int[Array, "textures"]
    offset: Int[Array, "levels"]
    width: Int[Array, "levels"]
    height: Int[Array, "levels"]

    def __call__(
        self, texture: Int[Array, ""], uv: Float[Array, "2"], footprint: Float[Array, ""]
    ) -> Float[Array, "3"]:
        """Mean linear colour around `uv` over a square of `footprint` level-0 texels.

        Below one texel the picture is interpolated bilinearly. `uv` has u to the right and v
        upwards. Differentiable in the texels and in `uv`.
        """
        highest = self.level_count[texture] - 1
        # Levels double in texel size; the smallest footprint stands for "finer than the picture".
        level = jnp.log2(jnp.maximum(footprint, 1.0))
        level = jnp.minimum(level, highest.astype(level.dtype))
        finer = jnp.floor(level)
        number = self.first_level[texture] + finer.astype(int)
        coarser = jnp.minimum(number + 1, self.first_level[texture] + highest)
        near, far = self._bilinear(number, uv), self._bilinear(coarser, uv)
        return near + (level - finer) * (far - near)

    def _bilinear(self, level: Int[Array, ""], uv: Float[Array, "2"]) -> Float[Array, "3"]:
        width, height, offset = self.width[level], self.height[level], self.offset[level]
        # Only the fraction counts when pictures repeat, and it keeps precision far from 0.
        u, v = uv - jnp.floor(uv)
        column = u * width - 0.5
        row = (1.0 - v) * height - 0.5
        left, above = jnp.floor(column), jnp.floor(row)
        across, down = column - left, row - above
        # Both are -1 at least and the size at most, so one step wraps them.
        x0, y0 = _wrap(left.astype(int), width), _wrap(above.astype(int), height)
        x1, y1 = _wrap(x0 + 1, width), _wrap(y0 + 1, height)
        upper, lower = offset + y0 * width, offset + y1 * width

        def blend(plane: Float[Array, "n"]) -> Float[Array, ""]:
            top = plane[upper + x0] * (1.0 - across) + plane[upper + x1] * across
            bottom = plane[lower + x0] * (1.0 - across) + plane[lower + x1] * across
            return top * (1.0 - down) + bottom * down

        return jnp.stack([blend(plane) for plane in self.texels])


def make_atlas(textures: Sequence[Float[np.ndarray, "_ _ 3"]]) -> Atlas:
    """The atlas of linear pictures [h, w, 3], after a white texel as texture 0."""
    levels: list[np.ndarray] = []
    first, count = [], []
    for picture in (np.ones((1, 1, 3), dtype=np.float32), *textures):
        first.append(len(levels))
        levels += pyramid(picture)
        count.append(len(levels) - first[-1])
    sizes = np.array([level.shape[:2] for level in levels])
    area = sizes.prod(axis=1)
    flat = np.concatenate([level.reshape(-1, 3) for level in levels])
    red, green, blue = (jnp.asarray(flat[:, colour], dtype=float) for colour in range(3))

    def table(values: Sequence[int] | np.ndarray) -> Int[Array, "_"]:
        return jnp.asarray(values, dtype=jnp.int32)

    return Atlas(
        texels=(red, green, blue),
        first_level=table(first),
        level_count=table(count),
        offset=table(np.cumsum(area) - area),
        width=table(sizes[:, 1]),
        height=table(sizes[:, 0]),
    )


def pyramid(picture: Float[np.ndarray, "_ _ 3"]) -> list[Float[np.ndarray, "_ _ 3"]]:
    """The picture and its halvings by area means, down to one texel."""
    levels = [picture]
    while levels[-1].shape[:2] != (1, 1):
        fine = levels[-1]
        height, width = (max(1, size // 2) for size in fine.shape[:2])
        if fine.shape[:2] == (2 * height, 2 * width):
            coarse = fine.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
        else:
            coarse = resize_local_mean(fine, (height, width), channel_axis=-1, preserve_range=True)
        levels.append(coarse.astype(picture.dtype))
    return levels


def _wrap(index: Int[Array, ""], size: Int[Array, ""]) -> Int[Array, ""]:
    wrapped = jnp.where(index < 0, index + size, index)
    return jnp.where(wrapped >= size, wrapped - size, wrapped)
