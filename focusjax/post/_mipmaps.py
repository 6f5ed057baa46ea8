"""Coverage-weighted mip maps: means over blocks of those pixels that belong there (Lee09 section 4.3)."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def block_means(
    planes: Float[Array, "c h w"], coverage: Float[Array, "h w"], edge: int
) -> tuple[Float[Array, "c m n"], Float[Array, "m n"]]:
    """Means of `planes` over blocks of `edge` x `edge` pixels, weighted by `coverage`, and its own means.

    What is not covered leaves no trace, so that colours of other surfaces do not bleed into a block. Blocks
    that stick out of the picture are means of what is inside. Where nothing is covered the means are 0.

    Args:
        planes: values, such as colour, not multiplied by coverage.
        coverage: weights from 0 to 1.
        edge: of a block in pixels.
    """
    inside = _block_sums(jnp.ones_like(coverage)[None], edge)[0]
    covered = _block_sums(coverage[None], edge)[0]
    total = _block_sums(planes * coverage[None], edge)
    return total / jnp.where(covered > 0.0, covered, 1.0)[None], covered / inside


def _block_sums(planes: Float[Array, "c h w"], edge: int) -> Float[Array, "c m n"]:
    count, height, width = planes.shape
    padded = jnp.pad(planes, ((0, 0), (0, -height % edge), (0, -width % edge)))
    rows, columns = padded.shape[1] // edge, padded.shape[2] // edge
    return padded.reshape(count, rows, edge, columns, edge).sum(axis=(2, 4))
