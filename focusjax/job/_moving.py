"""A still with its shutter open: what moves meanwhile, and how a config says so."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from focusjax.config import (
    Config,
    ConfigError,
    ObjectTable,
    RenderTable,
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
class Moving:
    """What a still's camera and scene do while the shutter is open, from time 1 to time 2.

    Attributes:
        world: what moves.
        camera_at: the camera over time.
        shutter: when it is open.
        frame: the instant of the picture.
        turn: as for `render_moving`.
        step_px: as for `render_moving`.
        most_spans: as for `render_moving`.
    """

    world: MovingWorld
    camera_at: Path
    shutter: Shutter
    frame: float
    turn: float
    step_px: float
    most_spans: int

    @property
    def fps(self) -> float:
        """Units of time per second."""
        return 1.0 / self.shutter.open_time

    def with_camera(self, camera: Camera, *, breathes: bool = False) -> "Moving":
        """The same with what was solved for of the camera; `breathes` is as for `solved_path`."""
        path = solved_path(self.camera_at, self.frame, camera, breathes=breathes)
        return dataclasses.replace(self, camera_at=path)

    def render(self, table: RenderTable, lens: AbstractLens, rays: int) -> MovingPicture:
        """The picture through a lens."""

        def layers(scene: Scene, camera: Camera, lens: AbstractLens, like: Extent | None) -> Layers:
            return make_layers(table, scene, camera, lens, like)

        return render_moving(
            self.world,
            self.camera_at,
            lens,
            self.shutter,
            frame=self.frame,
            fps=self.fps,
            rays=rays,
            smooth=table.smooth,
            seed=table.seed,
            turn=self.turn,
            step_px=self.step_px,
            most_spans=self.most_spans,
            make=layers,
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
    shutter = build_shutter(config)
    if config.render.method == "post":
        refuse_uneven(config, shutter)
    with located(config.source, "shutter"):
        world = _moving_objects(config) if table.objects else StillWorld(scene)
        camera_at = _camera_path(config)
        frame = 1.0 - shutter.begin / shutter.open_time
        camera_at(frame)
    turn = math.radians(table.turn_deg)
    return Moving(world, camera_at, shutter, frame, turn, table.step_px, table.most_spans)


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
    view, camera = config.camera, build_camera(config)
    size: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        "sensor_width": view.sensor_width_mm / 1000,
        "shift": view.shift_mm / 1000,
        "rise": view.rise_mm / 1000,
    }

    def values(name: str) -> dict[float, Any]:
        assert config.shutter is not None
        keys = config.shutter.camera
        return {1.0 + key.at: value for key in keys if (value := getattr(key, name)) is not None}

    lengths = {time: length / 1000 for time, length in values("focal_length_mm").items()}
    length = keyframes(lengths, between="linear") if lengths else float(camera.focal_length)
    positions, targets, matrices = values("position"), values("look_at"), values("matrix")
    if positions or targets:
        if view.position is None or view.look_at is None:
            raise ValueError(
                "the camera has a matrix and keyframes of position or look_at; give one or the other"
            )
        return moving_camera(
            focal_length=length,
            position=keyframes(positions or {1.0: view.position}, between="linear"),
            target=keyframes(targets or {1.0: view.look_at}, between="linear"),
            up=view.up,
            **size,
        )
    still = {1.0: np.asarray(camera.world_from_camera, dtype=float)}
    poses = {time: np.asarray(matrix) for time, matrix in (matrices or still).items()}
    return moving_camera(focal_length=length, pose=pose_path(poses, between="linear"), **size)


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


def build_shutter(config: Config) -> Shutter:
    """The shutter of `[shutter]`.

    Raises:
        ConfigError: a value out of range.
    """
    table, seconds = config.shutter, config.shutter_seconds
    assert table is not None
    assert seconds is not None
    with located(config.source, "shutter"):
        return make_shutter(
            seconds,
            ramp=table.ramp,
            curve=table.curve,
            travel_time=table.travel_time,
            direction=table.direction,
            align=table.align,
        )


def refuse_uneven(config: Config, shutter: Shutter) -> None:
    """Refuse a shutter that post-processing does not know.

    Raises:
        ConfigError: it opens slowly, or travels over the picture.
    """
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
    shutter: Shutter | None,
    *,
    frame: float,
    fps: float,
    taps: int,
    like: Layers | Extent | None,
) -> tuple[np.ndarray, Layers, float]:
    """A picture blurred from one sharp view, that view's layers, and the farthest way in it, in pixels.

    With a shutter the view is of the middle of its time.

    Args:
        settings: how layers are made.
        world: what moves.
        camera_at: the camera over time.
        lens: any lens.
        shutter: when it is open; None for a picture of one instant.
        frame: that instant, in frames.
        fps: frames per second.
        taps: places to look at per pixel.
        like: layers of another picture, or their extent.
    """
    time, velocity = float(frame), None
    if shutter is not None:
        time = middle_of(shutter, frame=frame, fps=fps)
        velocity = velocity_map(world, camera_at, shutter, frame=frame, fps=fps)
    scene, camera = world.at(time), camera_at(time)
    layers = make_layers(settings, scene, camera, closed_lens(), like)
    view = view_in_layers(layers, scene, velocity=None if velocity is None else jnp.asarray(velocity))
    image = post_process(view, camera, lens, taps=taps)
    way = 0.0 if velocity is None else float(np.linalg.norm(velocity, axis=-1).max())
    return np.asarray(image), layers, way
