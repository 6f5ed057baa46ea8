"""Pictures of an answer: a draft at once, then a refined one, of layers that are peeled but seldom."""

import dataclasses
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8

from focusjax import job
from focusjax._freed import return_programs
from focusjax.config import Config, build_camera, build_look
from focusjax.film import to_bytes
from focusjax.geometry import Camera
from focusjax.layers import Extent, Layers
from focusjax.lens import AbstractLens, FocalSurfaceLens, ThinLens, TiltShiftLens, as_tilt_shift
from focusjax.post import PinholeView, closed_lens, post_process, view_in_layers
from focusjax.studio._answer import Answer
from focusjax.studio._reach import lens_to_peel_for
from focusjax.studio._stage import Stage
from focusjax.trace import check_reach, render

Bytes = UInt8[np.ndarray, "h w 3"]

DRAFT_WIDTH = 480
"""Pixels; of wider pictures the draft is made smaller, of the same frame."""
_DRAFT_TAPS = 16
_DRAFT_LEVELS = 4
_MOST_VIEWS = 150
"""Sharp views that are kept, of the frames of a shot: about 3 MB each."""
_PASS_RAYS = 16
"""Rays per pixel of one pass of the refined picture: a change waits for one pass at most."""


class Cancelled(Exception):  # noqa: N818
    """A newer request makes the picture pointless."""


@dataclasses.dataclass(frozen=True, eq=False)
class Painted:
    """A picture as it is shown.

    Attributes:
        pixels: sRGB [h, w, 3]; a draft may be smaller than the config's picture, of the same frame.
        share: of its rays that are traced, 0 to 1; 0 for a draft.
    """

    pixels: Bytes
    share: float


class Painter:
    """Makes pictures, one after another, in one thread.

    Attributes:
        peels: how often layers for the refined picture were peeled.
        taken: the latest picture as the config's exposure and film have it; None without either.
    """

    def __init__(self) -> None:
        self.peels = 0
        self.taken: job.Photograph | None = None
        self._stage: Stage | None = None
        self._views: OrderedDict[Hashable, PinholeView] = OrderedDict()
        self._view_extents: dict[Hashable, Extent] = {}
        self._layers: Layers | None = None
        self._peeled: Hashable = None
        self._extent: Extent | None = None
        self._grey: float | None = None

    def sharp(self, answer: Answer) -> Bytes:
        """The view without any blur, exposed as the picture is."""
        self._look_at(answer)
        camera = answer.stage.camera
        view = self._view(answer.config, camera)
        return self._shown(answer, camera, view.image)

    def draft(self, answer: Answer) -> Painted:
        """Blurred from one sharp view: no foreground lets through what is behind it.

        Without a lens, the sharp view itself.
        """
        self._look_at(answer)
        full = answer.stage.camera
        camera = _draft_camera(answer)
        view = self._view(answer.config, camera)
        if answer.outcome is None:
            return Painted(self._shown(answer, camera, view.image), 0.0)
        lens = _draft_lens(answer, full, camera)
        image = post_process(view, camera, lens, taps=_DRAFT_TAPS, levels=_DRAFT_LEVELS)
        return Painted(self._shown(answer, camera, image), 0.0)

    def refined(self, answer: Answer, cancelled: Callable[[], bool]) -> Iterator[Painted]:
        """The picture as the config's `[render]` has it, better from pass to pass.

        Rays are traced in passes with seeds of their own, whose mean converges to what `focusjax run` makes.

        Raises:
            Cancelled: `cancelled` said so between two passes.
            ValueError: layers that do not fit.
        """
        self._look_at(answer)
        outcome, config, camera = answer.outcome, answer.config, answer.stage.camera
        assert outcome is not None
        table = config.render
        look = outcome.glass.traced if outcome.glass is not None else build_look(config, camera, outcome.lens)
        if table.method == "post":
            image = post_process(self._view(config, camera), camera, look, taps=table.rays)
            yield Painted(self._shown(answer, camera, image), 1.0)
            return
        layers = self._layers_for(answer, look)
        total, traced = jnp.zeros((camera.height, camera.width, 3)), 0
        while traced < table.rays:
            if cancelled():
                raise Cancelled
            rays = min(_PASS_RAYS, table.rays - traced)
            seed = table.seed + traced // _PASS_RAYS
            total = total + rays * render(layers, look, rays=rays, smooth=table.smooth, seed=seed)
            traced += rays
            yield Painted(self._shown(answer, camera, total / traced), traced / table.rays)

    def layer_counts(self) -> Int[np.ndarray, "h w"] | None:
        """How many surfaces lens rays may meet at each pixel, of the layers at hand; None without any."""
        layers = self._layers
        if layers is None:
            return None
        grid, camera = layers.grid, layers.camera
        step, margin = grid.supersampling, grid.margin
        counts = np.asarray(layers.cells > 0).sum(axis=0)
        inside = counts[margin : margin + step * camera.height, margin : margin + step * camera.width]
        return inside[::step, ::step]

    def _look_at(self, answer: Answer) -> None:
        """Forget what is of another stage."""
        if answer.stage is not self._stage:
            same_frame = self._stage is not None and _frame(self._stage.camera) == _frame(answer.stage.camera)
            if answer.frame == 0:
                self._views.clear()
            self._layers, self._peeled, self._grey = None, None, None
            self._extent = self._extent if same_frame else None
            self._stage = answer.stage

    def _view(self, config: Config, camera: Camera) -> PinholeView:
        """The sharp view of a camera."""
        assert self._stage is not None
        table = config.render.model_copy(update={"view_dependent": False})
        size = _frame(camera), _layer_settings(config)
        key = self._stage, *size
        if key not in self._views:
            like = self._view_extents.get(size)
            layers = job.make_layers(table, self._stage.scene, camera, closed_lens(), like, spare=True)
            self._view_extents[size] = layers.extent.for_others()
            self._views[key] = view_in_layers(layers, self._stage.scene)
            if len(self._views) > _MOST_VIEWS:
                self._views.popitem(last=False)
        self._views.move_to_end(key)
        return self._views[key]

    def _layers_for(self, answer: Answer, look: AbstractLens) -> Layers:
        """Layers that serve `look`: those at hand where they do."""
        config, stage = answer.config, answer.stage
        table, key = config.render, _layer_settings(answer.config)
        if self._layers is not None and self._peeled == key and _serve(self._layers, look):
            return self._layers
        outcome = answer.outcome
        assert outcome is not None
        like = self._extent
        if like is not None and not like.serves(stage.camera, table.supersampling):
            like = None
        wide = None
        cut = table.slabs is not None or table.slab_blur_px is not None
        if outcome.glass is None and not cut:
            wide = lens_to_peel_for(config, stage, outcome.lens)
        layers = self._peel(config, stage, look if wide is None else wide, like)
        if wide is not None and not _serve(layers, look):
            layers = self._peel(config, stage, look, like)
        self._layers, self._peeled = layers, key
        self._extent = layers.extent.for_others()
        return layers

    def _peel(self, config: Config, stage: Stage, lens: AbstractLens, like: Extent | None) -> Layers:
        self.peels += 1
        return_programs()
        return job.make_layers(config.render, stage.scene, stage.camera, lens, like, spare=True)

    def _shown(self, answer: Answer, camera: Camera, image: Float[Array, "h w 3"]) -> Bytes:
        """As a screen shows it: every picture of a session is metered in the same sharp view."""
        config, outcome = answer.config, answer.outcome
        if outcome is None or (config.exposure is None and config.film is None):
            return to_bytes(image, exposure=config.render.exposure)
        if config.exposure is not None and config.exposure.free and self._grey is None:
            self._grey = job.metered_before(config, answer.stage.scene, answer.stage.camera)
        compromise = None if outcome.exposed is None else outcome.exposed.sentence()
        taken = job.take_photograph(
            config, camera, outcome.middle_lens, image, image[:1, :1], grey=self._grey, weighed=compromise
        )
        assert taken is not None
        self.taken = taken
        return to_bytes(taken.image)


def _draft_camera(answer: Answer) -> Camera:
    """The picture's camera, with fewer pixels where nothing about the lens is measured in them."""
    config, outcome = answer.config, answer.outcome
    width, height = config.camera.resolution
    plain = outcome is None or (
        isinstance(outcome.lens, ThinLens | TiltShiftLens | FocalSurfaceLens)
        and outcome.glass is None
        and not config.lens.look
    )
    camera = answer.stage.camera
    if width <= DRAFT_WIDTH or not plain:
        return camera
    size = (DRAFT_WIDTH, max(1, round(height * DRAFT_WIDTH / width)))
    table = config.camera.model_copy(update={"resolution": size})
    smaller = build_camera(config.model_copy(update={"camera": table}))
    # Where framing was solved for, its focal length, shift and rise.
    return dataclasses.replace(
        smaller,
        focal_length=camera.focal_length,
        sensor_width=camera.sensor_width,
        principal_point=camera.principal_point * jnp.asarray([size[0] / width, size[1] / height]),
    )


def _draft_lens(answer: Answer, full: Camera, camera: Camera) -> AbstractLens:
    """The lens that blurs the draft of `camera`: of one kind, tilted or not, so that one program does."""
    outcome = answer.outcome
    assert outcome is not None
    if outcome.glass is not None:
        return outcome.glass.traced
    lens = outcome.lens
    if answer.config.lens.look:
        return build_look(answer.config, full, lens)
    return lens.sampled_for(full, camera) if isinstance(lens, FocalSurfaceLens) else as_tilt_shift(lens)


def _frame(camera: Camera) -> tuple[int, int]:
    return camera.width, camera.height


def _layer_settings(config: Config) -> Hashable:
    table = config.render
    return (
        table.supersampling, table.max_layers, table.slabs, table.slab_blur_px, table.view_dependent,
        table.pixel_filter,
    )  # fmt: skip


def _serve(layers: Layers, lens: AbstractLens) -> bool:
    """Whether the layers hold all rays of the lens."""
    try:
        check_reach(layers, lens, layers.pixel_filter)
    except ValueError:
        return False
    return True
