"""Shots through a real lens: its glass in every frame, and the settings that meet the wishes through it."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax.config import Config, build_real_lens
from focusjax.focus import (
    FramesSolution,
    Glass,
    ImagePoints,
    frames_seen_through,
    named_like,
    one_row,
    solve_frames,
)
from focusjax.geometry import Camera
from focusjax.job import FIT_PX, left_to_quality, opened_as_glass, options_through, through_glass
from focusjax.lens import AbstractLens, ThinLens, TiltShiftLens, refocused
from focusjax.shot._lens_track import LensTrack


@dataclasses.dataclass(frozen=True)
class ShotGlass:
    """The real lens of every frame of a shot.

    Attributes:
        track: the config of every frame.
    """

    track: LensTrack

    def as_made(
        self, frame: int, camera: Camera, lens: ThinLens | TiltShiftLens, *, wide_open: bool = False
    ) -> Glass:
        """The glass of a frame, counted from 1, with the settings of an ideal lens, or as wide as it opens.

        Frames with the same camera and settings have the same lens.

        Raises:
            ConfigError: as `build_real_lens`.
        """
        config = self.track.config_at(frame)
        numbers = jax.tree.leaves((camera.focal_length, camera.sensor_width, camera.principal_point, lens))
        key = (
            config.lens.model_dump_json(),
            (camera.width, camera.height, wide_open),
            tuple(np.asarray(number).tobytes() for number in numbers),
        )
        if key not in self._known:
            made = build_real_lens(config, camera, lens, wide_open=wide_open)
            assert made is not None
            self._known[key] = made
        return self._known[key]

    def to_render(
        self,
        frame: int,
        camera: Camera,
        lens: ThinLens | TiltShiftLens,
        depths: Float[np.ndarray, "2"],
        *,
        fit: bool,
    ) -> AbstractLens:
        """The lens that rays of a frame's picture are traced with.

        Polynomials are as exact as those of a still without a quality.

        Args:
            frame: from 1.
            camera: of the frame.
            lens: the ideal lens with the settings.
            depths: disparities in 1/m that are seen.
            fit: whether to look for polynomials.
        """
        config = self.track.config_at(frame)
        if left_to_quality(config):
            config = _with_fit(config)
        return through_glass(config, camera, lens, None, depths[None], fit=fit).traced

    @cached_property
    def _known(self) -> dict[Any, Glass]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Without the lenses that are known, for other processes."""
        return {"track": self.track}


def solve_through_glass(
    glass: ShotGlass,
    points: Sequence[ImagePoints],
    cameras: Sequence[Camera],
    lenses: Sequence[ThinLens | TiltShiftLens],
    *,
    held: Mapping[str, Sequence[bool]],
    throw: bool,
    smoothness: float,
    steadiness: float,
    **options: Any,
) -> FramesSolution:
    """The wishes of all frames met through glass.

    An ideal lens settles what frames the picture, and tilt and swing; focus and f-number are then found
    through the glass.

    Arguments are as for `solve_frames`; `lenses` are where to start.

    Raises:
        ConfigError: as `build_real_lens`.
        ValueError: as `solve_frames`.
        RuntimeError: the solver failed, and `throw` is true.
    """
    weights = {"smoothness": smoothness, "steadiness": steadiness}
    free = [name for name in options["free"] if name in ("focus", "f_number")]
    framed, turned = None, any(isinstance(lens, TiltShiftLens) for lens in lenses)
    if turned or len(free) < len(options["free"]):
        ideal = opened_as_glass(glass.track.config_at(1), options)
        framed = solve_frames(points, cameras, lenses, held=held, throw=throw, **weights, **ideal)
        cameras, lenses = zip(*(framed.at(t) for t in range(framed.count)), strict=True)
        points = [named_like(one_row(framed.points, t), points[t]) for t in range(framed.count)]
    wide_open = "f_number" in free
    made = [
        glass.as_made(t, camera, lens, wide_open=wide_open)
        for t, (camera, lens) in enumerate(zip(cameras, lenses, strict=True), start=1)
    ]
    if not free:
        assert framed is not None
        return frames_seen_through(framed, made)
    starts = [ThinLens(lens.focus_disparity, lens.aperture_radius, lens.aperture) for lens in lenses]
    solution = solve_frames(
        points,
        cameras,
        starts,
        through=made,
        held={name: column for name, column in held.items() if name in free},
        throw=throw,
        **weights,
        **options_through(options, free),
    )
    if not isinstance(lenses[0], TiltShiftLens):
        return solution
    # The glass is turned; what was solved for is its focus and opening.
    thin = [solution.at(t)[1] for t in range(solution.count)]
    found = [
        refocused(replace(lens, aperture_radius=each.aperture_radius), camera, each.focus_disparity)
        for lens, each, camera in zip(lenses, thin, cameras, strict=True)
    ]
    return replace(solution, lens=jax.tree.map(lambda *leaves: jnp.stack(leaves), *found))


def _with_fit(config: Config) -> Config:
    """The config with the polynomials of one that says nothing of quality."""
    return config.model_copy(update={"lens": config.lens.model_copy(update={"fit_px": FIT_PX})})
