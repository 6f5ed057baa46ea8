"""What a solve of all frames found: a lens for each, and how much they change from one to the next."""

import dataclasses
import itertools
from collections.abc import Sequence
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from focusjax._arguments import ArgumentError
from focusjax.focus._frames_asked import FramesAsked
from focusjax.focus._image_points import ImagePoints, together
from focusjax.focus._solution import AbstractPrinted, Result, WishResult, first_rows, one_row, wish_table
from focusjax.geometry import Camera
from focusjax.lens import (
    AbstractLens,
    CloseFocus,
    ThinLens,
    TiltShiftLens,
    as_tilt_shift,
    at_image_distance,
    lens_settings,
    pupil_radius,
    refocused,
    stopped,
)

_ROUNDING = 1e-5
"""Of any setting, in its unit, from frame to frame."""


@dataclasses.dataclass(frozen=True)
class LargestChange:
    """How unsteady one setting is over a shot.

    Attributes:
        per_frame: largest change from one frame to the next, in the setting's unit.
        per_frame2: largest second difference.
        pixels_per_frame: what the first is in the solve's own measure (see `solve_frames`); None for
            settings that were not solved for.
        pixels_per_frame2: the same for the second.
    """

    per_frame: float
    per_frame2: float
    pixels_per_frame: float | None
    pixels_per_frame2: float | None

    @property
    def seen(self) -> bool:
        """Whether the setting changes at all, which rounding does not count as."""
        return self.per_frame > _ROUNDING


class FramesSolution(AbstractPrinted):
    """The solved lenses of a shot. A pytree; every array has a leading axis t of frames.

    Attributes:
        lens: the solved lenses; `at` gives one frame's.
        camera: the cameras, with the solved focal lengths when these were free.
        points: what was asked, where the cameras see it; frames have as many rows each, of which some
            are without weight.
        blur: signed blur diameter in pixels at every point.
        error: difference from the wish in pixels at every point (see `errors`).
        pixels: every frame's free parameters in the solve's own measure.
        cost: half the sum of weight x error^2, of squared priors and of smoothness, in px^2.
        roughness: the share of `cost` that is smoothness.
        result: how the solve ended.
        steps: steps the solver took.
        at_lower: for every free parameter, whether the lower bound keeps it from a better value.
        at_upper: the same for upper bounds.
        open: for every free parameter, whether the wishes of all frames together leave it open.
        free: what was solved for, in the order of `PARAMETERS` (static).
        close_focus: what stays as the focus moves (static).
        asked: the problem.
        glass: the real lenses, as wide as they open, of which `blur` and `error` are; None for ideal lenses.
            `glass_at` gives one frame's with its settings.
    """

    lens: ThinLens | TiltShiftLens
    camera: Camera
    points: ImagePoints
    blur: Float[Array, "t n"]
    error: Float[Array, "t n"]
    pixels: Float[Array, "t k"]
    cost: Float[Array, ""]
    roughness: Float[Array, ""]
    result: Result
    steps: Int[Array, ""]
    at_lower: Bool[Array, "t k"]
    at_upper: Bool[Array, "t k"]
    open: Bool[Array, "k"]
    free: tuple[str, ...] = eqx.field(static=True)
    close_focus: CloseFocus = eqx.field(static=True, default="ignored")
    asked: FramesAsked | None = None
    glass: AbstractLens | None = None

    @property
    def count(self) -> int:
        """Number of frames."""
        return self.blur.shape[0]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that the wishes leave open in all frames, such as "f_number"."""
        return tuple(itertools.compress(self.free, np.asarray(self.open)))

    def at(self, frame: int) -> tuple[Camera, ThinLens | TiltShiftLens]:
        """Camera and lens of one frame, counted from 0."""
        return one_row((self.camera, self.lens), frame)

    def glass_at(self, frame: int) -> AbstractLens:
        """The real lens that makes the picture of one frame, counted from 0, with the settings found.

        Raises:
            ArgumentError: the frames were not solved through glass.
        """
        if self.glass is None:
            raise ArgumentError(
                "the frames were solved for ideal lenses, which `at` gives; give `through` for glass",
                "solution",
            )
        camera, lens = self.at(frame)
        glass = one_row(self.glass, frame)
        return refocused(
            stopped(glass, lens.aperture_radius / pupil_radius(glass)), camera, lens.focus_disparity
        )

    def table(self, frame: int) -> tuple[WishResult, ...]:
        """One line per wish for one frame, counted from 0."""
        return wish_table(self.points, self.blur, self.error, frame)

    def settings(self) -> dict[str, Float[np.ndarray, "t"]]:
        """Each setting of every frame in a photographer's units, by a name that ends in its unit.

        The focus is given in dioptres (1/m), which, unlike metres, are finite and change evenly with blur.
        With a model of close focus there is an image distance beside the focal length.
        """
        lens, camera = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), (self.lens, self.camera))
        length = camera.focal_length
        with np.errstate(divide="ignore"):
            number = length / (2.0 * lens.aperture_radius)
        found = {"f_number": number, "focal_length_mm": 1000.0 * length}
        if self.close_focus != "ignored":
            of_frame = partial(lens_settings, close_focus=self.close_focus)
            near = jax.tree.map(np.asarray, jax.vmap(of_frame)(self.camera, self.lens))
            found = {"f_number": near.f_number, "focal_length_mm": 1000.0 * near.focal_length}
            found["image_distance_mm"] = 1000.0 * near.image_distance
        if not isinstance(self.lens, TiltShiftLens):
            return {"focus_per_m": lens.focus_disparity} | found
        right, up = (lens.plane[:, :2] * length[:, None]).T
        ahead = np.sqrt(np.maximum(1.0 - right**2 - up**2, 0.0))
        turned = {"tilt_deg": np.degrees(-np.arcsin(up)), "swing_deg": np.degrees(np.arctan2(right, ahead))}
        return {"focus_per_m": lens.plane[:, 2]} | found | turned

    def largest_changes(self) -> dict[str, LargestChange]:
        """How unsteady each setting is; the same names as in `settings`."""
        names = {
            "focus_per_m": "focus",
            "f_number": "f_number",
            "focal_length_mm": "focal_length",
            "tilt_deg": "tilt",
            "swing_deg": "swing",
            "image_distance_mm": "image_distance",
        }
        pixels = np.asarray(self.pixels, dtype=float)
        found = {}
        for name, values in self.settings().items():
            own = pixels[:, self.free.index(names[name])] if names[name] in self.free else None
            found[name] = largest_changes(values, own)
        return found


def without_padding(solution: FramesSolution, count: int) -> FramesSolution:
    """The solution of the first `count` frames, which are those of the shot."""
    by_frame = ("lens", "camera", "points", "blur", "error", "pixels", "at_lower", "at_upper")
    return dataclasses.replace(
        solution, **{name: first_rows(getattr(solution, name), count) for name in by_frame}
    )


def unsolved(
    cameras: Sequence[Camera],
    lenses: Sequence[ThinLens | TiltShiftLens],
    close_focus: CloseFocus = "ignored",
) -> FramesSolution:
    """The lenses of a shot of which nothing is wished, in the form of a solution without wishes.

    Args:
        cameras: one a frame, of the stated length.
        lenses: one a frame.
        close_focus: what stays as the focus moves.
    """
    cameras = [
        at_image_distance(camera, lens.focus_disparity, close_focus) if isinstance(lens, ThinLens) else camera
        for camera, lens in zip(cameras, lenses, strict=True)
    ]
    if any(isinstance(lens, TiltShiftLens) for lens in lenses):
        lenses = [as_tilt_shift(lens) for lens in lenses]
    points = no_points(len(cameras))
    none = points.weight
    return FramesSolution(
        lens=jax.tree.map(together, *lenses),
        camera=jax.tree.map(together, *cameras),
        points=points,
        blur=none,
        error=none,
        pixels=none,
        cost=jnp.zeros(()),
        roughness=jnp.zeros(()),
        result=Result.solved,
        steps=jnp.zeros((), dtype=int),
        at_lower=none > 0,
        at_upper=none > 0,
        open=jnp.zeros(0, dtype=bool),
        free=(),
        close_focus=close_focus,
    )


def no_points(count: int) -> ImagePoints:
    """The wishes of `count` frames of which nothing is wished."""
    none = jnp.zeros((count, 0))
    return ImagePoints(
        xy=jnp.zeros((count, 0, 2)),
        disparity=none,
        target=none,
        signed=none > 0,
        weight=none,
        tolerance=none,
        wish=jnp.zeros((count, 0), dtype=int),
        names=(),
    )


def largest_changes(values: Float[np.ndarray, "t"], pixels: Float[np.ndarray, "t"] | None) -> LargestChange:
    """The largest differences of a setting, and of what it is in pixels where it was solved for.

    0 where there are too few frames for one.
    """

    def largest(values: Float[np.ndarray, "t"], order: int) -> float:
        # Settings that stay infinite, as the f-number of a pinhole does, do not change.
        with np.errstate(invalid="ignore"):
            steps = np.abs(np.diff(values, n=order))
        return float(np.nan_to_num(steps, nan=0.0).max(initial=0.0))

    of_pixels = (None, None) if pixels is None else (largest(pixels, 1), largest(pixels, 2))
    return LargestChange(largest(values, 1), largest(values, 2), *of_pixels)
