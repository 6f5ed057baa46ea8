"""The exposure and film tables of a config, in a photographer's units."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax._words import did_you_mean
from focusjax.config._values import NotNegative, Number, Positive, Table, Time
from focusjax.film import MOST_STOPS, film_names, luminance_of_light_value

Speed = Annotated[float, Field(ge=1, le=1e7)]
Pixel = Annotated[int, Field(ge=0)]
Extent = Annotated[int, Field(ge=1)]


class ZoneTable(Table):
    """`[[exposure.zones]]`: a part of the picture, and how bright it is to be."""

    box: Annotated[tuple[Pixel, Pixel, Extent, Extent], Strict(False)] = Field(
        description="a box [left, top, width, height] in pixels, for example [100, 80, 40, 40]"
    )
    stops: Number = Field(default=0.0, description="how far above grey it is to be in stops, for example 1")
    weight: Positive = Field(default=1.0, description="how much it counts against other zones")


class ExposureTable(Table):
    """`[exposure]`: what is set on the camera beside the lens; what is left out is chosen."""

    light_ev: Annotated[Number, Field(ge=-30, le=50)] | None = Field(
        default=None,
        description="the exposure value of the light at ISO 100: sun 15, overcast 12, a room 7, a street 3",
    )
    luminance_cd_m2: Positive | None = Field(
        default=None, description="the luminance of radiance 1 in cd/m^2, for example 4000"
    )
    time: Time | None = Field(default=None, description='the shutter time in seconds, for example "1/60"')
    iso: Speed | None = Field(default=None, description="the ISO speed, from 1 to 10000000, for example 400")
    transmittance: Annotated[float, Field(gt=0, le=1)] = Field(
        default=1.0, description="the share of the light that the glass lets through, for example 0.9"
    )
    meter: Literal["average", "centre"] | None = Field(
        default=None, description='"average" or "centre"; or [[exposure.zones]]'
    )
    zones: Annotated[tuple[ZoneTable, ...], Strict(False)] = Field(
        default=(), description="[[exposure.zones]] tables"
    )
    compensation: Annotated[Number, Field(ge=-MOST_STOPS, le=MOST_STOPS)] | None = Field(
        default=None, description="by how many stops the picture is to be brighter, for example -0.5"
    )
    longest_time: Time | None = Field(
        default=None, description='the longest time that may be chosen, for example "1/60"'
    )
    shortest_time: Time | None = Field(
        default=None, description='the shortest time that may be chosen, for example "1/4000"'
    )
    iso_min: Speed | None = Field(
        default=None, description="the lowest speed that may be chosen, for example 100"
    )
    iso_max: Speed | None = Field(
        default=None, description="the highest speed that may be chosen, for example 6400"
    )

    priority: Literal["focus", "exposure"] | None = Field(
        default=None,
        description='"focus" or "exposure", what goes first where they want different f-numbers',
    )

    @property
    def luminance(self) -> float:
        """Of radiance 1, in cd/m^2."""
        if self.luminance_cd_m2 is not None:
            return self.luminance_cd_m2
        assert self.light_ev is not None
        return float(luminance_of_light_value(self.light_ev))

    @property
    def free(self) -> tuple[str, ...]:
        """What is to be chosen, of "time" and "iso"."""
        return tuple(name for name in ("time", "iso") if getattr(self, name) is None)

    @model_validator(mode="after")
    def _light_known_and_nothing_idle(self) -> "ExposureTable":
        if (self.light_ev is None) == (self.luminance_cd_m2 is None):
            raise ValueError("needs exactly one of light_ev and luminance_cd_m2")
        if self.meter is not None and self.zones:
            raise ValueError("has a meter and zones; give one or the other")
        limits = {
            "longest_time": self.time, "shortest_time": self.time, "iso_min": self.iso, "iso_max": self.iso,
        }  # fmt: skip
        for key, given in limits.items():
            if getattr(self, key) is not None and given is not None:
                raise ValueError(f"has {key}, a limit to what is given anyway; leave one of the two out")
        if not self.free:
            for key in ("meter", "zones", "compensation", "priority"):
                if getattr(self, key):
                    raise ValueError(
                        f"has time, iso and {key}, which only a chosen exposure has; leave one out"
                    )
        for low, high in (("shortest_time", "longest_time"), ("iso_min", "iso_max")):
            least, most = getattr(self, low), getattr(self, high)
            if least is not None and most is not None and least > most:
                raise ValueError(f"has {low} = {least:g}, which is above {high} = {most:g}; swap the two")
        return self


class NoiseTable(Table):
    """`[film.noise]`: of a sensor's pixels."""

    full_well: Positive = Field(
        description="the electrons that a pixel holds at the base speed, for example 40000"
    )
    read_noise: NotNegative = Field(
        default=0.0, description="the noise of reading in electrons, for example 3"
    )
    base_iso: Speed = Field(
        default=100.0, description="the speed at which a pixel is filled, for example 100"
    )


class FilmTable(Table):
    """`[film]`: what the light falls on."""

    preset: str | None = Field(default=None, description=f"one of {', '.join(film_names())}")
    curve: str | None = Field(
        default=None, description="a file with the film's response curve, instead of a preset"
    )
    paper: str | None = Field(
        default=None, description="a file with the curve of the paper that the film is printed on"
    )
    black_and_white: bool = Field(default=False, description="true for a film that sees no colour")
    rms_granularity: NotNegative | None = Field(
        default=None, description="the film's RMS granularity, for grain, for example 8"
    )
    noise: NoiseTable | None = Field(default=None, description="a [film.noise] table, of a sensor")
    kelvin: Annotated[float, Field(ge=2000, le=25000)] | None = Field(
        default=None, description="the temperature of the light that is to be white, for example 3200"
    )
    white_balance: Literal["grey_world"] | Annotated[tuple[Positive, ...], Strict(False)] | None = Field(
        default=None, description='gains of [red, green, blue], or "grey_world"'
    )

    @property
    def is_sensor(self) -> bool:
        """Whether it is a sensor, which has noise and no grain."""
        return self.curve is None and self.preset in (None, "plain")

    @model_validator(mode="after")
    def _one_film(self) -> "FilmTable":
        if self.preset is not None and self.preset not in film_names():
            hint = did_you_mean(self.preset, film_names(), f"there are {', '.join(film_names())}")
            raise ValueError(f'has preset = "{self.preset}", which is no film; {hint}')
        if self.preset is not None and self.curve is not None:
            raise ValueError("has a preset and a curve; give one or the other")
        for key in ("paper", "black_and_white"):
            if getattr(self, key) and self.curve is None:
                raise ValueError(f"has {key} without a curve; give both, or a preset that has it")
        if self.rms_granularity is not None and self.is_sensor:
            raise ValueError("has rms_granularity, but a sensor has no grain; choose a film, or [film.noise]")
        if self.noise is not None and not self.is_sensor:
            raise ValueError('has noise, but film has none; give rms_granularity, or preset = "plain"')
        if self.kelvin is not None and self.white_balance is not None:
            raise ValueError("has kelvin and white_balance; give one or the other")
        if isinstance(self.white_balance, tuple) and len(self.white_balance) != 3:
            raise ValueError(f"has {len(self.white_balance)} gains as white_balance; give 3")
        return self
