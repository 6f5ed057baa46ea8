"""A still with its shutter open: what moves meanwhile, and how a config says so."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from focusjax.config import (
    CameraTable,
    Config,
    ConfigError,
    ObjectTable,
    build_camera,
    build_objects,
    build_scene,
    located,
)
from focusjax.geometry import Camera
from focusjax.job._layers import LayerSettings, make_layers
from focusjax.layers import Extent, Layers
from focusjax.lens import AbstractLens
from focusjax.motion import (
    Keyframes,
    Motion,
    MovingScene,
    Path,
    Transforms,
    keyframes,
    moving_camera,
    pose_path,
    solved_path,
    transforms,
)
from focusjax.post import closed_lens, post_process, view_in_layers
from focusjax.scene import Scene, placement
from focusjax.shutter import (
    MovingPicture,
    MovingWorld,
    Shutter,
    StillWorld,
    make_shutter,
    middle_of,
    render_moving,
    velocity_map,
)


@dataclasses.dataclass(frozen=True)
class MotionSettings:
    """The shutter, and how carefully what moves is followed; see `render_moving`.

    Attributes:
        shutter: when it is open.
        fps: frames per second; of a still, openings of its shutter per second.
        turn: radians.
        step_px: pixels.
        most_spans: a number.
    """

    shutter: Shutter
    fps: float
    turn: float = 0.2
    step_px: float = 1.0
    most_spans: int = 64


@dataclasses.dataclass(frozen=True)
class Moving:
    """What a still's camera and scene do while the shutter is open, from time 1 to time 2.

    Attributes:
        world: what moves.
        camera_at: the camera over time.
        motion: when the shutter is open, a unit of time being as long.
        frame: the instant of the picture.
    """

    world: MovingWorld
    camera_at: Path
    motion: MotionSettings
    frame: float

    def with_camera(self, camera: Camera, *, breathes: bool = False) -> "Moving":
        """The same with what was solved for of the camera; `breathes` is as for `solved_path`."""
        path = solved_path(self.camera_at, self.frame, camera, breathes=breathes)
        return dataclasses.replace(self, camera_at=path)


def render_open(
    settings: LayerSettings,
    world: MovingWorld,
    camera_at: Callable[[float], Camera],
    lens: AbstractLens,
    motion: MotionSettings,
    *,
    like: Mapping[str, Extent] | None = None,
    **options: Any,
) -> MovingPicture:
    """`render_moving` with layers as `settings` has them; `options` are its other arguments."""
    known, spare = like, like is not None

    def layers(scene: Scene, camera: Camera, lens: AbstractLens, like: Extent | None) -> Layers:
        return make_layers(settings, scene, camera, lens, like, spare=spare)

    return render_moving(
        world,
        camera_at,
        lens,
        motion.shutter,
        fps=motion.fps,
        turn=motion.turn,
        step_px=motion.step_px,
        most_spans=motion.most_spans,
        make=layers,
        like=known,
        **options,
    )


def build_moving(config: Config, scene: Scene) -> Moving | None:
    """What `[shutter]` of a still says; None without one.

    Args:
        config: a checked config.
        scene: of the config, for what stands still.

    Raises:
        ConfigError: keyframes that do not fit, or an object that is not there.
    """
    table = config.shutter
    if table is None or config.shot is not None:
        return None
    motion = build_motion(config)
    shutter = motion.shutter
    with located(config.source, "shutter"):
        world = _moving_objects(config) if table.objects else StillWorld(scene)
        camera_at = _camera_path(config)
        frame = 1.0 - shutter.begin / shutter.open_time
        camera_at(frame)
    return Moving(world, camera_at, motion, frame)


def _moving_objects(config: Config) -> MovingScene:
    assert config.shutter is not None
    objects = build_objects(config)
    names = [item.name for item in objects]
    motions = {}
    for moving in config.shutter.objects:
        if moving.name not in names:
            raise ValueError(
                f"objects: the scene has no {moving.name!r}; it has {', '.join(map(repr, names)) or 'none'}"
            )
        placed = config.scene.objects[names.index(moving.name)]
        path = keyed_transforms(placed, {1.0 + key.at: key for key in moving.keys}, "linear")
        motions[moving.name] = Motion(placement(placed.translate, placed.rotate_deg, placed.scale), path)
    return MovingScene(build_scene(config, objects), objects, motions)


def _camera_path(config: Config) -> Path:
    assert config.shutter is not None
    keys, camera = config.shutter.camera, build_camera(config)

    def values(name: str) -> dict[float, Any]:
        return {1.0 + key.at: value for key in keys if (value := getattr(key, name)) is not None}

    def keyed(name: str) -> Keyframes | None:
        found = values(name)
        return keyframes(found, between="linear") if found else None

    lengths = {time: length / 1000 for time, length in values("focal_length_mm").items()}
    return camera_between(
        config.camera,
        camera,
        keyed("position"),
        keyed("look_at"),
        values("matrix"),
        between="linear",
        focal_length=keyframes(lengths, between="linear") if lengths else float(camera.focal_length),
        sensor_width=config.camera.sensor_width_mm / 1000,
        shift=config.camera.shift_mm / 1000,
        rise=config.camera.rise_mm / 1000,
    )


def camera_between(
    view: CameraTable,
    camera: Camera,
    position: Keyframes | None,
    target: Keyframes | None,
    matrices: Mapping[float, Any],
    *,
    between: str,
    **size: Any,
) -> Path:
    """The camera of a config between keyframes of its pose; what has none stays as `camera` has it.

    Args:
        view: the config's `[camera]`.
        camera: that it makes.
        position: where the camera is, if that is keyed.
        target: where it looks, if that is keyed.
        matrices: poses by time, where it is keyed by these.
        between: how the pose goes from one matrix to the next.
        size: focal length, sensor and slides, as `moving_camera` takes them.

    Raises:
        ValueError: keyframes of places for a camera that has a matrix.
    """
    size |= {"width": camera.width, "height": camera.height}
    if position is None and target is None:
        poses = matrices or {1.0: np.asarray(camera.world_from_camera, dtype=float)}
        pose = pose_path({time: np.asarray(matrix) for time, matrix in poses.items()}, between=between)
        return moving_camera(pose=pose, **size)
    # A camera given by a matrix has no such point to look at.
    if view.position is None or view.look_at is None:
        raise ValueError(
            "the camera has a matrix and keyframes of position or look_at; give one or the other"
        )
    return moving_camera(
        position=position or keyframes({1.0: view.position}),
        target=target or keyframes({1.0: view.look_at}),
        up=view.up,
        **size,
    )


def keyed_transforms(placed: ObjectTable, keys: Mapping[float, Any], between: str) -> Transforms:
    """Where an object stands over time; what a keyframe leaves out is as the scene has it.

    Args:
        placed: the object's table.
        keys: by time, with `translate`, `rotate_deg` and `scale`, or None for what is left out.
        between: how the placement goes from one keyframe to the next.
    """
    rows: dict[float, Mapping[str, Any]] = {
        time: {
            "translate": placed.translate if key.translate is None else key.translate,
            "rotate": placed.rotate_deg if key.rotate_deg is None else key.rotate_deg,
            "scale": placed.scale if key.scale is None else key.scale,
        }
        for time, key in keys.items()
    }
    return transforms(rows, between=between)


def build_motion(config: Config) -> MotionSettings:
    """The shutter of `[shutter]`, and how carefully what moves is followed.

    Raises:
        ConfigError: a value out of range; a shutter that opens slowly, or travels over the picture, of a
            picture that is post-processed.
    """
    table, seconds = config.shutter, config.shutter_seconds
    assert table is not None
    assert seconds is not None
    with located(config.source, "shutter"):
        shutter = make_shutter(
            seconds,
            ramp=table.ramp,
            curve=table.curve,
            travel_time=table.travel_time,
            direction=table.direction,
            align=table.align,
        )
    if config.render.method == "post":
        _refuse_uneven(config, shutter)
    # The time of a still is counted in times that its shutter is open.
    fps = 1.0 / shutter.open_time if config.shot is None else config.shot.fps
    return MotionSettings(shutter, fps, math.radians(table.turn_deg), table.step_px, table.most_spans)


def _refuse_uneven(config: Config, shutter: Shutter) -> None:
    """Refuse a shutter that post-processing does not know."""
    uneven = max(shutter.curve) > min(shutter.curve)
    odd = "opens slowly" if uneven else "travels over the picture" if shutter.travel_time else None
    if odd is not None:
        raise ConfigError(
            f"{config.source}: the shutter {odd}, which post-processing does not know; leave out"
            f" shutter.{'ramp and shutter.curve' if uneven else 'travel_time'}, or render.method"
        )


def blurred_view(
    settings: LayerSettings,
    world: MovingWorld,
    camera_at: Callable[[float], Camera],
    lens: AbstractLens,
    motion: MotionSettings | None,
    *,
    frame: float,
    taps: int,
    like: Layers | Extent | None,
    spare: bool = False,
) -> tuple[np.ndarray, Layers, float]:
    """A picture blurred from one sharp view, that view's layers, and the farthest way in it, in pixels.

    With a shutter the view is of the middle of its time.

    Args:
        settings: how layers are made.
        world: what moves.
        camera_at: the camera over time.
        lens: any lens.
        motion: when the shutter is open; None for a picture of one instant.
        frame: that instant, in frames.
        taps: places to look at per pixel.
        like: layers of another picture, or their extent.
        spare: leave room in the layers for those of other pictures; see `peel`.
    """
    time, velocity = float(frame), None
    if motion is not None:
        time = middle_of(motion.shutter, frame=frame, fps=motion.fps)
        velocity = velocity_map(world, camera_at, motion.shutter, frame=frame, fps=motion.fps)
    scene, camera = world.at(time), camera_at(time)
    layers = make_layers(settings, scene, camera, closed_lens(), like, spare=spare)
    view = view_in_layers(layers, scene, velocity=None if velocity is None else jnp.asarray(velocity))
    image = post_process(view, camera, lens, taps=taps)
    way = 0.0 if velocity is None else float(np.linalg.norm(velocity, axis=-1).max())
    return np.asarray(image), layers, way
