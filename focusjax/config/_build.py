"""From the tables of a config to the library's own objects, units converted."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from focusjax._kept import kept
from focusjax.config._build_look import build_aperture
from focusjax.config._errors import ConfigError, about_key, located
from focusjax.config._load import Config
from focusjax.config._scene import (
    ConstantTable,
    DirectionalTable,
    GradientTable,
    ObjectTable,
    PointTable,
)
from focusjax.focus import ArgumentError
from focusjax.geometry import Camera, look_at, make_camera
from focusjax.lens import (
    ThinLens,
    TiltShiftLens,
    close_focus_lens,
    depth_of_field_lens,
    thin_lens,
    tilt_shift_lens,
)
from focusjax.photo import Photo, load_photo
from focusjax.scene import (
    AbstractBackground,
    AbstractLight,
    Scene,
    SceneObject,
    constant_background,
    directional_light,
    gradient_background,
    image_background,
    load_mesh,
    make_scene,
    point_light,
)
from focusjax.scene_files import StoredScene, read_scene


def build_stored_scene(config: Config) -> StoredScene | None:
    """What the file of `[scene]` has, which is read once; None without one.

    Raises:
        ConfigError: it cannot be read.
    """
    name = config.scene.file
    if name is None:
        return None

    def read() -> StoredScene:
        with located(config.source):
            return read_scene(config.reach.file(name, "scene.file"), within=config.reach.folders(name))

    return kept(config, "stored scene", read)


def build_objects(config: Config) -> tuple[SceneObject, ...]:
    """Load the meshes of `[scene]`: those of its file, and then those of its objects.

    Raises:
        ConfigError: a mesh that cannot be used.
    """
    stored = build_stored_scene(config)
    with located(config.source):
        own = tuple(_object(table, number, config) for number, table in enumerate(config.scene.objects))
    return own if stored is None else (*stored.objects, *own)


def build_scene(config: Config, objects: Sequence[SceneObject] | None = None) -> Scene:
    """Put the meshes of `[scene]` together, which are loaded when they are not given; or its photograph.

    Raises:
        ConfigError: a mesh or photograph that cannot be used, or objects that cannot stand together; a file
            without lights, where the config has none either.
    """
    if config.scene.photo is not None:
        photo = build_photo(config)
        # The same pupil behind another focal length has another f-number.
        longer = float(photo.camera.focal_length) / float(build_camera(config).focal_length)
        return photo.scene(f_number=config.widest_f_number * longer)
    loaded = build_objects(config) if objects is None else objects
    stored = build_stored_scene(config)
    with located(config.source):
        lights = [_light(table) for table in config.scene.lights]
        ambient = np.broadcast_to(np.asarray(config.scene.ambient, dtype=float), (3,))
        if stored is not None and not config.scene.unlit:
            lights, ambient = [*stored.lights, *lights], ambient + stored.ambient
        glows = any(np.any(material.emission) for each in loaded for material in each.materials)
        if not (config.scene.unlit or lights or ambient.any() or glows):
            raise ValueError(
                f"scene.file is {config.scene.file!r}, which has no light that is read; add ambient = 0.3, a"
                " [[scene.lights]] table, or unlit = true"
            )
        return make_scene(
            loaded,
            lights=lights,
            ambient=ambient,
            background=_background(config, stored),
            unlit=config.scene.unlit,
        )


def build_photo(config: Config) -> Photo:
    """The photograph of `[scene.photo]` with its depth.

    Raises:
        ConfigError: a file that cannot be used, or a unit or focal length that is missing.
    """
    table = config.scene.photo
    assert table is not None
    settings = table.model_dump(exclude={"file", "depth", "widest_f_number"})
    try:
        depth = None if table.depth is None else config.reach.file(table.depth, "scene.photo.depth")
        return load_photo(config.reach.file(table.file, "scene.photo.file"), depth=depth, **settings)
    except ValueError as error:
        raise ConfigError(str(error)) from error


def build_camera(config: Config) -> Camera:
    """The camera of `[camera]`.

    Raises:
        ConfigError: a pose that is not rigid, or a camera that looks at itself.
    """
    table = config.camera
    width, height = table.resolution
    size = {
        "width": width,
        "height": height,
        "sensor_width": table.sensor_width_mm / 1000,
        "focal_length": None if table.focal_length_mm is None else table.focal_length_mm / 1000,
        "shift": table.shift_mm / 1000,
        "rise": table.rise_mm / 1000,
        "field_of_view": None if table.field_of_view_deg is None else math.radians(table.field_of_view_deg),
    }
    with located(config.source):
        if table.matrix is not None:
            return make_camera(np.asarray(table.matrix), **size)
        assert table.position is not None
        assert table.look_at is not None
        position, target, up = (np.asarray(v, dtype=float) for v in (table.position, table.look_at, table.up))
        return look_at(position, target, up, **size)


def build_lens(config: Config, camera: Camera, *, solved: bool) -> ThinLens | TiltShiftLens:
    """The lens of `[lens]`, as it is before solving.

    Args:
        config: what to build from.
        camera: of `build_camera`, whose focal length makes an f-number a radius.
        solved: whether a solve will set the focus distance, so that none has to be given.

    Raises:
        ConfigError: no focus distance without a solve, or one within the focal length; a tilt beyond what
            the lens can do.
    """
    table = config.lens
    distance = math.inf if table.focus_distance_m is None else table.focus_distance_m
    if table.sharp_from_m is not None:
        assert table.sharp_to_m is not None
        limits = config.solve.f_number_min, config.solve.f_number_max
        with located(config.source):
            deep = depth_of_field_lens(camera, table.sharp_from_m, table.sharp_to_m, f_number_range=limits)
            return dataclasses.replace(deep, aperture=build_aperture(config))
    if table.focus_distance_m is None and table.focal_surface is None and not solved:
        raise ConfigError(
            f"{config.source}: lens.focus_distance_m is missing; give it, or solve for it with `focusjax run`"
        )
    with located(config.source):
        aperture = build_aperture(config)
        if table.close_focus != "ignored":
            assert table.f_number is not None
            return close_focus_lens(
                camera,
                table.close_focus,
                focus_distance=distance,
                f_number=table.f_number,
                aperture=aperture,
            )[1]
        settings = {
            "focus_distance": distance,
            "focal_length": float(camera.focal_length),
            "f_number": table.f_number,
            "aperture_radius": None if table.aperture_radius_mm is None else table.aperture_radius_mm / 1000,
            "aperture": aperture,
        }
        if not (table.tilt_deg or table.swing_deg):
            return thin_lens(**settings)
        angles = math.radians(table.tilt_deg), math.radians(table.swing_deg)
        return tilt_shift_lens(tilt=angles[0], swing=angles[1], **settings)


def _object(table: ObjectTable, number: int, config: Config) -> SceneObject:
    overrides = {
        "colour": table.colour,
        "emission": table.emission,
        "specular": table.specular,
        "shininess": table.shininess,
        "reflectance": table.reflectance,
        "opacity": table.opacity,
        "smooth_angle": table.smooth_angle_deg,
    }
    path = config.reach.file(table.file, f"scene.objects.{number}.file")
    try:
        return load_mesh(
            path,
            within=config.reach.folders(table.file),
            name=table.name or f"{Path(table.file).stem}",
            translate=table.translate,
            rotate=table.rotate_deg,
            scale=table.scale,
            **{key: value for key, value in overrides.items() if value is not None},
        )
    except ValueError as error:
        key = ".scale" if isinstance(error, ArgumentError) and error.argument == "scale" else ""
        raise ValueError(f"scene.objects.{number}{key}: {error}") from error


def _light(table: DirectionalTable | PointTable) -> AbstractLight:
    if isinstance(table, DirectionalTable):
        return directional_light(table.direction, table.colour)
    return point_light(table.position, table.intensity)


def _background(config: Config, stored: StoredScene | None) -> AbstractBackground:
    if (
        stored is not None
        and stored.background is not None
        and "background" not in config.scene.model_fields_set
    ):
        return constant_background(stored.background)
    background = config.scene.background
    if isinstance(background, ConstantTable):
        return constant_background(background.colour)
    if isinstance(background, GradientTable):
        return gradient_background(background.bottom, background.horizon, background.top)
    path = config.reach.file(background.file, "scene.background.file")
    with about_key("scene.background"):
        return image_background(path, gain=background.gain, turn=background.turn_deg)


def faces_of(scene: Scene, name: str, key: str) -> range:
    """The faces of the object `name` that a config asks for by `key`.

    Raises:
        ValueError: there is no such object; the message names the key, and the nearest name.
    """
    with about_key(key):
        return scene.face_range(name)
