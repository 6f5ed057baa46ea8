"""The arguments of a solve of all frames, checked and stacked."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._arguments import ArgumentError, require_kind
from focusjax._device import device_array
from focusjax._words import kind_of
from focusjax.focus._bounds import Limits
from focusjax.focus._checks import require_weight
from focusjax.focus._image_points import (
    ImagePoints,
    anonymous,
    filled_up,
    padded,
    repeated,
    room_for,
    stacked,
    together,
)
from focusjax.focus._priors import Numbers
from focusjax.focus._refuse import (
    checked_close_focus,
    checked_glass,
    refuse_glass,
    require_lens,
    require_points,
)
from focusjax.focus._solution import Plan
from focusjax.focus._solve import prepared
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, FittedLens, ThinLens, TiltShiftLens, as_tilt_shift

USAGE = "solve_frames(points, cameras, lenses)"


class FramesAsked(eqx.Module):
    """A shot, its values checked; arrays of frames have a leading axis t.

    Attributes:
        points: wishes, as many rows in every frame.
        camera: pinholes.
        lens: where to start.
        limits: bounds.
        numbers: priors by name.
        smoothness: weight of second differences.
        steadiness: weight of first differences.
        held: frames in which a free parameter stays where the start has it, in the order of `plan.free`.
        present: the frames of the shot; others, after them, only fill it up (see `padded_frames`).
        glass: the real lenses that make the pictures, as wide as they open; None for ideal lenses.
        names: of the wishes (static).
        plan: what else is static.
    """

    points: ImagePoints
    camera: Camera
    lens: ThinLens | TiltShiftLens
    limits: Limits
    numbers: Numbers
    smoothness: Float[Array, ""]
    steadiness: Float[Array, ""]
    held: Bool[Array, "t k"]
    present: Bool[Array, "t"]
    glass: AbstractLens | None
    names: tuple[str, ...] = eqx.field(static=True)
    plan: Plan = eqx.field(static=True)

    @property
    def own(self) -> Bool[Array, "t"]:
        """Frames in which some wish counts."""
        return jnp.sum(self.points.weight, axis=1) > 0

    def filled(self) -> ImagePoints:
        """The wishes, with those of the nearest frame that has any where none counts."""
        own = self.own
        frame = jnp.arange(own.size)
        before = jax.lax.cummax(jnp.where(own, frame, -own.size))
        after = jax.lax.cummin(jnp.where(own, frame, 2 * own.size), reverse=True)
        nearest = jnp.where(frame - before <= after - frame, before, after)
        return jax.tree.map(lambda leaf: leaf[jnp.clip(nearest, 0, own.size - 1)], self.points)


def frames_asked(
    points: Sequence[ImagePoints],
    cameras: Camera | Sequence[Camera],
    lenses: ThinLens | TiltShiftLens | Sequence[ThinLens | TiltShiftLens],
    *,
    through: Any,
    smoothness: ArrayLike,
    steadiness: ArrayLike,
    max_steps: int,
    held: Mapping[str, Sequence[bool]],
    options: dict[str, Any],
) -> FramesAsked:
    """The arguments of `solve_frames`, checked."""
    over_time = {"smoothness": smoothness, "steadiness": steadiness}
    over_time = {name: require_weight(name, value) for name, value in over_time.items()}
    _check_frames(points)
    count = len(points)
    if not isinstance(cameras, Sequence):
        require_kind(cameras, Camera, USAGE, "`look_at` and `make_camera` make one", "cameras")
        cameras = [cameras] * count
    if not isinstance(lenses, Sequence):
        lens_kinds = (ThinLens, TiltShiftLens)
        require_kind(lenses, lens_kinds, USAGE, "`thin_lens` and `tilt_shift_lens` make one", "lenses")
        lenses = [lenses] * count
    glasses = through if isinstance(through, Sequence) else [through] * count
    for what, given in (("cameras", cameras), ("lenses", lenses), ("lenses of through", glasses)):
        if len(given) != count:
            raise ArgumentError(
                f"there are {len(given)} {what} for {count} frames; give one each, or one for all",
                what.split()[-1],
            )
    for camera, lens in zip(cameras, lenses, strict=True):
        require_lens(camera, lens, USAGE)
    if len({(camera.width, camera.height) for camera in cameras}) > 1:
        raise ArgumentError(
            "the cameras have pictures of several sizes; give all frames the same size", "cameras"
        )
    if through is not None:
        _refuse_traced((points, cameras, lenses, glasses, smoothness, steadiness, options))
    if any(isinstance(lens, TiltShiftLens) for lens in lenses):
        lenses = [as_tilt_shift(lens) for lens in lenses]
    stand_ins = with_weight(points)
    checked: dict[tuple[int, int, int], Any] = {}
    frames = []
    for t in range(count):
        key = (id(cameras[t]), id(lenses[t]), id(glasses[t]))
        if key not in checked:
            checked[key] = prepared(
                points[stand_ins[t]], cameras[t], lenses[t], usage=USAGE, max_steps=max_steps, **options
            )
            if through is not None:
                checked_glass(glasses[t], checked[key], usage="solve_frames(through=)")
        frames.append(checked[key])
    plan = frames[0].plan
    _refuse_plan(plan, through)
    if plan.close_focus != "ignored":
        points = [
            checked_close_focus(each, camera, lens, plan.free, (), plan.close_focus)
            for each, camera, lens in zip(points, cameras, lenses, strict=True)
        ]
    rows = room_for(max(each.disparity.shape[0] for each in points))
    alike = stacked(points, rows)
    sided = not isinstance(alike.signed, Tracer) and bool(np.asarray(alike.signed).all())
    return FramesAsked(
        points=anonymous(alike),
        camera=jax.tree.map(together, *cameras),
        lens=jax.tree.map(together, *lenses),
        limits=jax.tree.map(together, *(each.limits for each in frames)),
        numbers=frames[0].numbers,
        **over_time,
        held=_held(held, plan.free, count),
        present=device_array(np.ones(count, dtype=bool)),
        glass=None if through is None else stacked_glass(glasses),
        names=points[0].names,
        plan=dataclasses.replace(plan, exact=False, many=not sided),
    )


def frames_with_padding(count: int) -> int:
    """How many frames a shot has when it is filled up, so that few lengths compile: 1, 4, 6, 8, 12, ..."""
    return 1 if count == 1 else room_for(count, least=4)


def padded_frames(asked: FramesAsked) -> FramesAsked:
    """The shot with its last frame repeated, up to `frames_with_padding`.

    In repeated frames no wish counts, nothing moves, and no smoothness ties them to the shot.
    """
    size = frames_with_padding(asked.present.size)
    by_frame = ("camera", "lens", "limits", "glass")
    longer = {
        name: jax.tree.map(lambda leaf: repeated(leaf, size), getattr(asked, name)) for name in by_frame
    }
    return dataclasses.replace(
        asked,
        **longer,
        points=padded(asked.points, size),
        held=filled_up(asked.held, size, True),
        present=filled_up(asked.present, size, False),
    )


def _refuse_plan(plan: Plan, through: Any) -> None:
    """Refuses ways to solve that frames do not have."""
    if plan.solver is not None:
        raise ArgumentError(
            f"solver is {kind_of(plan.solver)}; frames are solved together by one solver, so leave it out",
            "solver",
        )
    if through is not None:
        refuse_glass(plan.close_focus)


def _refuse_traced(arguments: Any) -> None:
    """Refuses values that are not known, of which a search through glass gives no derivatives."""
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)):
        raise ArgumentError(
            "values are traced, by `jax.grad` or `jax.jit`; frames are solved through glass with known values"
            " and without derivatives, which `solve(through=)` has of one picture",
            "through",
        )


def stacked_glass(glasses: Sequence[AbstractLens]) -> AbstractLens:
    """The glass of all frames as one with a leading axis; without polynomials, as rays are followed."""
    exact = [glass.exact if isinstance(glass, FittedLens) else glass for glass in glasses]
    shapes = [eqx.filter_eval_shape(lambda glass=glass: glass) for glass in exact]
    for frame, shape in enumerate(shapes):
        if not eqx.tree_equal(shape, shapes[0]):
            raise ArgumentError(
                f"the glass of frame {frame} is another lens than that of frame 0; give lenses made of one"
                " prescription in one way, with as many colours",
                "through",
            )
    return jax.tree.map(together, *exact)


def _held(held: Mapping[str, Sequence[bool]], free: tuple[str, ...], count: int) -> Bool[Array, "t k"]:
    unknown = [name for name in held if name not in free]
    if unknown:
        raise ArgumentError(
            f"held has {unknown[0]!r}, which is not free; free is {list(free)}, so leave it out", "held"
        )
    columns = []
    for name in free:
        column = np.asarray(held.get(name, (False,) * count), dtype=bool)
        if column.shape != (count,):
            raise ArgumentError(
                f"held has {column.size} values for {name!r} and there are {count} frames; give one each",
                "held",
            )
        if column.all():
            raise ArgumentError(f"{name!r} is free and held in all frames; leave it out of one", "held")
        columns.append(column)
    return device_array(np.stack(columns, axis=1))


def _check_frames(points: Sequence[ImagePoints]) -> None:
    """Refuses what is no row of frames of the same wishes."""
    if isinstance(points, ImagePoints):
        raise ArgumentError(
            f"points of {USAGE} is {kind_of(points)}; expected a list of them, one for each frame", "points"
        )
    if not points:
        raise ArgumentError("there are no frames; give the focus points of at least one", "points")
    for frame, each in enumerate(points):
        require_points(each, USAGE, axes=1)
        if each.names != points[0].names:
            raise ArgumentError(
                f"frame {frame} has the wishes {list(each.names)}, but frame 0 has {list(points[0].names)};"
                " give all frames the same, with weight 0 where they are not to count",
                "points",
            )


def with_weight(points: Sequence[ImagePoints]) -> list[int]:
    """For every frame the nearest one in which some wish counts; itself where that is not known yet."""
    if any(isinstance(each.weight, Tracer) for each in points):
        return list(range(len(points)))
    own = np.flatnonzero([np.asarray(each.weight).sum() > 0 for each in points])
    if not own.size:
        raise ArgumentError(
            "no wish counts in any frame; give at least one a weight in one of them", "points"
        )
    return [int(own[np.argmin(np.abs(own - frame))]) for frame in range(len(points))]
