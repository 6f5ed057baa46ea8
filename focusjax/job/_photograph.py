"""What the camera makes of a run's picture: exposed, developed, and described in a photographer's words."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Float

from focusjax.config import (
    Config,
    ExposureTable,
    build_balance,
    build_choices,
    build_film,
    build_zones,
    located,
)
from focusjax.film import (
    WIDEST_F_NUMBER,
    AbstractFilm,
    CameraSettings,
    ChosenSettings,
    choose_settings,
    develop,
    expose,
    meter,
    photograph,
    settings_through,
)
from focusjax.geometry import Camera
from focusjax.lens import CloseFocus, ThinLens, TiltShiftLens

_WHITE = 1.0 - 1e-3
"""Of display light, from which on a channel shows nothing more."""


@dataclass(frozen=True)
class Photograph:
    """A developed picture.

    Attributes:
        image: display light [h, w, 3], 1 is white.
        pinhole: the sharp view, exposed and developed in the same way.
        settings: what was set on the camera; None without an `[exposure]`.
        luminance: of radiance 1, in cd/m^2; None without an `[exposure]`.
        metered: radiance that was to be grey; None where nothing was chosen.
        chosen: how that went; None where nothing was chosen.
        white_share: share of the picture's channels that are as bright as can be shown.
        weighed: which of focus and exposure gave way, and by how much; None where neither had to.
    """

    image: Float[Array, "h w 3"]
    pinhole: Float[Array, "h w 3"]
    settings: CameraSettings | None
    luminance: float | None
    metered: float | None
    chosen: ChosenSettings | None
    white_share: float
    weighed: str | None = None

    def sentence(self) -> str | None:
        """What gave way, or what keeps the exposure from being right; None when nothing did."""
        chosen = self.chosen
        if self.weighed is not None:
            return self.weighed
        if chosen is None or not chosen.limits:
            return None
        off, right = float(chosen.stops_off), float(chosen.right_f_number())
        remedy = (
            f"f/{right:.2g} would be right"
            if right >= WIDEST_F_NUMBER
            else "no f-number would be right, so let it have more light, or wider limits"
        )
        return (
            f"The picture is {abs(off):.1f} stops too {'dark' if off < 0 else 'bright'} at the"
            f" {' and the '.join(chosen.limits)}; {remedy}."
        )


@dataclass(frozen=True)
class Development:
    """How pictures of one config are exposed and developed.

    Attributes:
        film: film or sensor.
        balance: gains of red, green and blue; None for none.
        exposure: the `[exposure]`; without it a radiance of 0.18 is grey.
        stops: by which pictures are brightened without an `[exposure]`.
        seed: of grain and noise.
        close_focus: the model by which the f-number that is set, and the light that is lost, are found.
    """

    film: AbstractFilm
    balance: Float[Array, "3"] | None
    exposure: ExposureTable | None
    stops: float
    seed: int
    close_focus: CloseFocus = "ignored"

    def settings(self, camera: Camera, lens: ThinLens | TiltShiftLens) -> CameraSettings | None:
        """Those of `[exposure]` on a lens, with 1 s and ISO 100 for what is left out; None without it.

        Raises:
            ValueError: a lens that exposes nothing.
        """
        table = self.exposure
        if table is None:
            return None
        return settings_through(
            lens,
            camera,
            time=table.time or 1.0,
            iso=table.iso or 100.0,
            transmittance=table.transmittance,
            close_focus=self.close_focus,
        )

    def shown(
        self, image: Float[Array, "h w 3"], camera: Camera, settings: CameraSettings | None
    ) -> Float[Array, "h w 3"]:
        """Display light of a picture of radiance."""
        size = float(camera.sensor_width)
        if settings is None or self.exposure is None:
            signal = expose(image, self.stops)
            return develop(signal, self.film, balance=self.balance, sensor_width=size, seed=self.seed)
        return photograph(
            image,
            settings,
            self.film,
            luminance=self.exposure.luminance,
            balance=self.balance,
            sensor_width=size,
            seed=self.seed,
        )


def find_development(config: Config, image: Float[Array, "h w 3"] | None = None) -> Development | None:
    """What `[exposure]` and `[film]` say; None when the config has neither.

    Args:
        config: what is asked for.
        image: radiance that a white balance is found for; without it one that needs a picture is refused.

    Raises:
        ConfigError: a film that cannot be used.
    """
    if config.exposure is None and config.film is None:
        return None
    return Development(
        film=build_film(config),
        balance=build_balance(config, image),
        exposure=config.exposure,
        stops=config.render.exposure,
        seed=config.render.seed,
        close_focus=config.lens.close_focus,
    )


def metered_radiance(
    exposure: ExposureTable, balance: Float[Array, "3"] | None, image: Float[Array, "h w 3"]
) -> float:
    """The radiance that `[exposure]` makes grey, after a white balance.

    Raises:
        ValueError: zones that are not in the picture.
    """
    seen = image if balance is None else image * balance.astype(image.dtype).reshape(1, 1, 3)
    return float(meter(seen, *build_zones(exposure)))


def take_photograph(
    config: Config,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    image: Float[Array, "h w 3"],
    pinhole: Float[Array, "h w 3"],
    *,
    grey: float | None = None,
    weighed: str | None = None,
) -> Photograph | None:
    """Expose and develop as `[exposure]` and `[film]` say; None when the config has neither.

    Args:
        config: what is asked for.
        camera: frame and sensor.
        lens: whose f-number and focus expose.
        image: radiance through the lens.
        pinhole: radiance with everything sharp.
        grey: radiance that was metered before; metered in `image` if None.
        weighed: what gave way, of focus and exposure.

    Raises:
        ConfigError: settings that no camera has, or nothing to meter.
    """
    development = find_development(config, image)
    if development is None:
        return None
    metered, chosen = None, None
    with located(config.source, "exposure"):
        settings = development.settings(camera, lens)
        if config.exposure is not None and config.exposure.free:
            assert settings is not None
            metered = grey
            if metered is None:
                metered = metered_radiance(config.exposure, development.balance, image)
            chosen = choose_settings(metered, settings, **build_choices(config.exposure))
            settings = chosen.settings
    shown, sharp = (development.shown(each, camera, settings) for each in (image, pinhole))
    white = float(np.mean(np.asarray(shown) >= _WHITE))
    luminance = None if config.exposure is None else config.exposure.luminance
    return Photograph(shown, sharp, settings, luminance, metered, chosen, white, weighed)
