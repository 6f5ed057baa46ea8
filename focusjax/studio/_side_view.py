"""The scene from above as SVG: camera, objects, the plane in focus with its zone, and the wishes."""

import dataclasses
from collections.abc import Callable
from html import escape

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial import ConvexHull, QhullError

from focusjax._programs import jit
from focusjax._settings import metres
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.studio._answer import Answer
from focusjax.studio._stage import Stage

_COLUMNS = 41
_FAR = 97.0
"""Percentile of visible distances that the view reaches to."""
_LEAST_SHARE = 0.004
"""Of the view's depth: objects smaller than this are left out."""

_MOST_MARKS = 5
"""On the ruler."""

Points = Float[np.ndarray, "n 2"]


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """What of the view from above is the same for all lenses.

    Attributes:
        depth: metres along the view axis that are shown at least.
        outlines: names and hulls [n, 2] of the objects, metres ahead and to the right.
    """

    depth: float
    outlines: tuple[tuple[str, Points], ...]


def make_plan(stage: Stage) -> Plan:
    """The plan of a stage, which takes longer than to draw it."""
    seen = stage.disparity[stage.disparity > 0]
    far = float(np.percentile(1.0 / seen, _FAR)) if len(seen) else 10.0
    depth = 1.12 * far
    vertices = np.asarray(stage.scene.vertices, dtype=float)
    pose = np.asarray(stage.camera.world_from_camera, dtype=float)
    axes = (vertices - pose[:3, 3]) @ pose[:3, :3]
    above = np.column_stack([-axes[:, 2], axes[:, 0]])
    outlines = []
    for name, faces in stage.scene.objects.items():
        mine = above[np.unique(stage.scene.faces[faces.start : faces.stop])]
        if len(mine) < 3 or np.ptp(mine, axis=0).max() < _LEAST_SHARE * depth:
            continue
        try:
            outlines.append((name, mine[ConvexHull(mine).vertices]))
        except QhullError:
            # All in one line, as a wall that is seen edge-on.
            outlines.append((name, mine[[mine[:, 1].argmin(), mine[:, 1].argmax()]]))
    return Plan(depth, tuple(outlines))


@jit
def _focus(
    lens: AbstractLens, camera: Camera
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """Across the picture's middle row: tangents, disparities in focus, and blur in px per dioptre."""
    across = jnp.linspace(0.0, camera.width, _COLUMNS)

    def one(x: Array) -> tuple[Array, Array, Array]:
        place = jnp.stack([x, camera.principal_point[1].astype(x.dtype)])
        at_infinity, at_one = (lens.blur(camera, place, jnp.asarray(w, x.dtype)) for w in (0.0, 1.0))
        slope = at_infinity - at_one
        tangent = (x - camera.principal_point[0]) / camera.focal_px
        return tangent, at_infinity / jnp.where(slope == 0.0, 1.0, slope), slope

    return jax.vmap(one)(across)


def side_view(answer: Answer, plan: Plan, width: int, height: int, selected: int | None = None) -> str:
    """The view as SVG of `width` x `height`: the camera is on the left and looks to the right."""
    camera = answer.stage.camera
    wished = [1.12 * row.distance for row in answer.wishes if np.isfinite(row.distance)]
    plan = dataclasses.replace(plan, depth=max([plan.depth, *wished]))
    margin = 26
    half = 0.5 * camera.width / float(camera.focal_px) * plan.depth
    scale = min((width - margin - 8) / plan.depth, (height - 16) / (2.2 * half))

    def at(points: Points) -> str:
        return " ".join(f"{margin + scale * z:.1f},{height / 2 + scale * x:.1f}" for z, x in points)

    parts = [
        f'<polygon points="{at(outline)}" class="thing"><title>{escape(name)}</title></polygon>'
        for name, outline in plan.outlines
        if outline[:, 0].min() < 1.3 * plan.depth
    ]
    edges = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]]) * plan.depth
    tangents = (np.array([0.0, camera.width]) - float(camera.principal_point[0])) / float(camera.focal_px)
    edges[1:, 1] = plan.depth * tangents
    parts.append(f'<polygon points="{at(edges)}" class="frame"/>')
    if answer.outcome is not None:
        parts += _zone(answer, plan, at)
    for number, (row, mark) in enumerate(zip(answer.wishes, answer.marks(), strict=False)):
        if mark is None or not np.isfinite(row.distance):
            continue
        tangent = (mark[0] - float(camera.principal_point[0])) / float(camera.focal_px)
        x, y = at(np.array([[row.distance, tangent * row.distance]])).split(",")
        state = "chosen" if number == selected else "met" if row.met or not row.counts else "missed"
        parts.append(
            f'<circle cx="{x}" cy="{y}" r="4.5" class="wish {state}"/>'
            f'<text x="{float(x) + 7:.1f}" y="{float(y) + 4:.1f}" class="number">{number + 1}</text>'
        )
    middle = height / 2
    camera_shape = f"M4 {middle - 8}h12v4l6-4v16l-6-4v4h-12z"
    parts.append(f'<path d="{camera_shape}" class="camera"><title>camera</title></path>')
    parts += _ruler(plan.depth, margin, scale, height)
    return (
        f'<svg viewBox="0 0 {width} {height}" class="fj-above" role="img"'
        f' aria-label="The scene from above">{"".join(parts)}</svg>'
    )


def _zone(answer: Answer, plan: Plan, at: Callable[[Points], str]) -> list[str]:
    """The plane in focus, and between which distances blur stays within the circle of confusion."""
    outcome = answer.outcome
    assert outcome is not None
    lens = outcome.lens
    tangents, focus, slope = (np.asarray(each, dtype=float) for each in _focus(lens, outcome.camera))
    sharp = answer.depth_of_field()
    assert sharp is not None
    room = sharp.circle_px / np.maximum(np.abs(slope), 1e-12)

    def curve(disparity: np.ndarray) -> Points:
        depth = 1.0 / np.maximum(disparity, 1.0 / (1.3 * plan.depth))
        return np.column_stack([depth, tangents * depth])

    zone = np.concatenate([curve(focus + room), curve(focus - room)[::-1]])
    return [
        f'<polygon points="{at(zone)}" class="zone"><title>zone of focus</title></polygon>',
        f'<polyline points="{at(curve(focus))}" class="focus"><title>in focus</title></polyline>',
    ]


def _ruler(depth: float, margin: int, scale: float, height: int) -> list[str]:
    """A few round distances below."""
    least = depth / _MOST_MARKS
    power = 10.0 ** np.floor(np.log10(least))
    step = next(power * each for each in (1, 2, 5, 10) if power * each >= least)
    marks = np.arange(step, depth, step)
    return [
        f'<text x="{margin + scale * mark:.1f}" y="{height - 3}" class="ruler">{metres(mark)}</text>'
        for mark in marks
    ]
