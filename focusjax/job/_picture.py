"""The picture of a run, and the layers it is made of."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._stopwatch import Stopwatch
from focusjax.config import RenderTable
from focusjax.geometry import Camera
from focusjax.job._layers import make_layers
from focusjax.job._moving import Moving, blurred_view, render_open
from focusjax.job._way import Way, choose_way
from focusjax.layers import (
    Extent,
    Layers,
    MissedLight,
    UmbraSaving,
    missed_light,
    peel,
    umbra_saving,
)
from focusjax.lens import AbstractLens, PrescriptionLens, SpectralLens, TiltedPrescriptionLens
from focusjax.post import PinholeView, closed_lens, post_process, view_in_layers
from focusjax.scene import Scene
from focusjax.trace import (
    LensPlan,
    estimate_quality,
    nearest_in_layers,
    plan_lens,
    plan_rays,
    render,
    render_pinhole,
)

Progress = Callable[[str, float | None], None]
"""Called with the stage that runs and, where that is known, the share of it that is done."""

_EVERY_LAYER = 4096
_OTHER_RAYS = 10
"""Added to the seed for the pixels and rays that estimate an error, to be other than those of a plan."""


@dataclass(frozen=True)
class Examined:
    """What layers miss and what the umbra spares them, against plain peeling to the end.

    Attributes:
        missed: share of the lens rays whose nearest surface they do not hold. Of what lies behind something
            that may be seen through it says nothing.
        see_through: whether there is such a thing.
        saving: layers and samples with the umbra and without.
    """

    missed: MissedLight
    saving: UmbraSaving
    see_through: bool


@dataclass(frozen=True)
class Picture:
    """What rendering made, all of it linear.

    Attributes:
        image: radiance [h, w, 3] through the lens.
        pinhole: radiance [h, w, 3] with everything sharp.
        layer_count: layers that the lens sees and that hold anything.
        samples_kept: samples of surface in them.
        samples_left_out: samples of surface for which there were too few layers.
        layer_bytes: memory of the layers with their N-buffers.
        margin: pixels that the layers reach beyond the frame.
        complete: whether no surface was left out for want of layers.
        examined: what they miss and spare, when that was asked for.
        rays: rays per pixel on the average; places looked at by post-processing.
        method: "trace" or "post".
        extent: how large layers may be for compiled programs to serve again: the `like` of another run.
        way: how that was chosen, and what was expected, when a quality was asked for.
        decibels: PSNR of the picture then, estimated from a sample of the pixels.
        lens_plan: polynomials or the glass of a real lens, when the quality was to decide.
        motion_px: farthest way in pixels of anything that moves by itself, apart from the camera, while the
            shutter is open; None without one.
        spans: parts of the shutter's time.
    """

    image: Float[Array, "h w 3"]
    pinhole: Float[Array, "h w 3"]
    layer_count: int
    samples_kept: int
    samples_left_out: int
    layer_bytes: int
    margin: float
    complete: bool
    rays: int
    method: Literal["trace", "post"]
    extent: Extent
    examined: Examined | None = None
    way: Way | None = None
    decibels: float | None = None
    lens_plan: LensPlan | None = None
    motion_px: float | None = None
    spans: int = 1


@dataclass(frozen=True)
class Peeled:
    """Everything that a picture takes of its scene, which may be let go then.

    Attributes:
        layers: peeled or cut for the lens, or for a pinhole where the picture is post-processed.
        view: what a pinhole sees; None where nothing asks for it.
        examined: what the layers miss and spare, when that was asked for.
    """

    layers: Layers
    view: PinholeView | None = None
    examined: Examined | None = None


def peel_picture(
    table: RenderTable,
    scene: Scene,
    camera: Camera,
    lens: AbstractLens,
    like: Extent | None,
    watch: Stopwatch,
    *,
    moving: Moving | None = None,
    spare: bool = False,
) -> Peeled:
    """What a picture as `table` has it takes of `scene`.

    Compiled programs of another run serve again where `like` is its `Picture.extent`; `spare` leaves room in
    the layers for those of others.
    """
    post = table.method == "post"
    serves = moving is None and not post and like is not None and like.serves(camera, table.supersampling)
    like = like if serves else None
    with watch.stage("peel"):
        layers = make_layers(table, scene, camera, closed_lens() if post else lens, like, spare=spare)
        jax.block_until_ready(eqx.filter(layers, eqx.is_array))
    if moving is not None:
        return Peeled(layers)
    examined = None
    if table.examine_layers and not post:
        with watch.stage("examine_layers"):
            examined = _examine(layers, scene, camera, lens)
    view = None
    if table.method in ("auto", "post"):
        with watch.stage("pinhole"):
            view = view_in_layers(layers, scene)
            jax.block_until_ready(view.image)
    return Peeled(layers, view, examined)


def make_picture(
    table: RenderTable,
    peeled: Peeled,
    camera: Camera,
    lens: AbstractLens,
    watch: Stopwatch,
    *,
    choose_lens: bool = False,
    moving: Moving | None = None,
) -> Picture:
    """Rays and picture as `table` has them, of what `peel_picture` made with the same settings.

    With `choose_lens` polynomials may take the place of a real lens, if the quality of `table` allows.
    """
    if moving is not None:
        return _while_open(table, peeled.layers, lens, moving, watch)
    if table.method == "post":
        return _post_processed(table, peeled, camera, lens, watch)
    layers, view = peeled.layers, peeled.view
    way, lens_plan = None, None
    if table.quality is not None:
        with watch.stage("plan"):
            if choose_lens:
                assert isinstance(lens, PrescriptionLens | TiltedPrescriptionLens | SpectralLens)
                lens_plan = plan_lens(layers, lens, table.quality)
                lens = lens_plan.lens
            way = choose_way(table, view, layers, lens)
    post = way.post if way is not None and way.by_post else None
    with watch.stage("render"):
        if post is not None:
            assert view is not None
            rays = post.taps
            image = post_process(view, camera, lens, taps=rays)
        else:
            rays = table.rays if way is None or way.traced is None else way.traced.rays
            image = render(layers, lens, rays=rays, smooth=table.smooth, seed=table.seed)
        image.block_until_ready()
    decibels = None
    if way is not None:
        with watch.stage("examine"):
            decibels = _reached(layers, lens, np.asarray(image), rays, table.seed, by_post=post is not None)
    if view is None:
        with watch.stage("pinhole"):
            pinhole = render_pinhole(layers)
            pinhole.block_until_ready()
    else:
        pinhole = view.image
    return Picture(
        **_facts(layers),
        image=image,
        pinhole=pinhole,
        complete=layers.complete,
        examined=peeled.examined,
        rays=rays,
        method="trace" if post is None else "post",
        extent=layers.extent.for_others(),
        way=way,
        decibels=decibels,
        lens_plan=lens_plan,
    )


def _while_open(
    table: RenderTable, layers: Layers, lens: AbstractLens, moving: Moving, watch: Stopwatch
) -> Picture:
    """What the shutter lets in while it is open; the sharp picture is of its instant."""
    post = table.method == "post"
    rays, spans, complete = table.rays, 1, layers.complete
    seen = moving.world, moving.camera_at, lens, moving.motion
    if table.quality is not None:
        with watch.stage("plan"):
            # What moves and is sharp is not smoothed, but layers of one instant do not show what moves.
            rays = plan_rays(layers, lens, table.quality, smooth=False, seed=table.seed).rays
    with watch.stage("render"):
        if post:
            found, _, way = blurred_view(table, *seen, frame=moving.frame, taps=rays, like=layers)
            image = jnp.asarray(found)
        else:
            made = render_open(
                table, *seen, frame=moving.frame, rays=rays, smooth=table.smooth, seed=table.seed
            )
            image, way, spans = made.image, made.motion_px, made.spans
            complete = complete and made.complete
    with watch.stage("pinhole"):
        pinhole = render_pinhole(layers)
        pinhole.block_until_ready()
    return Picture(
        **_facts(layers),
        image=image,
        pinhole=pinhole,
        complete=complete,
        rays=rays,
        method="post" if post else "trace",
        extent=layers.extent.for_others(),
        motion_px=way,
        spans=spans,
    )


def _reached(
    layers: Layers, lens: AbstractLens, image: np.ndarray, rays: int, seed: int, *, by_post: bool
) -> float:
    """The PSNR of a picture in dB, estimated by other rays than its own and its plan's."""
    estimate = functools.partial(estimate_quality, layers, lens, image, seed=seed + _OTHER_RAYS)
    return (estimate() if by_post else estimate(rays=rays)).decibels


def _post_processed(
    table: RenderTable, peeled: Peeled, camera: Camera, lens: AbstractLens, watch: Stopwatch
) -> Picture:
    """From one sharp view: nothing is peeled but what a pinhole sees."""
    view = peeled.view
    assert view is not None
    with watch.stage("render"):
        image = post_process(view, camera, lens, taps=table.rays)
        image.block_until_ready()
    return Picture(
        **_facts(peeled.layers),
        image=image,
        pinhole=view.image,
        complete=True,
        rays=table.rays,
        method="post",
        extent=peeled.layers.extent.for_others(),
    )


def _facts(layers: Layers) -> dict[str, Any]:
    """What a `Picture` records of the layers that it is made of."""
    return {
        "layer_count": layers.filled,
        "samples_kept": layers.samples_kept,
        "samples_left_out": layers.left_out.count,
        "layer_bytes": layers.nbytes,
        "margin": layers.grid.margin / layers.grid.supersampling,
    }


def _examine(layers: Layers, scene: Scene, camera: Camera, lens: AbstractLens) -> Examined:
    samples = layers.grid.supersampling
    everything = peel(scene, camera, lens, supersampling=samples, max_layers=_EVERY_LAYER, umbra=False)
    return Examined(
        missed=missed_light(layers, nearest_in_layers(everything)),
        saving=umbra_saving(scene, camera, lens, supersampling=samples),
        see_through=scene.may_be_seen_through() is not None,
    )
