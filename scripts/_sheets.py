"""Pictures side by side."""

from pathlib import Path

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from focusjax.film import to_bytes

GAP = 4


def beside(*pictures: np.ndarray, axis: int = 1) -> np.ndarray:
    """Pictures of bytes in a row, or below each other along axis 0, with white between them."""
    shape = [*pictures[0].shape[:2], 3]
    shape[axis] = GAP
    white = np.full(shape, 255, np.uint8)
    parts = [part for picture in pictures for part in (picture[..., :3], white)]
    return np.concatenate(parts[:-1], axis=axis)


def save_sheet(
    path: Path,
    pictures: dict[str, np.ndarray],
    *,
    row: tuple[float, float],
    dpi: int,
    quality: int,
    fontsize: int = 10,
    interpolation: str | None = "bilinear",
    by_columns: bool = False,
) -> None:
    """Linear pictures in two columns on black, with their names; `row` is its width and height in inches."""
    rows = -(-len(pictures) // 2)
    width, height = row
    figure, axes = plt.subplots(rows, 2, figsize=(width, height * rows), facecolor="black", squeeze=False)
    for panel in axes.flat:
        panel.axis("off")
    panels = axes.T if by_columns else axes
    for panel, (name, picture) in zip(panels.flat, pictures.items(), strict=False):
        panel.imshow(to_bytes(jnp.asarray(picture)), interpolation=interpolation)
        panel.set_title(name, color="white", fontsize=fontsize, pad=3)
    figure.tight_layout(pad=0.4)
    figure.savefig(path, dpi=dpi, facecolor="black", pil_kwargs={"quality": quality})
