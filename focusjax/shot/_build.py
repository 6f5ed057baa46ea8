"""From a config with a `[shot]` table to a shot."""

import warnings
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from focusjax._words import did_you_mean, listed
from focusjax.config import (
    Config,
    ConfigError,
    ObjectTable,
    ShotTable,
    TimedControlTable,
    TimedWishTable,
    build_camera,
    build_control_points,
    build_focal_surface,
    build_focus_points,
    build_look,
    build_objects,
    build_scene,
    build_solve_options,
    build_stored_scene,
    located,
    values_of,
)
from focusjax.focus import FocusPoint, ImagePoints
from focusjax.geometry import Camera
from focusjax.job import Development, build_motion, find_development, keyed_transforms
from focusjax.lens import AbstractLens, FocalSurface, ThinLens
from focusjax.motion import Keyframes, Motion, MovingScene, load_vertex_sequence, transforms_of
from focusjax.scene import Scene, SceneObject, placement
from focusjax.shot._build_camera import build_path, table_keys
from focusjax.shot._glass import ShotGlass
from focusjax.shot._held import held_frames
from focusjax.shot._lens_track import LensTrack
from focusjax.shot._settings import FrameSettings
from focusjax.shot._solve import Shot
from focusjax.shot._surfaces import CONTROL_SAMPLES, TimedSurface
from focusjax.shot._wishes import TimedWish


def build_shot(config: Config, scene: MovingScene | None = None) -> Shot:
    """Everything that `[shot]` and the tables it changes ask for, loaded and checked.

    Args:
        config: a checked config.
        scene: that of a shot of another config with the same scene and moving objects; loaded if None.

    Raises:
        ConfigError: no `[shot]` table, an unknown name, or a value that does not fit.
    """
    table = config.shot
    if table is None:
        raise ConfigError(f"{config.source}: there is no [shot] table; add one with frames = 48")
    camera = build_camera(config)
    objects = build_objects(config) if scene is None else []
    still = build_scene(config, objects) if scene is None else scene.still
    solving = bool(config.focus)
    points = build_focus_points(config, still) if solving else ()
    of_lens = config.lens.focal_surface is None
    options = build_solve_options(config) if solving and of_lens else {"close_focus": config.lens.close_focus}
    _warn_of_keys_outside(config, table)
    with located(config.source, "shot"):
        if scene is None:
            scene = MovingScene(still, objects, _motions(config, table, objects))
        track = LensTrack(config, table)
        camera_at = build_path(config, table, camera, track, scene)
        cameras = tuple(camera_at(frame) for frame in range(1, table.frames + 1))
        held = held_frames(config, table, track) if solving and of_lens else {}
        keyed_look = any(track.config_at(frame).lens.look for frame in range(1, table.frames + 1))
        return Shot(
            scene=scene,
            cameras=cameras,
            lenses=track.lenses(cameras, solved=solving and not held.get("focus")),
            wishes=_wishes(table, points),
            smoothness=table.smoothness,
            steadiness=table.steadiness,
            fade_frames=table.fade_frames,
            favour_near=config.solve.favour_near,
            options=options,
            held=held,
            surface=_surface(config, table, still),
            glass=None if config.lens.real is None else ShotGlass(track),
            look=partial(_look, track) if keyed_look else None,
            camera_at=camera_at,
        )


def _look(track: LensTrack, frame: int, camera: Camera, lens: AbstractLens) -> AbstractLens:
    """The lens that makes a frame's picture."""
    return build_look(track.config_at(frame), camera, lens)


def build_settings(config: Config) -> FrameSettings:
    """How carefully `[render]` wants the frames."""
    table = config.render
    motion = None if config.shutter is None or config.shot is None else build_motion(config)
    # A config with a shot refuses it.
    assert table.method != "auto"
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
        fit_px=config.lens.fit_px,
        development=_development(config),
        motion=motion,
    )


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


def _warn_of_keys_outside(config: Config, table: ShotTable) -> None:
    """Warns of keyframes that no frame of the shot reaches."""
    keys = [("shot.camera", table.camera), ("shot.lens", table.lens)]
    keys += [(f"shot.objects ({each.name})", each.keys) for each in table.objects]
    keys += [(f"shot.wishes ({each.name})", each.keys) for each in table.wishes]
    keys += [(f"shot.surface ({each.name})", each.keys) for each in table.surface]
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


def _motions(config: Config, table: ShotTable, objects: Sequence[SceneObject]) -> dict[str, Motion]:
    names = [item.name for item in objects]
    found = _motions_of_file(config)
    # Those of the scene's file come first, and stand where it has them.
    placements = [ObjectTable(file="")] * (len(objects) - len(config.scene.objects))
    placements += config.scene.objects
    for moving in table.objects:
        number = _named(moving.name, names, "objects", "the scene")
        placed, item = placements[number], objects[number]
        path = None
        if moving.keys:
            path = keyed_transforms(placed, {key.frame: key for key in moving.keys}, table.between)
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


def _motions_of_file(config: Config) -> dict[str, Motion]:
    """How objects of the scene's file move, whose first frame is the shot's."""
    stored = build_stored_scene(config)
    found = {}
    for name, matrices in ({} if stored is None else stored.motions).items():
        try:
            path = transforms_of(dict(enumerate(matrices, start=1)))
        except ValueError as error:
            raise ValueError(f"{config.scene.file}: {name!r} moves, and {error}") from error
        found[name] = Motion(matrices[0], path)
    return found


def _surface(config: Config, table: ShotTable, scene: Scene) -> TimedSurface | None:
    """The control points of a focal surface over time."""
    described = config.lens.focal_surface
    if described is None:
        if table.surface:
            raise ValueError(
                "there are [[shot.surface]] tables and no lens.focal_surface; give it its points"
            )
        return None
    points = build_control_points(config, scene, samples=CONTROL_SAMPLES)
    names = [point.name for point in points]
    timed = {number: TimedWish(point) for number, point in enumerate(points)}
    scales: dict[int, Keyframes] = {}
    for each in table.surface:
        number = _named(each.name, names, "surface", "lens.focal_surface.points")
        timed[number] = _timed(table, points[number], each, "blur_px")
        if (scale := table_keys(table, values_of(each.keys, "aperture_scale"))) is not None:
            scales[number] = scale

    own = tuple(point.aperture_scale for point in described.points)
    build = partial(_focal_surface, config, own, scales)
    return TimedSurface(tuple(timed.values()), build, described.smoothness, described.favour_near)


def _focal_surface(
    config: Config,
    own: Sequence[float],
    scales: Mapping[int, Keyframes],
    frame: int,
    found: ImagePoints,
    camera: Camera,
    lens: ThinLens,
) -> FocalSurface:
    """The focal surface of a frame before solving; control points have their own scales, or keyed ones."""
    now = [float(scales[k](frame)) if k in scales else scale for k, scale in enumerate(own)]
    return build_focal_surface(config, found, camera, lens, aperture_scale=np.array(now))


def _timed(
    table: ShotTable, point: FocusPoint, each: TimedWishTable | TimedControlTable, blur: str
) -> TimedWish:
    """A wish or a control point over time; `blur` is the key of its keyframes that has the diameter."""
    places = values_of(each.keys, "point"), values_of(each.keys, "pixel")
    if all(places):
        raise ValueError(f"{each.name!r} has keyframes of point and of pixel; give one or the other")
    return TimedWish(
        point,
        from_frame=each.from_frame,
        to_frame=each.to_frame,
        weight=table_keys(table, values_of(each.keys, "weight")),
        diameter=table_keys(table, values_of(each.keys, blur)),
        place=table_keys(table, places[0] or places[1]),
    )


def _wishes(table: ShotTable, points: Sequence[FocusPoint]) -> tuple[TimedWish, ...]:
    names = [point.name for point in points]
    changed = {}
    for timed in table.wishes:
        number = _named(timed.name, names, "wishes", "[[focus]]")
        changed[number] = _timed(table, points[number], timed, "blur")
    return tuple(changed.get(number, TimedWish(point)) for number, point in enumerate(points))


def _named(name: str, names: Sequence[str], what: str, where: str) -> int:
    """The position of a name that is there once."""
    if name not in names:
        hint = did_you_mean(name, names, f"{where} has {', '.join(map(repr, names))}")
        raise ValueError(f"{what}: {where} has no {name!r}; {hint}")
    if list(names).count(name) > 1:
        raise ValueError(f"{what}: {where} has {name!r} more than once; give each its own name")
    return list(names).index(name)
