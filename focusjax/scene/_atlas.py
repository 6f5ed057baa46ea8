"""All textures with their mip pyramids in one flat array, so that a lookup is only gathers."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._device import device_array
from focusjax._kept import kept


class Atlas(eqx.Module):
    """Textures as box-filtered pyramids; looked up trilinearly, repeating beyond 0 to 1.

    Williams 1983. Level 0 is the picture itself, each further level half as wide and high, down
    to a single texel.

    Attributes:
        texels: the channels (linear red, green and blue, or opacity alone) of all levels of all
            textures, each flat.
        first_level: number of a texture's level 0 in the level tables [texture].
        level_count: levels of a texture [texture].
        offset: where a level's texels begin [level].
        width: texels per row of a level [level].
        height: rows of a level [level].
    """

    texels: tuple[Float[Array, "n"], ...]
    first_level: Int[Array, "textures"]
    level_count: Int[Array, "textures"]
    offset: Int[Array, "levels"]
    width: Int[Array, "levels"]
    height: Int[Array, "levels"]

    def __call__(
        self, texture: Int[Array, ""], uv: Float[Array, "2"], footprint: Float[Array, ""]
    ) -> Float[Array, "c"]:
        """Mean around `uv` over a square of `footprint` level-0 texels.

        Below one texel the picture is interpolated bilinearly. `uv` has u to the right and v
        upwards. Differentiable in the texels and in `uv`.
        """
        number, coarser, share = self.levels(texture, footprint)
        near, far = self.bilinear(number, uv)[0], self.bilinear(coarser, uv)[0]
        return near + share * (far - near)

    def levels(
        self, texture: Int[Array, ""], footprint: Float[Array, ""]
    ) -> tuple[Int[Array, ""], Int[Array, ""], Float[Array, ""]]:
        """The levels on either side of a footprint, finer first, and the share of the coarser one."""
        highest = self.level_count[texture] - 1
        # Levels double in texel size; the smallest footprint stands for "finer than the picture".
        level = jnp.log2(jnp.maximum(footprint, 1.0))
        level = jnp.minimum(level, highest.astype(level.dtype))
        finer = jnp.floor(level)
        number = self.first_level[texture] + finer.astype(int)
        coarser = jnp.minimum(number + 1, self.first_level[texture] + highest)
        return number, coarser, level - finer

    def texel_centre(self, texture: Int[Array, ""], uv: Float[Array, "2"]) -> Float[Array, "2"]:
        """The centre of the level-0 texel that `uv` is in."""
        level = self.first_level[texture]
        size = jnp.stack([self.width[level], self.height[level]])
        return (jnp.floor(uv * size) + 0.5) / size

    def bilinear(
        self, level: Int[Array, ""], uv: Float[Array, "2"]
    ) -> tuple[Float[Array, "c"], Float[Array, "c 2"]]:
        """The channels at `uv` in one level, and how they change per texel to the right and downwards."""
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

        def blend(plane: Float[Array, "n"]) -> tuple[Float[Array, ""], Float[Array, "2"]]:
            corners = plane[upper + x0], plane[upper + x1], plane[lower + x0], plane[lower + x1]
            top = corners[0] * (1.0 - across) + corners[1] * across
            bottom = corners[2] * (1.0 - across) + corners[3] * across
            rightwards = (corners[1] - corners[0]) * (1.0 - down) + (corners[3] - corners[2]) * down
            return top * (1.0 - down) + bottom * down, jnp.stack([rightwards, bottom - top])

        values, slopes = zip(*(blend(plane) for plane in self.texels), strict=True)
        return jnp.stack(values), jnp.stack(slopes)


def make_atlas(textures: Sequence[Float[np.ndarray, "_ _ 3"]]) -> Atlas:
    """The atlas of linear pictures [h, w, 3], after a white texel as texture 0.

    It is kept as long as the first picture is: of things that move, the same ones are asked for again and
    again.
    """
    white = np.ones((1, 1, 3), dtype=np.float32)

    def make() -> Atlas:
        return atlas_of([pyramid(picture) for picture in (white, *textures)])

    if not textures:
        return make()
    first, *others = textures
    return kept(first, ("atlas", str(jnp.zeros(()).dtype), _Same(tuple(others))), make)


@dataclasses.dataclass(frozen=True)
class _Same:
    """Pictures that are equal to others if they are these very ones; nobody changes them in place."""

    pictures: tuple[np.ndarray, ...]

    def __hash__(self) -> int:
        return hash(tuple(map(id, self.pictures)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and [*map(id, self.pictures)] == [*map(id, other.pictures)]


def atlas_of(pyramids: Sequence[Sequence[Float[np.ndarray, "_ _ c"]]]) -> Atlas:
    """The atlas of pictures given with all their levels."""
    levels = [level for picture in pyramids for level in picture]
    count = np.array([len(picture) for picture in pyramids])
    first = np.cumsum(count) - count
    sizes = np.array([level.shape[:2] for level in levels])
    area = sizes.prod(axis=1)

    def plane(channel: int) -> Float[Array, " n"]:
        return device_array(np.concatenate([level[..., channel].ravel() for level in levels]), dtype=float)

    def table(values: Sequence[int] | np.ndarray) -> Int[Array, "_"]:
        return device_array(values, dtype=jnp.int32)

    return Atlas(
        texels=tuple(plane(channel) for channel in range(levels[0].shape[2])),
        first_level=table(first),
        level_count=table(count),
        offset=table(np.cumsum(area) - area),
        width=table(sizes[:, 1]),
        height=table(sizes[:, 0]),
    )


def pyramid(picture: Float[np.ndarray, "_ _ c"]) -> list[Float[np.ndarray, "_ _ c"]]:
    """The picture and its halvings by area means, down to one texel."""
    levels = [picture]
    while levels[-1].shape[:2] != (1, 1):
        fine = levels[-1]
        height, width = (max(1, size // 2) for size in fine.shape[:2])
        if fine.shape[:2] == (2 * height, 2 * width):
            coarse = fine.reshape(height, 2, width, 2, -1).mean(axis=(1, 3))
        else:
            from skimage.transform import resize_local_mean

            coarse = resize_local_mean(fine, (height, width), channel_axis=-1, preserve_range=True)
        levels.append(coarse.astype(picture.dtype))
    return levels


def _wrap(index: Int[Array, ""], size: Int[Array, ""]) -> Int[Array, ""]:
    wrapped = jnp.where(index < 0, index + size, index)
    return jnp.where(wrapped >= size, wrapped - size, wrapped)
