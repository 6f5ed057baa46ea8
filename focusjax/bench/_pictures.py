"""The Pareto plot, and pictures small enough to lie within a page."""

import base64
import io
import math
from pathlib import Path

import jax.numpy as jnp
import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from PIL import Image

from focusjax.bench._run import CaseResults, Results
from focusjax.film import to_bytes

ERROR_PEAK = 0.1
"""Radiance difference that error pictures show brightest."""
_WIDEST = 560
_MARKERS = "osD^v<>Phd"


def save_pareto(path: Path, results: Results) -> None:
    """Draw PSNR against seconds, one row of axes for each case: without set-up, and with it.

    Up and to the left is better.
    """
    count = len(results.cases)
    figure = Figure(figsize=(10.0, 0.9 + 3.5 * count), layout="constrained")
    axes = np.asarray(figure.subplots(count, 2, sharey="row", squeeze=False))
    for found, (left, right) in zip(results.cases, axes, strict=True):
        for panel, with_setup in ((left, False), (right, True)):
            _curves(panel, found, results, with_setup=with_setup)
        left.set_ylabel("PSNR in dB")
        left.set_title(f"{found.case.title}: picture alone", loc="left", fontsize=10)
        right.set_title("with set-up", loc="left", fontsize=10)
    for panel in axes[-1]:
        panel.set_xlabel("seconds")
    handles = {}
    for panel in axes[:, 0]:
        handles |= {line.get_label(): line for line in panel.get_lines() if line.get_label()[0] != "_"}
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, frameon=False)
    figure.savefig(path, dpi=130)


def _curves(axes: Axes, found: CaseResults, results: Results, *, with_setup: bool) -> None:
    colours = matplotlib.colormaps["tab10"]
    for number, method in enumerate(results.methods):
        rows = [row for row in found.rows if row.method == method.name and math.isfinite(row.psnr)]
        if not rows:
            continue
        axes.plot(
            [row.seconds + (row.setup_seconds if with_setup else 0.0) for row in rows],
            [row.psnr for row in rows],
            marker=_MARKERS[number % len(_MARKERS)],
            color=colours(number % 10),
            linewidth=2.2 if method.name.startswith("tracer") else 1.2,
            markersize=5,
            label=method.title,
        )
    anchor = found.anchor()
    if anchor is not None:
        axes.axhline(anchor.psnr, color="0.6", linewidth=0.8, linestyle="--", zorder=0)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, which="major", color="0.9", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def picture_url(image: Float[np.ndarray, "h w 3"]) -> str:
    """A linear picture as a data URL, as a screen shows it."""
    return _url(to_bytes(jnp.asarray(image, dtype=float)))


def error_url(image: Float[np.ndarray, "h w 3"], reference: Float[np.ndarray, "h w 3"]) -> str:
    """Where and how far two pictures differ, as a data URL: black where equal, mean of the channels."""
    share = np.clip(np.abs(image - reference).mean(axis=-1) / ERROR_PEAK, 0.0, 1.0)
    return _url((matplotlib.colormaps["inferno"](share)[..., :3] * 255).round().astype(np.uint8))


def file_url(path: Path) -> str:
    """A PNG file as a data URL."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def _url(pixels: np.ndarray) -> str:
    picture = Image.fromarray(pixels)
    if picture.width > _WIDEST:
        size = (_WIDEST, round(picture.height * _WIDEST / picture.width))
        picture = picture.resize(size, Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    picture.save(stream, format="JPEG", quality=92, subsampling=0)
    return "data:image/jpeg;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
