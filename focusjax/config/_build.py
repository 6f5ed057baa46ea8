"""From the tables of a config to the library's own objects, units converted."""

import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from focusjax.config._errors import ConfigError
from focusjax.config._focal_surface import ControlPointTable, GaussianTable, WendlandTable
from focusjax.config._load import Config
from focusjax.config._scene import (
    ConstantTable,
    DirectionalTable,
    GradientTable,
    ObjectTable,
    PointTable,
    SceneTable,
)
from focusjax.config._view import PolygonTable
from focusjax.config._wishes import FocusTable
from focusjax.focus import (
    AtInfinity,
    AtPixel,
    AtPoint,
    Blur,
    FocusPoint,
    ImagePoints,
    OnObject,
    OnTriangle,
    Sharp,
)
from focusjax.geometry import Camera, look_at, make_camera
from focusjax.lens import (
    AbstractAperture,
    AbstractKernel,
    Disk,
    FocalSurface,
    GaussianFade,
    InverseDistance,
    ThinLens,
    TiltShiftLens,
    WendlandFade,
    focal_surface,
    polygon,
    thin_lens,
    tilt_shift_lens,
)
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


def build_scene(config: Config) -> Scene:
    """Load the meshes of `[scene]` and put them together.

    Raises:
        ConfigError: a mesh that cannot be used, or objects that cannot stand together.
    """
    folder = config.source.parent
    try:
        return make_scene(
            [_object(table, number, folder) for number, table in enumerate(config.scene.objects)],
            lights=[_light(table) for table in config.scene.lights],
            ambient=config.scene.ambient,
            background=_background(config.scene, folder),
            unlit=config.scene.unlit,
        )
    except ValueError as error:
        raise _located(error, config) from error


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
    try:
        if table.matrix is not None:
            return make_camera(np.asarray(table.matrix), **size)
        assert table.position is not None
        assert table.look_at is not None
        position, target, up = (np.asarray(v, dtype=float) for v in (table.position, table.look_at, table.up))
        return look_at(position, target, up, **size)
    except ValueError as error:
        raise _located(error, config) from error


def build_lens(config: Config, camera: Camera, *, solved: bool) -> ThinLens | TiltShiftLens:
    """The lens of `[lens]`, as it is before solving.

    Args:
        config: what to build from.
        camera: the camera whose focal length makes an f-number a radius.
        solved: whether a solve will set the focus distance, so that none has to be given.

    Raises:
        ConfigError: no focus distance without a solve, or one within the focal length; a tilt beyond what the
            lens can do, or one with a solve, which sets the focus of a lens that is not tilted.
    """
    table = config.lens
    turned = {"tilt_degrees": table.tilt_degrees, "swing_degrees": table.swing_degrees}
    tilted = [f"lens.{key} is {value:g}" for key, value in turned.items() if value]
    if tilted and solved:
        raise ConfigError(
            f"{config.source}: {tilted[0]}, but a solve sets the focus of a lens that is not tilted; take the"
            " lens as it is with `focusjax render`, or leave the tilt out"
        )
    if table.focus_distance_m is None and table.focal_surface is None and not solved:
        raise ConfigError(
            f"{config.source}: lens.focus_distance_m is missing; give it, or solve for it with `focusjax run`"
        )
    try:
        settings = {
            "focus_distance": math.inf if table.focus_distance_m is None else table.focus_distance_m,
            "focal_length": float(camera.focal_length),
            "f_number": table.f_number,
            "aperture_radius": None if table.aperture_radius_mm is None else table.aperture_radius_mm / 1000,
            "aperture": _aperture(config),
        }
        if not tilted:
            return thin_lens(**settings)
        angles = math.radians(table.tilt_degrees), math.radians(table.swing_degrees)
        return tilt_shift_lens(tilt=angles[0], swing=angles[1], **settings)
    except ValueError as error:
        raise _located(error, config) from error


def build_control_points(config: Config, scene: Scene) -> tuple[FocusPoint, ...]:
    """The places of `[[lens.focal_surface.points]]`, with the signed blur wished there.

    Raises:
        ConfigError: no focal surface, or an object that does not exist.
    """
    table = config.lens.focal_surface
    if table is None:
        raise ConfigError(f"{config.source}: there is no [lens.focal_surface] table; add one")
    try:
        return tuple(_control_point(point, number, scene) for number, point in enumerate(table.points))
    except ValueError as error:
        raise _located(error, config) from error


def build_focal_surface(config: Config, points: ImagePoints, camera: Camera, lens: ThinLens) -> FocalSurface:
    """The surface through the control points, found in the picture as `points`.

    A point of wished blur d and disparity w is passed at w + d / (2 f E s), where it has that blur.
    """
    table = config.lens.focal_surface
    assert table is not None
    scale = np.array([point.aperture_scale for point in table.points])
    slope = 2.0 * float(lens.parallax(camera)) * scale
    return focal_surface(
        points.xy,
        np.asarray(points.disparity) + np.asarray(points.target) / slope,
        aperture_scale=scale,
        weight=np.array([point.weight for point in table.points]),
        kernel=_kernel(config),
        basis=table.basis,
    )


def build_focus_points(config: Config, scene: Scene) -> tuple[FocusPoint, ...]:
    """The wishes of `[[focus]]`.

    Raises:
        ConfigError: no wishes, an object that does not exist, or a triangle beyond its last one.
    """
    if not config.focus:
        raise ConfigError(
            f"{config.source}: there are no focus points; add a [[focus]] table such as"
            f" pixel = [{config.camera.resolution[0] // 2}, {config.camera.resolution[1] // 2}], sharp = true"
        )
    try:
        return tuple(_focus_point(table, number, scene) for number, table in enumerate(config.focus))
    except ValueError as error:
        raise _located(error, config) from error


def _focus_point(table: FocusTable, number: int, scene: Scene) -> FocusPoint:
    return FocusPoint(
        where=_where(table, number, scene),
        wish=Sharp() if table.blur_px is None else Blur(table.blur_px, signed=table.signed),
        weight=table.weight,
        tolerance=table.tolerance_px,
        name=table.name or _default_name(table),
    )


def _where(
    table: FocusTable, number: int, scene: Scene
) -> AtPixel | AtPoint | AtInfinity | OnTriangle | OnObject:
    if table.pixel is not None:
        return AtPixel(*table.pixel)
    if table.point is not None:
        return AtPoint(table.point)
    if table.direction is not None:
        return AtInfinity(table.direction)
    if table.triangle is not None:
        assert table.barycentric is not None
        faces = range(len(scene.faces)) if table.object is None else scene.face_range(table.object)
        if table.triangle >= len(faces):
            where = "the scene" if table.object is None else f"object {table.object!r}"
            raise ValueError(
                f"focus.{number}.triangle is {table.triangle} but {where} has {len(faces)} triangles;"
                f" expected 0 to {len(faces) - 1}"
            )
        return OnTriangle(faces[table.triangle], table.barycentric)
    assert table.object is not None
    scene.face_range(table.object)
    return OnObject(table.object) if table.samples is None else OnObject(table.object, samples=table.samples)


def _control_point(table: ControlPointTable, number: int, scene: Scene) -> FocusPoint:
    if table.pixel is not None:
        where = AtPixel(*table.pixel)
    elif table.point is not None:
        where = AtPoint(table.point)
    else:
        assert table.object is not None
        scene.face_range(table.object)
        where = OnObject(table.object, samples=1)
    return FocusPoint(
        where, Blur(table.blur_px, signed=True), name=table.name or f"lens.focal_surface.points.{number}"
    )


def _kernel(config: Config) -> AbstractKernel:
    assert config.lens.focal_surface is not None
    table = config.lens.focal_surface.kernel
    exponent = jnp.asarray(table.exponent, dtype=float)
    if isinstance(table, GaussianTable):
        return GaussianFade(jnp.asarray(table.width_px, dtype=float), exponent)
    if isinstance(table, WendlandTable):
        return WendlandFade(jnp.asarray(table.radius_px, dtype=float), exponent)
    return InverseDistance(exponent)


def _default_name(table: FocusTable) -> str:
    """What a person would call the place."""
    if table.pixel is not None:
        return f"pixel ({table.pixel[0]:g}, {table.pixel[1]:g})"
    if table.point is not None:
        return f"point ({', '.join(f'{value:g}' for value in table.point)})"
    if table.direction is not None:
        return f"direction ({', '.join(f'{value:g}' for value in table.direction)})"
    if table.triangle is not None:
        return f"triangle {table.triangle}" + (f" of {table.object}" if table.object else "")
    return table.object or ""


def _object(table: ObjectTable, number: int, folder: Path) -> SceneObject:
    overrides = {
        "colour": table.colour,
        "emission": table.emission,
        "specular": table.specular,
        "shininess": table.shininess,
        "reflectance": table.reflectance,
        "opacity": table.opacity,
        "smooth_angle": table.smooth_angle_deg,
    }
    return load_mesh(
        folder / table.file,
        name=table.name or f"{Path(table.file).stem}",
        translate=table.translate,
        rotate=table.rotate_deg,
        scale=table.scale,
        **{key: value for key, value in overrides.items() if value is not None},
    )


def _light(table: DirectionalTable | PointTable) -> AbstractLight:
    if isinstance(table, DirectionalTable):
        return directional_light(table.direction, table.colour)
    return point_light(table.position, table.intensity)


def _background(table: SceneTable, folder: Path) -> AbstractBackground:
    background = table.background
    if isinstance(background, ConstantTable):
        return constant_background(background.colour)
    if isinstance(background, GradientTable):
        return gradient_background(background.bottom, background.horizon, background.top)
    return image_background(folder / background.file, gain=background.gain, turn=background.turn_deg)


def _aperture(config: Config) -> AbstractAperture:
    table = config.lens.aperture
    if isinstance(table, PolygonTable):
        return polygon(table.blades, rotation=math.radians(table.rotation_deg), roundness=table.roundness)
    return Disk()


def _located(error: ValueError, config: Config) -> ConfigError:
    """The same sentence, with the file it is about."""
    return ConfigError(f"{config.source}: {error}")
