"""A picture of the blur: where it is, which side of the focus it is on, and where the wishes are."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import FuncNorm
from matplotlib.figure import Figure

_WIDTH_INCHES = 6.0
_LONGEST_NAME = 40
_HALO = [patheffects.withStroke(linewidth=2.5, foreground="white")]


def save_blur_picture(
    path: Path,
    blur: Float[np.ndarray, "h w"],
    marks: list[tuple[str, Float[np.ndarray, "_ 2"]]],
) -> None:
    """Draw the signed `blur` diameter in pixels [h, w] with the focus points on it, as a PNG.

    White is in focus, red behind it and blue in front. Colours go by the square root of the blur,
    so that small blur shows next to strong blur.

    Args:
        path: file to write.
        blur: positive behind the focus.
        marks: names and image positions in pixels [n, 2] of the wishes.
    """
    height, width = blur.shape
    figure = Figure(figsize=(_WIDTH_INCHES, _WIDTH_INCHES * height / width + 0.72))
    figure.set_layout_engine("constrained", w_pad=0.0, h_pad=0.03)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    largest = max(2.0, float(np.abs(blur).max()))
    shown = axes.imshow(
        blur,
        cmap="RdBu_r",
        norm=FuncNorm((_signed_root, _signed_square), vmin=-largest, vmax=largest),
        extent=(0, width, height, 0),
        interpolation="nearest",
    )
    bar = figure.colorbar(shown, ax=axes, orientation="horizontal", fraction=0.06, pad=0.02, aspect=45)
    ticks = [tick for tick in (1, 3, 10, 30, 100, 300, 1000) if largest / 100 < tick <= largest]
    values = [-tick for tick in reversed(ticks)] + [0, *ticks]
    bar.set_ticks(values, labels=[f"{value:+d}" if value else "0" for value in values])
    bar.ax.minorticks_off()
    bar.set_label("blur diameter in pixels:  in front of the focus (-), behind it (+)")
    for number, (name, positions) in enumerate(marks, start=1):
        short = name if len(name) <= _LONGEST_NAME else f"{name[: _LONGEST_NAME - 3]}..."
        _mark(axes, f"{number} {short}", positions, width)
    axes.set_xticks([])
    axes.set_yticks([])
    figure.savefig(path, dpi=160)


def _signed_root(value: np.ndarray) -> np.ndarray:
    return np.sign(value) * np.sqrt(np.abs(value))


def _signed_square(value: np.ndarray) -> np.ndarray:
    return np.sign(value) * value**2


def _mark(axes: Axes, label: str, positions: Float[np.ndarray, "n 2"], width: int) -> None:
    """A ring on each of the wish's points and its name beside the first."""
    size = 60 if len(positions) == 1 else 8
    axes.scatter(*positions.T, s=size, facecolors="none", edgecolors="black", linewidths=1.2)
    middle = positions[np.argmin(np.linalg.norm(positions - positions.mean(axis=0), axis=1))]
    left = middle[0] > 0.7 * width
    axes.annotate(
        label,
        middle,
        xytext=(-9 if left else 9, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        va="center",
        fontsize=9,
        path_effects=_HALO,
    )
