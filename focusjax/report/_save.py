"""The files of a run's folder."""

import base64
import importlib
from contextlib import suppress
from pathlib import Path

import numpy as np

from focusjax.config import Config
from focusjax.io import json_text, save_exr, save_png
from focusjax.job import Outcome
from focusjax.report._page import page
from focusjax.report._summary import summary

FILES = ("report.json", "report.html", "blur.png", "image.png", "image.exr", "pinhole.png")
"""Every file that a run can leave in its folder."""


def import_drawing() -> None:
    """Import what `save_outcome` draws with, which takes half a second: for a thread beside other work."""
    # What is wrong is said when it is drawn.
    with suppress(Exception):
        importlib.import_module("focusjax.report._blur_picture")


def save_outcome(folder: Path, outcome: Outcome) -> None:
    """Write the reports and the blur map, and the pictures when there are any.

    The files are report.json, report.html and blur.png; image.png, image.exr and pinhole.png.

    Args:
        folder: an existing folder.
        outcome: what `run` returned.
    """
    # matplotlib takes long to import.
    from focusjax.report._blur_picture import save_blur_picture

    render = outcome.config.render
    pictures = {}
    if outcome.picture is not None:
        shown = outcome.picture if outcome.photograph is None else outcome.photograph
        stops = render.exposure if outcome.photograph is None else 0.0
        save_png(folder / "image.png", shown.image, exposure=stops, bits=render.png_bits)
        save_png(folder / "pinhole.png", shown.pinhole, exposure=stops)
        with np.errstate(divide="ignore"):
            depth = 1.0 / outcome.disparity
        save_exr(folder / "image.exr", outcome.picture.image, depth=depth, blur=outcome.blur)
        pictures = {"image": "image.png", "pinhole": "pinhole.png"}
    save_blur_picture(folder / "blur.png", outcome.blur, _marks(outcome))
    pictures["blur"] = "blur.png"
    facts = summary(outcome)
    (folder / "report.json").write_text(json_text(facts))
    embedded = {kind: data_url(folder / name) for kind, name in pictures.items()}
    (folder / "report.html").write_text(page(title_of(outcome.config), facts, embedded), encoding="utf-8")


def data_url(path: Path) -> str:
    """A PNG file as a part of a page."""
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def title_of(config: Config) -> str:
    """The title of a config's report."""
    return config.title or config.source.stem.replace("_", " ").capitalize()


def _marks(outcome: Outcome) -> list[tuple[str, np.ndarray]]:
    """Name and image positions of every wish."""
    points = outcome.points
    if points is None:
        return []
    positions, wish = np.asarray(points.xy), np.asarray(points.wish)
    return [(name, positions[wish == number]) for number, name in enumerate(points.names)]
