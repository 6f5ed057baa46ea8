"""Into how many spans the shutter's time is cut for each body."""

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from focusjax.geometry import Camera
from focusjax.layers import disparity_map
from focusjax.lens import AbstractLens
from focusjax.scene import Scene
from focusjax.shutter._motion import (
    Body,
    Cameras,
    MovingWorld,
    Track,
    body_poses,
    pixels_that_change,
    steps_in_pixels,
    track,
)

BACKDROP = ""
"""The name of all that does not move by itself."""
_NEAR = 0.1
"""Of the focal length: where peeling begins to look."""


@dataclasses.dataclass(frozen=True)
class Care:
    """How carefully motion is followed; see `render_moving`."""

    turn: float
    step_px: float
    most_spans: int


@dataclasses.dataclass(frozen=True)
class Plan:
    """A body, and how it is to be laid out.

    Attributes:
        body: what.
        faces: numbers of its faces [t].
        spans: a power of two.
        nearest: disparity in 1/m of its nearest point; 0 for what needs no other rays than the lens's own.
    """

    body: Body
    faces: Int[np.ndarray, " t"]
    spans: int
    nearest: float


@dataclasses.dataclass(frozen=True)
class Plans:
    """The plans of all bodies, the backdrop first.

    Attributes:
        bodies: one each.
        change: pixels [h, w] in which something moves.
        motion_px: the farthest way of anything, in pixels.
        step_px: how far what deforms goes from span to span.
    """

    bodies: tuple[Plan, ...]
    change: Bool[np.ndarray, "h w"]
    motion_px: float
    step_px: float

    @property
    def spans(self) -> int:
        """How many there are in all: each body's go into them a whole number of times."""
        return max(plan.spans for plan in self.bodies)


def plan_bodies(
    world: MovingWorld,
    scene: Scene,
    bodies: Sequence[Body],
    cameras: Cameras,
    lens: AbstractLens,
    times: Float[np.ndarray, " m"],
    care: Care,
) -> Plans:
    """Plans for `bodies`, which move, and for the rest of `scene`, which does if the camera does."""
    pans, still = cameras.move(times), cameras.still
    near = _NEAR * float(still.focal_length)
    change = np.full((still.height, still.width), pans)
    motion = left = 0.0
    rest = np.ones(len(scene.faces), dtype=bool)
    plans = []
    for body in bodies:
        faces = np.arange(body.faces.start, body.faces.stop)
        rest[faces] = False
        path = track(world, body, cameras, times)
        change |= pixels_that_change(path, still, lens, near)
        plain, weighed = steps_in_pixels(path, still, lens)
        motion = max(motion, plain)
        nearest = _nearest(path, near)
        if body.placed is None:
            spans = _power_of_two(weighed / care.step_px, care.most_spans)
            left = max(left, weighed / spans)
        else:
            spans = _spans(body, cameras, times, nearest, care)
        plans.append(Plan(body, faces, spans, nearest))
    backdrop = Body(BACKDROP, range(0), lambda _: np.eye(4))
    faces, nearest, spans = np.flatnonzero(rest), 0.0, 1
    if pans:
        part = part_of(scene, faces)
        views: list[Camera] = [cameras.at(float(time)) for time in times[[0, len(times) // 2, -1]]]
        nearest = max(float(disparity_map(part, view).max()) for view in views)
        spans = _spans(backdrop, cameras, times, nearest, care)
    return Plans((Plan(backdrop, faces, spans, nearest), *plans), change, motion, left)


def part_of(scene: Scene, faces: Int[np.ndarray, " t"]) -> Scene:
    """Some faces of a scene, without names; one of no area where they are none."""
    corners, materials = scene.faces[faces], scene.face_material[faces]
    if not len(faces):
        corners, materials = np.zeros_like(scene.faces[:1]), scene.face_material[:1]
    return dataclasses.replace(scene, faces=corners, face_material=materials, objects={})


def _nearest(path: Track, near: float) -> float:
    return min(float(path.disparity.max(initial=0.0)), 1.0 / near)


def _spans(body: Body, cameras: Cameras, times: Float[np.ndarray, " m"], nearest: float, care: Care) -> int:
    """Spans so short that a body sees the lens within `turn` of where it is in their middle.

    As if it always moved as it does at its fastest.
    """
    poses = body_poses(body, times)
    lenses = [cameras.world_from_rays(float(time)) for time in times]
    seen = [np.linalg.solve(pose, lens) for pose, lens in zip(poses, lenses, strict=True)]
    steps = [np.linalg.solve(one, other)[:3, 3] for one, other in itertools.pairwise(seen)]
    around = len(steps) * float(np.linalg.norm(steps, axis=1).max()) * nearest
    return _power_of_two(around / (2.0 * care.turn), care.most_spans)


def _power_of_two(least: float, most: int) -> int:
    """The least one that is not below `least`, at most that which is not above `most`."""
    wanted = 1 << max(0, int(np.ceil(np.log2(max(min(least, 1e9), 1.0)) - 1e-9)))
    return min(wanted, 1 << (most.bit_length() - 1))
