"""Pictures of a shot as a whole: settings and blur over time, and all frames on one sheet."""

from collections.abc import Sequence
from pathlib import Path

import imageio.v3 as iio
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from focusjax.shot._solve import SolvedShot

_LABELS = {
    "focus_per_m": "focus, dioptres (1/m)",
    "f_number": "f-number",
    "focal_length_mm": "focal length, mm",
    "tilt_deg": "tilt, degrees",
    "swing_deg": "swing, degrees",
    "image_distance_mm": "image distance, mm",
}
_ROUNDING = 1e-6
"""The share of a setting by which it may differ from frame to frame without having changed."""


def save_settings_curves(path: Path, solved: SolvedShot) -> None:
    """Draw every setting that changes, frame by frame, as a PNG; the focus always."""
    settings = solved.solution.settings()
    drawn = {
        name: values
        for name, values in settings.items()
        if name == "focus_per_m" or not np.allclose(values, values[0], rtol=_ROUNDING, atol=0.0)
    }
    figure = Figure(figsize=(8.0, 0.4 + 2.0 * len(drawn)), layout="constrained")
    FigureCanvasAgg(figure)
    frames = np.arange(1, solved.solution.count + 1)
    for axes, (name, values) in zip(
        figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0], drawn.items(), strict=True
    ):
        axes.plot(frames, values, "-o", markersize=3, color="#a8531f")
        axes.set_ylabel(_LABELS[name])
        axes.grid(alpha=0.25)
    figure.axes[-1].set_xlabel("frame")
    figure.savefig(path, dpi=110)


def save_blur_curves(path: Path, solved: SolvedShot) -> None:
    """Draw the blur that each wish got, its mean over the wish's samples, and how much the wish counted."""
    solution, points = solved.solution, solved.solution.points
    frames = np.arange(1, solution.count + 1)
    blur, wish = np.asarray(solution.blur), np.asarray(points.wish)
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
    for number, name in enumerate(points.names):
        mean = [blur[t][wish[t] == number].mean() for t in range(solution.count)]
        (line,) = above.plot(frames, mean, alpha=0.35, linewidth=1.2)
        acting = np.where(solved.share[:, number] > 0, mean, np.nan)
        above.plot(frames, acting, "-", linewidth=2.4, color=line.get_color(), label=name)
        below.plot(frames, solved.share[:, number], "-", color=line.get_color())
    above.axhline(0.0, color="black", linewidth=0.6)
    above.set_ylabel("blur diameter, px: behind the focus +")
    above.legend(fontsize=8)
    below.set_ylabel("counts")
    below.set_ylim(-0.05, 1.05)
    below.set_xlabel("frame")
    for axes in (above, below):
        axes.grid(alpha=0.25)
    figure.savefig(path, dpi=110)


def save_contact_sheet(path: Path, pictures: Sequence[Path], *, most: int = 24, width: int = 200) -> None:
    """Put at most `most` of the pictures in rows of six on one sheet, each `width` pixels wide."""
    from skimage.transform import resize_local_mean

    count = min(most, len(pictures))
    chosen = np.unique(np.round(np.linspace(0, len(pictures) - 1, count)).astype(int))
    small = []
    for number in chosen:
        picture = np.asarray(iio.imread(pictures[number]))
        largest = float(np.iinfo(picture.dtype).max)
        size = (max(1, round(picture.shape[0] * width / picture.shape[1])), width)
        shrunk = resize_local_mean(picture[..., :3] / largest, size, channel_axis=-1)
        small.append(np.pad(shrunk, [(2, 2), (2, 2), (0, 0)], constant_values=1.0))
    columns = min(6, len(small))
    small += [np.ones_like(small[0])] * (-len(small) % columns)
    rows = [np.concatenate(small[start : start + columns], axis=1) for start in range(0, len(small), columns)]
    sheet = np.concatenate(rows, axis=0)
    iio.imwrite(path, np.round(255.0 * np.clip(sheet, 0.0, 1.0)).astype(np.uint8), extension=".png")
