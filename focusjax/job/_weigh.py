"""A config's focus and light weighed against each other: what `[exposure]`'s priority asks for."""

from collections.abc import Mapping
from typing import Any

from focusjax.config import Config, ConfigError, build_balance, build_choices, located
from focusjax.film import CameraSettings, camera_settings
from focusjax.focus import ImagePoints
from focusjax.geometry import Camera
from focusjax.job._exposed import ExposedLens, ExposedSolution, open_for_light, solve_exposed
from focusjax.job._photograph import metered_radiance
from focusjax.layers import peel
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.post import closed_lens
from focusjax.scene import Scene
from focusjax.trace import render_pinhole


def metered_before(config: Config, scene: Scene, camera: Camera) -> float:
    """What the meter reads off the sharp view, before there is a lens.

    Raises:
        ConfigError: nothing to meter.
    """
    assert config.exposure is not None
    layers = peel(scene, camera, closed_lens(), supersampling=1, max_layers=config.render.max_layers)
    view = render_pinhole(layers)
    with located(config.source, "exposure"):
        return metered_radiance(config.exposure, build_balance(config, view), view)


def weighed_solution(
    config: Config,
    options: Mapping[str, Any],
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    grey: float,
) -> ExposedSolution:
    """The lens for the wishes and the light; arguments as of `solve_exposed`.

    Raises:
        ConfigError: an exposure that cannot be chosen.
    """
    return solve_exposed(points, camera, lens, grey, **_exposing(config, grey), **options)


def weighed_depth(config: Config, camera: Camera, lens: ThinLens, grey: float) -> ExposedLens:
    """The lens of a given depth of field, opened as far as the light takes where exposure goes first.

    Raises:
        ConfigError: an exposure that cannot be chosen.
    """
    limits = config.solve.f_number_min, config.solve.f_number_max
    return open_for_light(lens, camera, grey, **_exposing(config, grey), f_number_range=limits)


def _exposing(config: Config, grey: float) -> dict[str, Any]:
    """What `[exposure]` says, as arguments."""
    table = config.exposure
    assert table is not None
    if not grey > 0.0:
        raise ConfigError(
            f"{config.source}: exposure: the metered radiance is {grey:g}; meter where there is light"
        )
    settings: CameraSettings = camera_settings(
        f_number=1.0, time=table.time or 1.0, iso=table.iso or 100.0, transmittance=table.transmittance
    )
    return {"exposure": build_choices(table), "settings": settings, "priority": table.priority}
