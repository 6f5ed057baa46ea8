"""The tables of a config that say what the lens's opening looks like, and what it does beyond focusing."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._glass import GlassTable
from focusjax.config._values import NotNegative, Number, Positive, Table

Profile = Annotated[tuple[Number, ...], Strict(False), Field(min_length=2)]
OfColours = Annotated[tuple[Number, Number, Number], Strict(False)]
SizeOfColours = Annotated[tuple[Positive, Positive, Positive], Strict(False)]

_LINE_D_NM = 587.56
"""The wavelength of n_d (the yellow line of helium)."""


class OpeningTable(Table):
    """What any opening has."""

    squeeze: Annotated[float, Field(ge=1, le=4)] = Field(
        default=1.0, description="how many times narrower than high, from 1 (not) to 4, for example 1.5"
    )


class OutlineTable(OpeningTable):
    """What an opening with an outline has."""

    obstruction: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.0, description="the share of the diameter that is covered in the middle, for example 0.4"
    )
    transmission: Annotated[tuple[NotNegative, ...], Strict(False), Field(min_length=2)] | None = Field(
        default=None,
        description="light let through from the middle to the rim, two or more numbers as [1, 0.6, 0.1]",
    )


class DiskTable(OutlineTable):
    """A round opening."""

    shape: Literal["disk"]


class PolygonTable(OutlineTable):
    """An opening of straight or rounded blades."""

    shape: Literal["polygon"]
    blades: Annotated[int, Field(ge=3, le=64)] = Field(description="the number of blades, 3 or more")
    rotation_deg: Number = Field(
        default=0.0, description="the first corner's angle in degrees, clockwise from +x"
    )
    roundness: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.0, description="a roundness from 0 (straight blades) to 1 (a circle)"
    )


class ImageTable(OpeningTable):
    """An opening that is an image."""

    shape: Literal["image"]
    file: str = Field(description="an image file, white where light passes")


class SeidelTable(Table):
    """`[lens.seidel]`: third-order aberrations.

    In pixels at the opening that the lens has in the picture, whatever it is; or as a wavefront, in
    micrometres or in waves, at a stated f-number and height, from which they grow by the third-order laws.
    """

    w040_px: Number = Field(default=0.0, description="spherical aberration, under-corrected above 0")
    w131_px: Number = Field(
        default=0.0, description="coma in pixels, tails towards the picture's middle above 0"
    )
    w222_px: Number = Field(default=0.0, description="astigmatism in pixels")
    w220_px: Number = Field(default=0.0, description="field curvature in pixels, corners nearer above 0")
    w311_px: Number = Field(default=0.0, description="distortion in pixels, barrel above 0")
    w040_um: Number = Field(default=0.0, description="spherical aberration of the wavefront in micrometres")
    w131_um: Number = Field(default=0.0, description="coma of the wavefront in micrometres")
    w222_um: Number = Field(default=0.0, description="astigmatism of the wavefront in micrometres")
    w220_um: Number = Field(default=0.0, description="field curvature of the wavefront in micrometres")
    w311_um: Number = Field(default=0.0, description="distortion of the wavefront in micrometres")
    w040_waves: Number = Field(default=0.0, description="spherical aberration of the wavefront in waves")
    w131_waves: Number = Field(default=0.0, description="coma of the wavefront in waves")
    w222_waves: Number = Field(default=0.0, description="astigmatism of the wavefront in waves")
    w220_waves: Number = Field(default=0.0, description="field curvature of the wavefront in waves")
    w311_waves: Number = Field(default=0.0, description="distortion of the wavefront in waves")
    wavelength_nm: Positive | None = Field(
        default=None,
        ge=100,
        le=20_000,
        description="the wavelength of the waves in nanometres; 587.56 (d) if left out",
    )
    f_number: Positive | None = Field(
        default=None, description="the f-number for which the wavefront is, for example 2"
    )
    height_mm: Positive | None = Field(
        default=None,
        description="the height on the sensor for which the wavefront is; half its diagonal if left out",
    )

    def in_unit(self, unit: str) -> dict[str, float]:
        """The coefficients that are given in "px", "um" or "waves", by their names."""
        return {
            key.removesuffix(f"_{unit}"): getattr(self, key)
            for key in type(self).model_fields
            if key.endswith(f"_{unit}") and key in self.model_fields_set
        }

    def wavefront(self) -> dict[str, float]:
        """The coefficients of the wavefront in metres, by their names; none where they are in pixels."""
        wave = 1e-9 * (self.wavelength_nm or _LINE_D_NM)
        lengths = {name: 1e-6 * value for name, value in self.in_unit("um").items()}
        return lengths | {name: wave * value for name, value in self.in_unit("waves").items()}

    @model_validator(mode="after")
    def _one_unit(self) -> "SeidelTable":
        given = [f"{min(names)}_{unit}" for unit in ("px", "um", "waves") if (names := self.in_unit(unit))]
        if len(given) > 1:
            raise ValueError(
                f"has {given[0]} and {given[1]}; give all coefficients in pixels, in micrometres or in waves"
            )
        if self.wavefront() and self.f_number is None:
            raise ValueError(f"has {given[0]} without the f_number that it is for; give f_number, too")
        if self.wavelength_nm is not None and not self.in_unit("waves"):
            raise ValueError("has wavelength_nm, but no coefficient in waves; give one, or leave it out")
        idle = [key for key in ("f_number", "height_mm") if getattr(self, key) is not None]
        if idle and not self.wavefront():
            raise ValueError(
                f"has {idle[0]}, but no coefficient in micrometres or waves; give one, or leave it out"
            )
        return self


class ColourTable(Table):
    """`[lens.colour]`: what differs between red, green and blue."""

    focus_offset: OfColours = Field(
        default=(0.0, 0.0, 0.0),
        description="dioptres (1/m) by which [red, green, blue] focus nearer, for example [-0.02, 0, 0.02]",
    )
    glass: GlassTable | None = Field(
        default=None,
        description="a thin lens's glass, which gives the focus offsets, such as {n = [1.51, 1.52, 1.53]}",
    )
    magnification: SizeOfColours = Field(
        default=(1.0, 1.0, 1.0),
        description="the sizes of the [red, green, blue] pictures, for example [1.002, 1, 0.998]",
    )
    bands: Annotated[int, Field(ge=3, le=15)] = Field(
        default=3, description="the number of colours traced, odd, 3 to 15"
    )

    @model_validator(mode="after")
    def _odd(self) -> "ColourTable":
        if self.bands % 2 == 0:
            raise ValueError(f"has {self.bands} bands; give an odd number")
        return self

    @model_validator(mode="after")
    def _one_dispersion(self) -> "ColourTable":
        if self.glass is not None and "focus_offset" in self.model_fields_set:
            raise ValueError("has focus_offset and a glass, which gives it; leave one of them out")
        return self


class CurvaturePointTable(Table):
    """`[[lens.field_curvature]]`: by how much the focus is nearer at a place in the picture."""

    pixel: Annotated[tuple[Number, Number], Strict(False)] = Field(
        description="a place [x, y] in the picture, in pixels from the top left"
    )
    offset: Number = Field(description="dioptres (1/m) by which the focus is nearer there, for example 0.1")


class CatsEyesTable(Table):
    """`[lens.cats_eyes]`: a second disk that rays have to pass."""

    corner_shift: Number = Field(
        description="how far the disk is shifted in the corners in aperture radii, for example 0.7"
    )
    disk: Positive = Field(default=1.1, description="the disk's radius in aperture radii, for example 1.1")


class HoodTable(Table):
    """`[lens.hood]`: the round mouth of a hood, or of another tube ahead of the lens."""

    diameter_mm: Positive = Field(description="the diameter of the hood's mouth in mm, for example 60")
    length_mm: Positive = Field(
        description="how far in mm the mouth is from the lens's entrance pupil, for example 50"
    )


class FalloffTable(Table):
    """`[lens.falloff]`: light towards the corners, as a table."""

    heights_mm: Annotated[tuple[NotNegative, ...], Strict(False), Field(min_length=2)] = Field(
        description="distances from the axis on the sensor in mm, from 0 on, for example [0, 10, 22]"
    )
    shares: Annotated[tuple[NotNegative, ...], Strict(False), Field(min_length=2)] = Field(
        description="the shares of the axis's light there, for example [1, 0.9, 0.5]"
    )
    extrapolate: bool = Field(
        default=False, description="true to go on beyond a table that does not reach the corners"
    )


class ProfileTable(Table):
    """`[lens.profile]`: what a data sheet says of a lens, in a file."""

    name: str | None = Field(default=None, description="the name of a lens profile that comes along")
    file: str | None = Field(default=None, description="a lens profile (.toml), or a lensfun database (.xml)")
    lens: str | None = Field(default=None, description="which lens of a lensfun database")
    colour: bool = Field(default=True, description="false to trace all colours alike")
    extrapolate: bool = Field(
        default=False, description="true to go on beyond tables that do not reach the corners"
    )

    @model_validator(mode="after")
    def _one_profile(self) -> "ProfileTable":
        if (self.name is None) == (self.file is None):
            raise ValueError("needs exactly one of name and file")
        database = self.file is not None and self.file.lower().endswith(".xml")
        if database != (self.lens is not None):
            wrong = "has a lensfun file and no lens" if database else "has a lens and no lensfun file (.xml)"
            raise ValueError(f"{wrong}; the one says which of the other's lenses is meant")
        return self


class Look(Table):
    """Keys of `[lens]` that aim at no wish: they act on the picture, of whatever lens is solved for."""

    profile: ProfileTable | None = Field(default=None, description="a [lens.profile] table")
    power_profile: Profile | None = Field(
        default=None,
        description="dioptres (1/m) by which zones of the lens focus nearer, from its middle to its rim",
    )
    seidel: SeidelTable | None = Field(default=None, description="a [lens.seidel] table")
    colour: ColourTable | None = Field(default=None, description="a [lens.colour] table")
    field_curvature: Annotated[tuple[CurvaturePointTable, ...], Strict(False)] = Field(
        default=(), description="[[lens.field_curvature]] tables"
    )
    cats_eyes: CatsEyesTable | None = Field(default=None, description="a [lens.cats_eyes] table")
    hood: HoodTable | None = Field(default=None, description="a [lens.hood] table")
    natural_falloff: bool = Field(
        default=False, description="true to let light fall off to the corners as cos^4"
    )
    falloff: FalloffTable | None = Field(default=None, description="a [lens.falloff] table")

    @property
    def look(self) -> list[str]:
        """The keys of these that are set."""
        return [key for key in Look.model_fields if getattr(self, key)]

    @model_validator(mode="after")
    def _one_falloff(self) -> "Look":
        if self.natural_falloff and self.falloff is not None:
            raise ValueError(
                "has natural_falloff and a falloff table, which has it already; give one of them"
            )
        return self
