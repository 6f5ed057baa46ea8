"""The focal surface's tables of a config."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._values import NotNegative, Number, Positive, Table, Vector

Exponent = Annotated[float, Field(ge=0.5, le=4)]


class ControlPointTable(Table):
    """`[[lens.focal_surface.points]]`: a place that the surface passes, at a wished blur."""

    name: str = Field(default="", description="a name for error messages")
    pixel: Annotated[tuple[Number, Number], Strict(False)] | None = Field(
        default=None, description="a place [x, y] in the picture, in pixels from the top left"
    )
    point: Vector | None = Field(default=None, description="a point [x, y, z] in the world, in metres")
    direction: Vector | None = Field(
        default=None, description="a direction [x, y, z] from the camera, for something infinitely far away"
    )
    triangle: Annotated[int, Field(ge=0)] | None = Field(
        default=None,
        description="a triangle's number, counted in the whole scene, or in `object` when that is given",
    )
    barycentric: Vector | None = Field(
        default=None, description="three weights of the triangle's corners, for example [0.2, 0.3, 0.5]"
    )
    object: str | None = Field(default=None, description="the name of an object in the scene")
    mask: str | None = Field(
        default=None, description="an image file of the picture's size, white on what is meant"
    )
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

    @model_validator(mode="after")
    def _one_place(self) -> "ControlPointTable":
        if (self.triangle is None) != (self.barycentric is None):
            raise ValueError("needs triangle and barycentric together")
        whole = self.object if self.triangle is None else None
        places = (self.pixel, self.point, self.direction, self.triangle, whole, self.mask)
        if sum(place is not None for place in places) != 1:
            raise ValueError(
                "needs exactly one of pixel, point, direction, triangle, object and mask to say where"
            )
        return self


class InverseDistanceTable(Table):
    """Influence that is felt everywhere."""

    kind: Literal["inverse_distance"]
    exponent: Exponent = Field(default=2.0, description="an exponent of the distance from 0.5 to 4")


class GaussianTable(Table):
    """Influence that ends softly."""

    kind: Literal["gaussian"]
    width_px: Positive = Field(description="the standard deviation in pixels")
    exponent: Exponent = Field(default=2.0, description="an exponent of the distance from 0.5 to 4")


class WendlandTable(Table):
    """Influence that ends at a radius."""

    kind: Literal["wendland"]
    radius_px: Positive = Field(description="the radius in pixels where influence ends")
    exponent: Exponent = Field(default=2.0, description="an exponent of the distance from 0.5 to 4")


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
