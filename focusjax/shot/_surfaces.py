"""A focal surface over the frames of a shot: its control points where the cameras see them."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax.focus import ArgumentError, ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import FocalSurface, ThinLens
from focusjax.shot._wishes import LocatedWishes, TimedWish, counted

CONTROL_SAMPLES = 64
"""Points of an object or a mask whose mean its control point is: it goes along, and does not jump."""


@dataclasses.dataclass(frozen=True)
class TimedSurface:
    """The control points of a shot's focal surface.

    Attributes:
        controls: places and wished signed blurs, which may move, appear and disappear.
        build: from a frame's number, its control points as they were found (a row each), camera and lens to
            the surface before solving.
        roughness: weight of the change of blur over the picture, as `smoothness` of `solve_focal_surface`.
        favour_near: how much more near points count where several overlap.

    Raises:
        ArgumentError: (a `ValueError`) no control points.
    """

    controls: tuple[TimedWish, ...]
    build: Callable[[int, ImagePoints, Camera, ThinLens], FocalSurface]
    roughness: float = 1e-3
    favour_near: float = 1.0

    def __post_init__(self) -> None:
        if not self.controls:
            raise ArgumentError("a focal surface has no control points; give at least one", "controls")


def find_surfaces(
    surface: TimedSurface,
    cameras: Sequence[Camera],
    lenses: Sequence[ThinLens],
    found: LocatedWishes,
    *,
    fade_frames: float,
) -> list[FocalSurface]:
    """The surface of every frame before solving.

    A point that appears or disappears, is hidden or leaves the frame, rules less and less of its
    neighbourhood before (`find_wishes`). Frames in which none counts have the weights of the nearest one in
    which some does.

    Args:
        surface: the control points.
        cameras: one a frame.
        lenses: one a frame.
        found: its control points in every frame, as `located` gives them.
        fade_frames: frames from nothing to full weight.

    Raises:
        ArgumentError: none of them counts in any frame.
    """
    faded = counted(
        surface.controls,
        found,
        fade_frames=fade_frames,
        favour_near=surface.favour_near,
        called="control point",
    )
    points = [one_row_each(each) for each in faded.points]
    there = np.flatnonzero([float(np.sum(np.asarray(each.weight))) > 0 for each in points])
    made = []
    for frame, (each, camera, lens) in enumerate(zip(points, cameras, lenses, strict=True)):
        weight = points[int(there[np.argmin(np.abs(there - frame))])].weight
        made.append(surface.build(frame + 1, dataclasses.replace(each, weight=weight), camera, lens))
    return made


def one_row_each(points: ImagePoints) -> ImagePoints:
    """The points with the samples of each wish in one row: the means of where they are seen."""
    wish, weight = np.asarray(points.wish), np.asarray(points.weight, dtype=float)
    count = len(points.names)
    total = np.bincount(wish, weight, minlength=count)
    # Of what does not count, all samples are as good.
    share = np.where(total[wish] > 0, weight, 1.0)
    share = share / np.bincount(wish, share, minlength=count)[wish]

    def mean(values: Any) -> Float[np.ndarray, "m"]:
        return np.bincount(wish, share * np.asarray(values, dtype=float), minlength=count)

    xy = np.stack([mean(points.xy[:, 0]), mean(points.xy[:, 1])], axis=1)
    return ImagePoints(
        xy=jnp.asarray(xy),
        disparity=jnp.asarray(mean(points.disparity)),
        target=jnp.asarray(mean(points.target)),
        signed=jnp.ones(count, dtype=bool),
        weight=jnp.asarray(total),
        tolerance=jnp.asarray(mean(points.tolerance)),
        wish=jnp.arange(count),
        names=points.names,
        notes=points.notes,
    )
