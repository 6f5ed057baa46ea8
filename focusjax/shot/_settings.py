"""How carefully the frames of a shot are rendered."""

import dataclasses
from typing import Literal

from focusjax.job import Development, MotionSettings


@dataclasses.dataclass(frozen=True)
class FrameSettings:
    """How carefully frames are rendered; names and meanings as in `peel`, `render` and `save_png`.

    Attributes:
        method: "trace", or "post" to blur a sharp view of each frame (`focusjax.post`).
        rays: lens rays per pixel on the average; places to look at by post-processing.
        smooth: whether the noise of what is blurred by defocus is taken out.
        quality: decibels or a name instead of `rays`: planned once, for the most blurred frame.
        supersampling: layer samples along a pixel's side.
        max_layers: most layers to peel.
        slabs: how many slabs of depth to cut instead of peeling.
        slab_blur_px: by how much blur may change within a slab, instead of their number.
        pixel_filter: "box", "tent" or "gaussian".
        view_dependent: whether every lens ray sees highlights for itself.
        seed: chooses the rays, the same ones in every frame, so that noise does not flicker.
        own_rays: whether every frame has rays of its own instead, so that noise evens out over them.
        exposure: stops, for PNG files.
        bits: 8 or 16, of PNG files.
        fit_px: how far polynomials may be from a real lens's rays; see `lens.fit_px` of a config.
        development: how PNG files are exposed and developed, instead of by `exposure`.
        motion: what moves while the shutter is open; None for frames of one instant.
    """

    method: Literal["trace", "post"] = "trace"
    rays: int = 64
    smooth: bool = True
    quality: str | float | None = None
    supersampling: int = 1
    max_layers: int = 8
    slabs: int | None = None
    slab_blur_px: float | None = None
    pixel_filter: str = "box"
    view_dependent: bool = False
    seed: int = 0
    own_rays: bool = False
    exposure: float = 0.0
    bits: int = 8
    fit_px: float | None = None
    development: Development | None = None
    motion: MotionSettings | None = None

    def seed_of(self, frame: int) -> int:
        """What chooses the rays of a frame."""
        return (self.seed + frame) % 2**31 if self.own_rays else self.seed
