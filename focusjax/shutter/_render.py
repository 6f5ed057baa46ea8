"""The picture of a moving scene: every lens ray has a time while the shutter is open."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind, require_switches
from focusjax._counts import require_counts, require_seed
from focusjax.geometry import Camera
from focusjax.layers import Extent, Layers, check_held, peel
from focusjax.lens import AbstractLens
from focusjax.scene import Scene
from focusjax.shutter._motion import (
    NODES,
    Cameras,
    MovingWorld,
    StillWorld,
    bodies_that_move,
    body_poses,
    cameras_of,
)
from focusjax.shutter._plan import BACKDROP, Care, Plan, part_of, plan_bodies
from focusjax.shutter._shutter import Shutter
from focusjax.shutter._swept import swept_lens
from focusjax.trace import MovingLayers, Span, Timing, exposed, moving_layers, render

MakeLayers = Callable[[Scene, Camera, AbstractLens, Extent | None], Layers]
"""Layers of a scene that serve a lens, like others where an extent is given."""

_SPAN_NODES = 9
"""Times of a span at which poses are known; straight between them, off by 1/512 of the square of its turn."""


@dataclasses.dataclass(frozen=True)
class MovingPicture:
    """A picture of what moves, and how it was made.

    Attributes:
        image: linear radiance [h, w, 3], the mean over the light that the shutter lets in.
        spans: parts of the shutter's time; 1 where nothing moves.
        peels: how often anything was peeled.
        changing: share of the pixels in which something moves.
        motion_px: farthest way in the picture of anything that moves by itself, in pixels.
        step_px: how far what deforms goes from one span to the next, counted as for `step_px` of
            `render_moving`.
        complete: whether no surface was left out for want of layers.
        left_out: samples of surface for which there were too few layers, of all layers that were peeled.
        extents: sizes of the layers by body: `like` for the next picture.
    """

    image: Float[Array, "h w 3"]
    spans: int
    peels: int
    changing: float
    motion_px: float
    step_px: float
    complete: bool
    left_out: int
    extents: Mapping[str, Extent]


def render_moving(
    world: MovingWorld | Scene,
    camera: Camera | Callable[[float], Camera],
    lens: AbstractLens,
    shutter: Shutter,
    *,
    frame: float = 1.0,
    fps: float = 24.0,
    rays: int = 64,
    smooth: bool = True,
    seed: int = 0,
    turn: float = 0.2,
    step_px: float = 1.0,
    most_spans: int = 64,
    make: MakeLayers | None = None,
    like: Mapping[str, Extent] | None = None,
) -> MovingPicture:
    """The picture of a moving scene through a lens, while a shutter is open (Kyaw 2013 section 5.2).

    Rays are spread evenly over pixel, opening and time together. What moves without deforming, and all that
    the camera's motion moves, is peeled once for a span of the shutter's time, and rays are moved into its
    axes, each by its own time. That is exact however fast it moves, and leaves no ghosts. Spans are as short
    as it takes for a body to be seen from directions within `turn` of that in which its layers see it. What
    deforms is peeled for each span as it is in the middle; spans are so short that it goes by at most
    `step_px` from one to the next. Where nothing moves rays are those of `render`, and a scene where nothing
    does is peeled and traced as without a shutter.

    Highlights and shading are those of a span's middle. Small lights that are out of focus all the while have
    rays of their own, whether they move or not; those that come into focus are seen by the others alone.

    Args:
        world: what moves, or a scene that stands still before a moving camera.
        camera: where it is by frame, or one that stands still; always of as many pixels.
        lens: made for the camera of the frame; it does not change while the shutter is open.
        shutter: when it is open.
        frame: the instant around which it is, in frames.
        fps: frames of `world` and `camera` per second.
        rays: of each pixel in which something moves, and on the average of a picture without motion, whose
            rays the others have.
        smooth: denoise what is blurred by defocus, as `render` does.
        seed: chooses them.
        turn: radians, by which a body may be seen from elsewhere than by its layers; less is more exact.
        step_px: pixels, more for what is blurred, by which deforming things may move from span to span.
        most_spans: no more than these; `step_px` of the result is the step that this leaves.
        make: makes layers, by `peel` if not given, of a scene, camera and lens, and like an extent.
        like: `extents` of another picture, whose compiled programs serve again; {} for the first of several:
            `peel` then leaves room for the layers of others, as a `make` of your own would have to.

    Raises:
        ValueError: a number out of range, a camera that changes its number of pixels, things so near to the
            lens that their layers do not fit in memory, or as `peel`.

    Example:
        >>> picture = render_moving(moving, camera, lens, make_shutter(1 / 50), frame=12)  # doctest: +SKIP
    """
    require_counts(rays=rays, most_spans=most_spans)
    seed = require_seed(seed)
    require_switches(smooth=smooth)
    usage = "render_moving(world, camera, lens, shutter)"
    require_kind(lens, AbstractLens, usage, "`thin_lens` makes one, as others do", "lens")
    require_kind(shutter, Shutter, usage, "`make_shutter` makes one", "shutter")
    for name, value in (("fps", fps), ("turn", turn), ("step_px", step_px)):
        if not 0 < real_number(value, name, "a positive number") < np.inf:
            raise ValueError(f"{name} is {value}; expected a positive number")
    layers_of = functools.partial(_peeled, spare=like is not None) if make is None else make
    moving = StillWorld(world) if isinstance(world, Scene) else world
    cameras = cameras_of(camera, frame)
    begin, end = (frame + fps * seconds for seconds in shutter.interval())
    times = np.linspace(begin, end, NODES)
    bodies, scene, known = bodies_that_move(moving, times), moving.at(frame), dict(like or {})
    if not bodies and not cameras.move(times):
        layers = layers_of(scene, cameras.still, lens, known.get(BACKDROP))
        image = render(layers, lens, rays=rays, smooth=smooth, seed=seed)
        missing, extents = layers.left_out.count, {BACKDROP: layers.extent}
        return MovingPicture(image, 1, 1, 0.0, 0.0, 0.0, layers.complete, missing, extents)
    plans = plan_bodies(moving, scene, bodies, cameras, lens, times, Care(turn, step_px, most_spans))
    edges = _edges(shutter, plans.spans, frame, fps)
    laid: list[_Laid] = []
    for plan in plans.bodies:
        held = sum(_bytes(each.posed) for each in laid)
        laid.append(_lay(plan, moving, cameras, lens, edges, layers_of, known, held=held))
    spans = [
        Span(edges[k], edges[k + 1], tuple(each.posed[k * len(each.posed) // plans.spans] for each in laid))
        for k in range(plans.spans)
    ]
    change, backdrop = plans.change.ravel(), laid[0].layers
    image = exposed(
        cameras.still,
        lens,
        Timing(frame + fps * shutter.quantiles(), fps * shutter.delay),
        spans,
        backdrop,
        change,
        rays=rays,
        smooth=smooth,
        seed=seed,
    )
    return MovingPicture(
        image=image.reshape(*plans.change.shape, 3),
        spans=plans.spans,
        peels=sum(len(each.posed) for each in laid),
        changing=float(change.mean()),
        motion_px=plans.motion_px,
        step_px=plans.step_px,
        complete=all(each.left_out == 0 for each in laid),
        left_out=sum(each.left_out for each in laid),
        extents={plan.body.name: each.layers.extent for plan, each in zip(plans.bodies, laid, strict=True)},
    )


def _peeled(scene: Scene, camera: Camera, lens: AbstractLens, like: Extent | None, *, spare: bool) -> Layers:
    return peel(scene, camera, lens, like=like, spare=spare)


def _edges(shutter: Shutter, spans: int, frame: float, fps: float) -> Float[np.ndarray, " k"]:
    """Where spans begin and end, in frames.

    Of like shares of the light, or of the time where rows have times of their own.
    """
    if shutter.delay:
        return frame + fps * np.linspace(*shutter.interval(), spans + 1)
    quantiles = shutter.quantiles()
    return frame + fps * np.interp(np.linspace(0, 1, spans + 1), np.linspace(0, 1, len(quantiles)), quantiles)


@dataclasses.dataclass(frozen=True)
class _Laid:
    """A body's layers for all its spans, and the last of them as they are."""

    posed: tuple[MovingLayers, ...]
    layers: Layers
    left_out: int


def _lay(
    plan: Plan,
    world: MovingWorld,
    cameras: Cameras,
    lens: AbstractLens,
    edges: Float[np.ndarray, " k"],
    layers_of: MakeLayers,
    known: Mapping[str, Extent],
    *,
    held: int,
) -> _Laid:
    """A body peeled at the middle of each of its spans, beside `held` bytes of layers.

    Raises:
        ValueError: so much of it is near the lens that the layers of all spans do not fit in memory.
    """
    every, like = (len(edges) - 1) // plan.spans, known.get(plan.body.name)
    number = plan.body.faces.start
    posed: list[MovingLayers] = []
    left_out, layers = 0, None
    for k in range(plan.spans):
        begin, end = edges[k * every], edges[(k + 1) * every]
        middle = 0.5 * (begin + end)
        part = part_of(world.at(float(middle)), plan.faces)
        key, wide, matrices = cameras.still, lens, np.eye(4)[None]
        if plan.nearest > 0:
            key = cameras.at(float(middle))
            matrices = _matrices(plan, cameras, key, np.linspace(begin, end, _SPAN_NODES), middle)
            wide = swept_lens(lens, cameras.still, key, matrices, plan.nearest)
        layers = layers_of(part, key, wide, like)
        like, left_out = layers.extent, left_out + layers.left_out.count
        backdrop = plan.body.name == BACKDROP
        posed.append(
            moving_layers(
                layers,
                cameras.still,
                lens,
                matrices,
                float(begin),
                float(end),
                number=number,
                backdrop=backdrop,
            )
        )
        check_held(
            held + _bytes(posed),
            f"the layers of {plan.body.name or 'what stands still'} for {k + 1} of {plan.spans} spans",
            f"keep things farther from the lens (this is {1.0 / max(plan.nearest, 1e-9):.3g} m from it at"
            " least), or lower most_spans, the picture's size or the opening",
        )
    assert layers is not None
    return _Laid(tuple(posed), layers, left_out)


def _bytes(posed: Sequence[MovingLayers]) -> int:
    return sum(leaf.nbytes for leaf in jax.tree.leaves(posed) if isinstance(leaf, jax.Array))


def _matrices(
    plan: Plan, cameras: Cameras, key: Camera, times: Float[np.ndarray, " m"], middle: float
) -> Float[np.ndarray, "m 4 4"]:
    """From the axes of rays to those of the key camera in which the body stands still."""
    poses = body_poses(plan.body, np.append(times, middle))
    key_from_world = np.linalg.inv(np.asarray(key.world_from_camera, dtype=np.float64))
    found = [
        key_from_world @ poses[-1] @ np.linalg.solve(pose, cameras.world_from_rays(float(time)))
        for pose, time in zip(poses[:-1], times, strict=True)
    ]
    return np.stack(found)
