"""From a config's focal surface to its control points and what they make."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax.config._build_wishes import place_of
from focusjax.config._errors import ConfigError, located
from focusjax.config._focal_surface import ControlPointTable, GaussianTable, WendlandTable
from focusjax.config._load import Config
from focusjax.focus import Blur, FocusPoint, ImagePoints
from focusjax.geometry import Camera
from focusjax.lens import (
    AbstractKernel,
    FocalSurface,
    GaussianFade,
    InverseDistance,
    ThinLens,
    WendlandFade,
    focal_surface,
)
from focusjax.scene import Scene


def build_control_points(config: Config, scene: Scene, *, samples: int = 1) -> tuple[FocusPoint, ...]:
    """The places of `[[lens.focal_surface.points]]`, with the signed blur wished there.

    Args:
        config: has a focal surface.
        scene: what the places are in.
        samples: points of an object or a mask, whose mean a control point may be (`one_row_each`).

    Raises:
        ConfigError: no focal surface, or an object that does not exist.
    """
    table = config.lens.focal_surface
    if table is None:
        raise ConfigError(f"{config.source}: there is no [lens.focal_surface] table; add one")
    with located(config.source):
        return tuple(
            _control_point(point, number, scene, config, samples) for number, point in enumerate(table.points)
        )


def build_focal_surface(
    config: Config,
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens,
    *,
    aperture_scale: Float[np.ndarray, "k"] | None = None,
) -> FocalSurface:
    """The surface through the control points, found in the picture as `points`.

    A point of wished blur d and disparity w is passed at w + d / (2 f E s), where it has that blur. Its
    weight is its own times what `points` has: less when farther away, and less the more it is hidden, so
    that of points which overlap and contradict each other the near and the visible one wins (Lee10 section
    5.2). Points outside the frame have none, unless `even_outside` is true.

    Args:
        config: has a focal surface.
        points: one row for each control point.
        camera: the pinhole that frames the picture.
        lens: aperture radius and shape.
        aperture_scale: of every control point, instead of the config's.

    Raises:
        ConfigError: a control point behind the camera.
    """
    table = config.lens.focal_surface
    assert table is not None
    for name, note in zip(points.names, points.notes, strict=True):
        if note == "behind the camera":
            raise ConfigError(f"{config.source}: control point {name!r} is {note}; move it, or the camera")
    own = np.array([point.aperture_scale for point in table.points])
    scale = own if aperture_scale is None else aperture_scale
    slope = 2.0 * float(lens.parallax(camera)) * scale
    return focal_surface(
        points.xy,
        np.asarray(points.disparity) + np.asarray(points.target) / slope,
        aperture_scale=scale,
        weight=points.weight,
        kernel=_kernel(config),
        basis=table.basis,
    )


def _control_point(
    table: ControlPointTable, number: int, scene: Scene, config: Config, samples: int
) -> FocusPoint:
    key = f"lens.focal_surface.points.{number}"
    return FocusPoint(
        place_of(table, key, scene, config, samples),
        Blur(table.blur_px, signed=True),
        weight=table.weight,
        name=table.name or key,
        even_outside=table.even_outside,
        even_hidden=table.even_hidden,
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
