"""The focal surface's tables of a config."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._values import NotNegative, Number, Positive, Table
from focusjax.config._wishes import PlaceTable

Exponent = Annotated[float, Field(ge=0.5, le=4, description="an exponent of the distance from 0.5 to 4")]


class ControlPointTable(PlaceTable):
    """`[[lens.focal_surface.points]]`: a place that the surface passes, at a wished blur."""

    name: str | None = Field(default="", description="a name for error messages")
    blur_px: Number = Field(
        default=0.0,
        description="the blur wished there, positive where the place is to be behind the focus",
    )
    aperture_scale: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(
        default=1.0, description="the aperture there in apertures of the lens; 0.5 halves all blur"
    )
    weight: NotNegative = Field(default=1.0, description="how widely the point rules, 0 or more")

    even_outside: bool = Field(
        default=False, description="true to let the point count even outside the frame"
    )
    even_hidden: bool = Field(
        default=False, description="true to let the point count in full even when something hides it"
    )


class InverseDistanceTable(Table):
    """Influence that is felt everywhere."""

    kind: Literal["inverse_distance"]
    exponent: Exponent = 2.0


class GaussianTable(Table):
    """Influence that ends softly."""

    kind: Literal["gaussian"]
    width_px: Positive = Field(description="the standard deviation in pixels")
    exponent: Exponent = 2.0


class WendlandTable(Table):
    """Influence that ends at a radius."""

    kind: Literal["wendland"]
    radius_px: Positive = Field(description="the radius in pixels where influence ends")
    exponent: Exponent = 2.0


class FocalSurfaceTable(Table):
    """`[lens.focal_surface]`: focus that differs from place to place."""

    points: Annotated[tuple[ControlPointTable, ...], Strict(False), Field(min_length=1)] = Field(
        description="[[lens.focal_surface.points]] tables"
    )
    basis: Literal["constant", "affine", "quadratic"] = Field(
        default="constant", description='"constant", "affine" or "quadratic"'
    )
    kernel: Annotated[InverseDistanceTable | GaussianTable | WendlandTable, Field(discriminator="kind")] = (
        Field(
            default=InverseDistanceTable(kind="inverse_distance"),
            description='how influence falls off, for example {kind = "inverse_distance", exponent = 3}',
        )
    )
    smoothness: NotNegative = Field(
        default=1e-3,
        description="the weight of a blur that changes by 1 px per 100 px, against wishes, for example 0.001",
    )

    favour_near: NotNegative = Field(
        default=0.0,
        description="how much more near points count where several overlap: 1 makes the nearest count twice",
    )

    @model_validator(mode="after")
    def _some_weight(self) -> "FocalSurfaceTable":
        if not any(point.weight > 0 for point in self.points):
            raise ValueError("has only points of weight 0; give at least one a positive weight")
        return self
