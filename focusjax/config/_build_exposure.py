"""From the exposure and film tables of a config to what exposes and develops, units converted."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.config._errors import ConfigError, located
from focusjax.config._exposure import ExposureTable
from focusjax.config._load import Config
from focusjax.film import (
    LUMINANCE,
    AbstractFilm,
    Pattern,
    Zone,
    balance_for,
    film,
    film_preset,
    grey_world_balance,
    load_curve,
    sensor,
)


def build_film(config: Config) -> AbstractFilm:
    """The film or sensor of `[film]`; a sensor without noise where it says nothing.

    Raises:
        ConfigError: a curve that cannot be read, or that is no response.
    """
    table = config.film
    if table is None:
        return sensor()
    with located(config.source):
        if table.is_sensor:
            noise = {} if table.noise is None else dict(table.noise)
            return sensor(**noise)
        if table.preset is not None:
            return film_preset(table.preset, rms_granularity=table.rms_granularity)
        assert table.curve is not None
        return film(
            load_curve(config.reach.file(table.curve, "film.curve")),
            paper=None if table.paper is None else load_curve(config.reach.file(table.paper, "film.paper")),
            rms_granularity=table.rms_granularity,
            sensitivity=LUMINANCE if table.black_and_white else None,
        )


def build_balance(config: Config, image: Float[Array, "h w 3"] | None) -> Float[Array, "3"] | None:
    """The white balance of `[film]`, for a picture of linear radiance; None where there is none.

    Raises:
        ConfigError: one that is found from a picture, without one.
    """
    table = config.film
    if table is None:
        return None
    if table.kelvin is not None:
        return balance_for(table.kelvin)
    if table.white_balance == "grey_world":
        if image is None:
            raise ConfigError(
                f'{config.source}: film.white_balance is "grey_world", which changes from frame to frame;'
                " give gains, or film.kelvin"
            )
        return grey_world_balance(image)
    return None if table.white_balance is None else jnp.asarray(table.white_balance, dtype=float)


def build_zones(table: ExposureTable) -> tuple[Zone | Pattern, ...]:
    """What an `[exposure]` meters."""
    if table.zones:
        return tuple(Zone(zone.box, zone.stops, zone.weight) for zone in table.zones)
    return (table.meter or "average",)


def build_choices(table: ExposureTable) -> dict[str, Any]:
    """The arguments of `choose_settings` that an `[exposure]` gives."""
    given = {
        "compensation": table.compensation,
        "longest_time": table.longest_time,
        "shortest_time": table.shortest_time,
    }
    options: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    lowest, highest = table.iso_min, table.iso_max
    if lowest is not None or highest is not None:
        # The limit that is not given makes room for the one that is.
        lowest = min(100.0, highest or 100.0) if lowest is None else lowest
        highest = max(6400.0, lowest) if highest is None else highest
        options["iso_range"] = (lowest, highest)
    return options | {"free": table.free, "luminance": table.luminance}
