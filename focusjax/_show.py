"""What notebooks show of scenes, lenses, layers, solutions and pictures."""

import base64
import dataclasses
import html
import io
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image

from focusjax._arguments import ArgumentError
from focusjax._settings import metres
from focusjax.film import to_bytes
from focusjax.focus import FramesSolution, Solution, SurfaceSolution
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, ThinLens, TiltShiftLens
from focusjax.scene import Scene
from focusjax.trace import render_pinhole

_WIDTH = 320
"""Pixels of a picture in a notebook, at most."""


@dataclasses.dataclass(frozen=True, repr=False)
class Shown:
    """A piece of a page, which notebooks show; elsewhere its text is printed.

    Attributes:
        text: in a line or a few.
        page: the same as HTML.
    """

    text: str
    page: str

    def __repr__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return self.page


def show(thing: Any, *, exposure: float = 0.0) -> Shown:
    """A small picture, settings or a table of something, for a notebook.

    Args:
        thing: a scene, a lens, layers, a solution of any kind, or a picture [h, w, 3] of linear radiance.
        exposure: stops by which a picture is shown brighter, as for `save_png`.

    Raises:
        ArgumentError: something else.

    Example:
        >>> from focusjax.lens import thin_lens
        >>> show(thin_lens(focus_distance=2.0, f_number=2.0, focal_length=0.05))
        ThinLens: focus 2.00 m, opening 25 mm across
    """
    if isinstance(thing, Solution | SurfaceSolution | FramesSolution):
        return Shown(str(thing), thing._repr_html_())
    if isinstance(thing, Scene):
        return _scene(thing)
    if isinstance(thing, AbstractLens):
        text = _lens(thing)
        return Shown(text, f"<p>{html.escape(text)}</p>")
    if isinstance(thing, Layers):
        text = repr(thing)
        return Shown(text, _picture(render_pinhole(thing), exposure) + f"<p>{html.escape(text)}</p>")
    if isinstance(thing, np.ndarray | jax.Array) and thing.ndim == 3 and thing.shape[2] == 3:
        height, width, _ = thing.shape
        return Shown(f"Picture of {width} x {height} pixels", _picture(thing, exposure))
    raise ArgumentError(
        f"thing is a {type(thing).__name__}; expected a scene, a lens, layers, a solution or a picture"
        " [h, w, 3]",
        "thing",
    )


def _scene(scene: Scene) -> Shown:
    rows = []
    for name, faces in scene.objects.items():
        corners = scene.vertices[scene.faces[faces.start : faces.stop].ravel()]
        size = " x ".join(metres(float(each)) for each in np.ptp(corners, axis=0)) if len(corners) else "-"
        rows.append((name, f"{len(faces)}", size))
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    head = "".join(f"<th>{each}</th>" for each in ("object", "triangles", "width x height x depth"))
    return Shown(
        repr(scene),
        f"<div><p>{html.escape(repr(scene))}</p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody>"
        "</table></div>",
    )


def _lens(lens: AbstractLens) -> str:
    name = type(lens).__name__
    if not isinstance(lens, ThinLens | TiltShiftLens):
        return name
    return (
        f"{name}: focus {metres(float(lens.focus_distance()))}, opening"
        f" {2000 * float(lens.aperture_radius):.3g} mm across"
    )


def _picture(image: Any, exposure: float) -> str:
    """A picture as part of a page, made smaller where it is wide."""
    pixels = Image.fromarray(to_bytes(jnp.asarray(image), exposure=exposure))
    height, width = np.shape(image)[:2]
    if width > _WIDTH:
        pixels = pixels.resize((_WIDTH, max(1, round(height * _WIDTH / width))), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    pixels.save(stream, "PNG")
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    size = f'width="{pixels.width}" height="{pixels.height}"'
    return f'<img src="data:image/png;base64,{data}" {size} alt="picture">'
