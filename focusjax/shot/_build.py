"""From a config with a `[shot]` table to a shot."""

import math
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from focusjax._words import did_you_mean, listed
from focusjax.config import (
    Config,
    ConfigError,
    ShotTable,
    build_camera,
    build_focus_points,
    build_lens,
    build_look,
    build_objects,
    build_scene,
    build_solve_options,
    values_of,
)
from focusjax.focus import FocusPoint
from focusjax.geometry import Camera
from focusjax.job import Development, find_development
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.scene import SceneObject, placement
from focusjax.shot._camera import Path, moving_camera, pose_path
from focusjax.shot._keyframes import Keyframes, keyframes
from focusjax.shot._motion import Motion, MovingScene, transforms
from focusjax.shot._render import FrameSettings, MotionSettings
from focusjax.shot._sequence import load_vertex_sequence
from focusjax.shot._solve import Shot
from focusjax.shot._wishes import TimedWish
from focusjax.shutter import make_shutter


def build_shot(config: Config, scene: MovingScene | None = None) -> Shot:
    """Everything that `[shot]` and the tables it changes ask for, loaded and checked.

    Args:
        config: a checked config.
        scene: that of a shot of another config with the same scene and moving objects; loaded if None.

    Raises:
        ConfigError: no `[shot]` table, a focal surface, a real lens, an unknown name, or a value that does
            not fit.
    """
    table = config.shot
    if table is None:
        raise ConfigError(f"{config.source}: there is no [shot] table; add one with frames = 48")
    if config.lens.focal_surface is not None:
        raise ConfigError(
            f"{config.source}: there is a [shot] and a lens.focal_surface, which does not change over time;"
            " leave one of them out"
        )
    if config.lens.prescription is not None:
        raise ConfigError(
            f"{config.source}: there is a [shot] and a lens.prescription, which is for single pictures; leave"
            " one of them out"
        )
    camera = build_camera(config)
    first = build_lens(config, camera, solved=True)
    assert isinstance(first, ThinLens | TiltShiftLens)
    objects = build_objects(config) if scene is None else []
    still = build_scene(config, objects) if scene is None else scene.still
    points = build_focus_points(config, still)
    options = build_solve_options(config)
    _tell_keys_outside(config, table)
    try:
        if scene is None:
            scene = MovingScene(still, objects, _motions(config, table, objects))
        camera_at = _camera_at(config, table, camera)
        cameras = tuple(camera_at(frame) for frame in range(1, table.frames + 1))
        return Shot(
            scene=scene,
            cameras=cameras,
            lenses=_lenses(config, table, cameras, camera, first),
            wishes=_wishes(table, points),
            smoothness=table.smoothness,
            steadiness=table.steadiness,
            fade_frames=table.fade_frames,
            favour_near=config.solve.favour_near,
            options=options,
            look=partial(build_look, config) if config.lens.look else None,
            camera_at=camera_at,
        )
    except ValueError as error:
        raise ConfigError(f"{config.source}: shot: {error}") from error


def build_settings(config: Config) -> FrameSettings:
    """How carefully `[render]` wants the frames."""
    table = config.render
    motion = _motion_settings(config)
    # A config with a shot refuses it.
    assert table.method != "auto"
    if table.method == "post" and motion is not None:
        uneven = max(motion.shutter.curve) > min(motion.shutter.curve)
        odd = "opens slowly" if uneven else "travels over the picture" if motion.shutter.travel_time else None
        if odd is not None:
            raise ConfigError(
                f"{config.source}: the shutter {odd}, which post-processing does not know; leave out"
                f" shutter.{'ramp and shutter.curve' if uneven else 'travel_time'}, or render.method"
            )
    return FrameSettings(
        method=table.method,
        rays=table.rays,
        smooth=table.smooth,
        quality=table.quality,
        supersampling=table.supersampling,
        max_layers=table.max_layers,
        slabs=table.slabs,
        slab_blur_px=table.slab_blur_px,
        pixel_filter=table.pixel_filter,
        view_dependent=table.view_dependent,
        seed=table.seed,
        own_rays=config.shot is not None and config.shot.long_exposure,
        exposure=table.exposure,
        bits=table.png_bits,
        development=_development(config),
        motion=motion,
    )


def _motion_settings(config: Config) -> MotionSettings | None:
    """How long the shutter is open, and how carefully what moves meanwhile is followed."""
    table, shot = config.shutter, config.shot
    if table is None or shot is None:
        return None
    seconds = config.shutter_seconds
    assert seconds is not None
    try:
        shutter = make_shutter(
            seconds,
            ramp=table.ramp,
            curve=table.curve,
            travel_time=table.travel_time,
            direction=table.direction,
            align=table.align,
        )
    except ValueError as error:
        raise ConfigError(f"{config.source}: shutter: {error}") from error
    return MotionSettings(shutter, shot.fps, math.radians(table.turn_deg), table.step_px, table.most_spans)


def _development(config: Config) -> Development | None:
    """How frames are exposed and developed, all alike."""
    development = find_development(config)
    if development is None:
        return None
    if config.exposure is not None and config.exposure.free:
        missing = " and ".join(f"exposure.{name}" for name in config.exposure.free)
        raise ConfigError(
            f"{config.source}: a shot is exposed alike in all its frames; give {missing}, instead of having"
            " them chosen"
        )
    return development


def _tell_keys_outside(config: Config, table: ShotTable) -> None:
    """Warns of keyframes that no frame of the shot reaches."""
    keys = [("shot.camera", table.camera), ("shot.lens", table.lens)]
    keys += [(f"shot.objects ({each.name})", each.keys) for each in table.objects]
    keys += [(f"shot.wishes ({each.name})", each.keys) for each in table.wishes]
    for what, frames in keys:
        outside = [key.frame for key in frames if not 1 <= key.frame <= table.frames]
        if outside:
            which = f"a keyframe at frame {outside[0]:g}" if len(outside) == 1 else "keyframes at frames "
            which += listed([f"{frame:g}" for frame in outside]) if len(outside) > 1 else ""
            warnings.warn(
                f"{config.source}: {what} has {which}, outside the shot's frames 1 to {table.frames}, which"
                " do not reach it",
                stacklevel=2,
            )


def _camera_at(config: Config, table: ShotTable, camera: Camera) -> Path:
    view = config.camera
    size = {
        "width": camera.width,
        "height": camera.height,
        "sensor_width": view.sensor_width_mm / 1000,
        "shift": view.shift_mm / 1000,
        "rise": view.rise_mm / 1000,
    }
    lengths = _keys(table, values_of(table.camera, "focal_length_mm"))
    length: float | Keyframes = float(camera.focal_length)
    if lengths is not None:
        length = Keyframes(lengths.frames, lengths.values / 1000, lengths.between)
    positions = _keys(table, values_of(table.camera, "position"))
    targets = _keys(table, values_of(table.camera, "look_at"))
    if positions is not None or targets is not None:
        # What has no keyframes stays; a camera given by a matrix has no such point to look at.
        if view.position is None or view.look_at is None:
            raise ValueError(
                "the camera has a matrix and keyframes of position or look_at; give one or the other"
            )
        return moving_camera(
            focal_length=length,
            position=positions or keyframes({1: view.position}),
            target=targets or keyframes({1: view.look_at}),
            up=view.up,
            **size,
        )
    matrices = values_of(table.camera, "matrix") or {1: np.asarray(camera.world_from_camera, dtype=float)}
    pose = pose_path({frame: np.asarray(matrix) for frame, matrix in matrices.items()}, between=table.between)
    return moving_camera(focal_length=length, pose=pose, **size)


def _lenses(
    config: Config,
    table: ShotTable,
    cameras: Sequence[Camera],
    camera: Camera,
    first: ThinLens | TiltShiftLens,
) -> tuple[ThinLens | TiltShiftLens, ...]:
    """The lens before solving, of every frame; it keeps its f-number and angles while the camera zooms."""
    numbers = _keys(table, values_of(table.lens, "f_number"))
    if numbers is None and all(float(each.focal_length) == float(camera.focal_length) for each in cameras):
        return (first,) * len(cameras)
    if numbers is not None and config.lens.f_number is None:
        raise ValueError(
            "the lens has aperture_radius_mm and keyframes of its f-number; give f_number instead"
        )
    found: list[ThinLens | TiltShiftLens] = []
    for frame, each in enumerate(cameras, start=1):
        changes = {} if numbers is None else {"f_number": float(numbers(frame))}
        lens_table = config.lens.model_copy(update=changes)
        lens = build_lens(config.model_copy(update={"lens": lens_table}), each, solved=True)
        assert isinstance(lens, ThinLens | TiltShiftLens)
        found.append(lens)
    return tuple(found)


def _motions(config: Config, table: ShotTable, objects: Sequence[SceneObject]) -> dict[str, Motion]:
    names = [item.name for item in objects]
    found = {}
    for moving in table.objects:
        number = _named(moving.name, names, "objects", "the scene")
        placed, item = config.scene.objects[number], objects[number]
        path = None
        if moving.keys:
            keys: dict[float, Mapping[str, Any]] = {
                key.frame: {
                    "translate": placed.translate if key.translate is None else key.translate,
                    "rotate": placed.rotate_deg if key.rotate_deg is None else key.rotate_deg,
                    "scale": placed.scale if key.scale is None else key.scale,
                }
                for key in moving.keys
            }
            path = transforms(keys, between=table.between)
        shape = None
        if moving.vertices is not None:
            shape = load_vertex_sequence(
                config.reach.file(moving.vertices, "shot.objects.vertices"),
                item,
                first_frame=1.0 if moving.first_frame is None else moving.first_frame,
                frames_per_step=1.0 if moving.frames_per_step is None else moving.frames_per_step,
            )
        found[item.name] = Motion(placement(placed.translate, placed.rotate_deg, placed.scale), path, shape)
    return found


def _wishes(table: ShotTable, points: Sequence[FocusPoint]) -> tuple[TimedWish, ...]:
    names = [point.name for point in points]
    changed = {}
    for timed in table.wishes:
        number = _named(timed.name, names, "wishes", "[[focus]]")
        places = values_of(timed.keys, "point"), values_of(timed.keys, "pixel")
        if all(places):
            raise ValueError(
                f"wish {timed.name!r} has keyframes of point and of pixel; give one or the other"
            )
        changed[number] = TimedWish(
            points[number],
            from_frame=timed.from_frame,
            to_frame=timed.to_frame,
            weight=_keys(table, values_of(timed.keys, "weight")),
            diameter=_keys(table, values_of(timed.keys, "blur")),
            place=_keys(table, places[0] or places[1]),
        )
    return tuple(changed.get(number, TimedWish(point)) for number, point in enumerate(points))


def _keys(table: ShotTable, values: Mapping[float, Any]) -> Keyframes | None:
    return keyframes(values, between=table.between) if values else None


def _named(name: str, names: Sequence[str], what: str, where: str) -> int:
    """The position of a name that is there once."""
    if name not in names:
        hint = did_you_mean(name, names, f"{where} has {', '.join(map(repr, names))}")
        raise ValueError(f"{what}: {where} has no {name!r}; {hint}")
    if list(names).count(name) > 1:
        raise ValueError(f"{what}: {where} has {name!r} more than once; give each its own name")
    return list(names).index(name)
