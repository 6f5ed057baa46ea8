"""The focal surfaces of a whole shot, solved for all frames at once."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._arguments import ArgumentError
from focusjax._device import device_array
from focusjax._programs import jit, jit_in_haste
from focusjax.focus._checks import require_weight
from focusjax.focus._frames_asked import frames_with_padding, with_weight
from focusjax.focus._frames_solution import LargestChange, largest_changes, no_points
from focusjax.focus._image_points import (
    ImagePoints,
    anonymous,
    errors_of,
    filled_up,
    padded,
    repeated,
    root_weight,
    stacked,
    together,
)
from focusjax.focus._refuse import checked_points, opened
from focusjax.focus._solution import Result, WishResult, first_rows, one_row, wish_table
from focusjax.focus._solve_surface import (
    LinearSurface,
    linear_surface,
    settled_sides,
    starting_sides,
    surface_blurs,
    without_relations,
)
from focusjax.geometry import Camera
from focusjax.lens import FocalSurface, FocalSurfaceLens, ThinLens, focal_surface_lens

_DAMPING = 1e-8
"""Weight of a change of 1 px of any control value: what nothing else determines stays as given."""


class SurfaceFramesAsked(eqx.Module):
    """A shot with a focal surface, its values checked; arrays of frames have a leading axis t.

    Attributes:
        points: wishes, as many rows in every frame.
        camera: pinholes.
        surface: control points, and values to start from.
        lens: aperture radius and shape.
        roughness: weight of the change of blur over the picture.
        smoothness: weight of second differences over time.
        steadiness: weight of first differences over time.
        present: the frames of the shot; those that fill it up come after them.
        names: of the wishes (static).
    """

    points: ImagePoints
    camera: Camera
    surface: FocalSurface
    lens: ThinLens
    roughness: Float[Array, ""]
    smoothness: Float[Array, ""]
    steadiness: Float[Array, ""]
    present: Bool[Array, "t"]
    names: tuple[str, ...] = eqx.field(static=True)


class SurfaceFramesSolution(eqx.Module):
    """The solved focal surfaces of a shot. A pytree; every array has a leading axis t of frames.

    Attributes:
        surface: control points with their solved focal disparities.
        camera: the cameras.
        thin: aperture radius and shape of every frame.
        points: what was asked, where the cameras see it; without names when nothing was wished.
        blur: signed blur diameter in pixels at every point.
        error: difference from the wish in pixels at every point.
        cost: half the sum of weight x error^2 and of all roughness, in px^2.
        roughness: the share of `cost` that is change over time.
        result: how the solve ended.
        asked: the problem; None when nothing was wished.
    """

    surface: FocalSurface
    camera: Camera
    thin: ThinLens
    points: ImagePoints
    blur: Float[Array, "t n"]
    error: Float[Array, "t n"]
    cost: Float[Array, ""]
    roughness: Float[Array, ""]
    result: Result
    asked: SurfaceFramesAsked | None = None

    @property
    def count(self) -> int:
        """Number of frames."""
        return self.surface.xy.shape[0]

    def at(self, frame: int) -> tuple[Camera, FocalSurfaceLens]:
        """Camera and lens of one frame, counted from 0."""
        surface, camera, thin = one_row((self.surface, self.camera, self.thin), frame)
        return camera, focal_surface_lens(surface, camera, thin)

    def table(self, frame: int) -> tuple[WishResult, ...]:
        """One line per wish for one frame, counted from 0."""
        return wish_table(self.points, self.blur, self.error, frame)

    def settings(self) -> dict[str, Float[np.ndarray, "t"]]:
        """Each setting of every frame, as the middle of the picture has it; see `FramesSolution.settings`."""
        focus, scale = _in_the_middle(self.surface, self.camera)
        length = np.asarray(self.camera.focal_length, dtype=float)
        with np.errstate(divide="ignore"):
            number = length / (2.0 * np.asarray(self.thin.aperture_radius * scale, dtype=float))
        return {
            "focus_per_m": np.asarray(focus, dtype=float),
            "f_number": number,
            "focal_length_mm": 1000.0 * length,
        }

    def largest_changes(self) -> dict[str, LargestChange]:
        """How unsteady each setting is; the same names as in `settings`."""
        return {name: largest_changes(values, None) for name, values in self.settings().items()}


def solve_surface_frames(
    points: Sequence[ImagePoints],
    cameras: Sequence[Camera],
    surfaces: Sequence[FocalSurface],
    lenses: Sequence[ThinLens],
    *,
    roughness: ArrayLike = 1e-3,
    smoothness: ArrayLike = 100.0,
    steadiness: ArrayLike = 1.0,
) -> SurfaceFramesSolution:
    """The focal disparities of control points that meet the wishes of all frames of a shot best.

    With x_t the control values of frame t in pixels of blur, 2 f E times their disparities, minimised is

        sum_t  what `solve_focal_surface` minimises of frame t, with `roughness` for its smoothness,
             + smoothness |x_t - 2 x_(t-1) + x_(t-2)|^2 + steadiness |x_t - x_(t-1)|^2.

    The last line is that of `solve_frames`: wishes pull the surface over from one place to another in time,
    and points that appear and disappear do so without a jump. Control points keep their order; one that is
    not there in a frame has weight 0 in its surface, and its value is filled in. Unsigned wishes take sides
    by turns with the solve of all frames, from the same four starts as for one picture. The solution is
    differentiable as that of `solve_focal_surface`, with sides held.

    A shot is filled up with frames that take no part, as that of `solve_frames`, so that few lengths compile.

    Args:
        points: every frame's located wishes, the same in every frame; weight 0 where they do not count.
        cameras: of every frame.
        surfaces: of every frame, with as many control points each.
        lenses: aperture radius and shape of every frame.
        roughness: weight of the change of blur over the picture.
        smoothness: weight of second differences over time.
        steadiness: weight of first differences over time.

    Raises:
        ArgumentError: a weight out of range, frames that do not fit together, no point with weight, or a wish
            for a limit or for another point's blur.
    """
    weights = {"roughness": roughness, "smoothness": smoothness, "steadiness": steadiness}
    weights = {name: require_weight(name, value) for name, value in weights.items()}
    counts = {len(points), len(cameras), len(surfaces), len(lenses)}
    if len(counts) > 1 or not points:
        raise ArgumentError(
            f"there are {len(points)} points, {len(cameras)} cameras, {len(surfaces)} surfaces and"
            f" {len(lenses)} lenses; give one each per frame, of at least one frame",
            "points",
        )
    if len({surface.weight.size for surface in surfaces}) > 1:
        raise ArgumentError(
            "surfaces have several numbers of control points; give all the same ones, with weight 0 where"
            " they are not there",
            "surfaces",
        )
    # Frames in which no wish counts have nothing to check.
    rows = [
        without_relations(checked_points(each) if own == frame else each)
        for frame, (each, own) in enumerate(zip(points, with_weight(points), strict=True))
    ]
    asked = SurfaceFramesAsked(
        points=stacked([anonymous(each) for each in rows]),
        camera=jax.tree.map(together, *cameras),
        surface=jax.tree.map(together, *surfaces),
        lens=jax.tree.map(together, *(opened(lens) for lens in lenses)),
        **weights,
        present=device_array(np.ones(len(points), dtype=bool)),
        names=points[0].names,
    )
    return solve_surface_frames_asked(asked)


def solve_surface_frames_asked(asked: SurfaceFramesAsked) -> SurfaceFramesSolution:
    """The solution of a checked problem."""
    solution = _solve(_padded(dataclasses.replace(asked, names=())))
    by_frame = ("surface", "camera", "thin", "points", "blur", "error")
    own = {name: first_rows(getattr(solution, name), asked.present.size) for name in by_frame}
    solution = dataclasses.replace(solution, **own, asked=asked)
    return dataclasses.replace(solution, points=dataclasses.replace(solution.points, names=asked.names))


def _padded(asked: SurfaceFramesAsked) -> SurfaceFramesAsked:
    """The shot with its last frame repeated, in which nothing is wished and nothing moves."""
    size = frames_with_padding(asked.present.size)
    longer = {
        name: jax.tree.map(lambda leaf: repeated(leaf, size), getattr(asked, name))
        for name in ("camera", "surface", "lens")
    }
    return dataclasses.replace(
        asked, **longer, points=padded(asked.points, size), present=filled_up(asked.present, size, False)
    )


def unsolved_surfaces(
    cameras: Sequence[Camera], surfaces: Sequence[FocalSurface], lenses: Sequence[ThinLens]
) -> SurfaceFramesSolution:
    """The focal surfaces of a shot of which nothing is wished, in the form of a solution without wishes.

    Args:
        cameras: one a frame.
        surfaces: one a frame.
        lenses: one a frame.
    """
    nothing, none = jnp.zeros(()), no_points(len(cameras))
    return SurfaceFramesSolution(
        surface=jax.tree.map(together, *surfaces),
        camera=jax.tree.map(together, *cameras),
        thin=jax.tree.map(together, *lenses),
        points=none,
        blur=none.weight,
        error=none.weight,
        cost=nothing,
        roughness=nothing,
        result=Result.solved,
    )


class _Rows(eqx.Module):
    """Everything that is squared and summed, as functions of the change of all control values in px.

    Attributes:
        frames: residuals of each frame.
        start: control values in px [t, k].
        bend: roots of the weights of second differences [t].
        pace: roots of the weights of first differences [t].
    """

    frames: LinearSurface
    start: Float[Array, "t k"]
    bend: Float[Array, "t"]
    pace: Float[Array, "t"]

    @property
    def jacobian(self) -> Any:
        """Of all residuals, a `BandedJacobian`."""
        from focusjax.solvers import BandedJacobian

        wide = jnp.ones_like(self.start)
        return BandedJacobian(self.frames.matrix, self.bend[:, None] * wide, self.pace[:, None] * wide)

    def over_time(self, change: Float[Array, "t k"]) -> Float[Array, ""]:
        """Sum of the squares of all weighed differences over time after a change."""
        _, second, first = self.jacobian.mv(self.start + change)
        return jnp.sum(second**2) + jnp.sum(first**2)

    def change(self, side: Float[Array, "t n"]) -> Float[Array, "t k"]:
        """The best change, when unsigned wishes have chosen their sides."""
        from focusjax.solvers import DampedOperator, solve_banded

        _, bent, paced = self.jacobian.mv(self.start)
        right = jax.vmap(LinearSurface.right)(self.frames, side)
        wide = jnp.ones_like(self.start)
        damped = DampedOperator(self.jacobian, wide, jnp.sqrt(_DAMPING) * wide)
        return solve_banded(damped, ((right, -bent, -paced), jnp.zeros_like(wide)))

    def miss(self, change: Float[Array, "t k"], side: Float[Array, "t n"]) -> Float[Array, "t r"]:
        """Residuals of the frames themselves."""
        right = jax.vmap(LinearSurface.right)(self.frames, side)
        return self.jacobian.mv(change)[0] - right


@jit_in_haste
def _solve(asked: SurfaceFramesAsked) -> SurfaceFramesSolution:
    """The compiled part."""
    slope = 2.0 * jax.vmap(lambda lens, camera: lens.parallax(camera))(asked.lens, asked.camera)
    frames = jax.vmap(linear_surface)(
        asked.points, asked.camera, asked.surface, slope, jnp.where(asked.present, asked.roughness, 0.0)
    )
    number = jnp.where(asked.present, jnp.arange(slope.size), -1)

    rows = _Rows(
        frames,
        slope[:, None] * asked.surface.focus_disparity,
        jnp.where(number >= 2, root_weight(asked.smoothness), 0.0),
        jnp.where(number >= 1, root_weight(asked.steadiness), 0.0),
    )
    side = jax.lax.stop_gradient(_sides(jax.lax.stop_gradient(rows), asked.points))
    change = rows.change(side)
    solved = eqx.tree_at(
        lambda s: s.focus_disparity, asked.surface, asked.surface.focus_disparity + change / slope[:, None]
    )

    def seen(
        surface: FocalSurface, camera: Camera, thin: ThinLens, points: ImagePoints
    ) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
        blur = surface_blurs(points, camera, surface, thin)
        return blur, errors_of(points, blur, None)

    blur, error = jax.vmap(seen)(solved, asked.camera, asked.lens, asked.points)
    miss = rows.miss(change, side)
    over_time = rows.over_time(change)
    finite = jnp.all(jnp.isfinite(error)) & jnp.all(jnp.isfinite(change))
    return SurfaceFramesSolution(
        surface=solved,
        camera=asked.camera,
        thin=asked.lens,
        points=asked.points,
        blur=blur,
        error=error,
        cost=0.5 * (jnp.sum(miss**2) + over_time),
        roughness=0.5 * over_time,
        result=Result.where(finite, Result.solved, Result.not_finite),
    )


def _sides(rows: _Rows, points: ImagePoints) -> Float[Array, "t n"]:
    """Factors 1 or -1 that make the wished blurs signed ones, chosen for all frames together."""
    starts = jax.vmap(starting_sides, out_axes=1)(rows.frames, points)

    def blur(side: Float[Array, "t n"]) -> Float[Array, "t n"]:
        return (rows.jacobian.mv(rows.change(side))[0] + rows.frames.behind)[:, : side.shape[1]]

    def settle(start: Float[Array, "t n"]) -> tuple[Float[Array, "t n"], Float[Array, ""]]:
        side = settled_sides(start, points.signed, blur)
        change = rows.change(side)
        return side, jnp.sum(rows.miss(change, side) ** 2) + rows.over_time(change)

    sides, costs = jax.lax.map(settle, starts)
    return sides[jnp.argmin(costs)]


@jit
def _in_the_middle(surface: FocalSurface, camera: Camera) -> tuple[Float[Array, "t"], Float[Array, "t"]]:
    return jax.vmap(lambda surface, camera: surface.at(camera.principal_point))(surface, camera)
