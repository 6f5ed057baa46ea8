"""The render table of a config."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from focusjax.config._values import Number, Positive, Table
from focusjax.trace import decibels_of

_FINE = 40.0
"""Decibels from which on one layer sample per pixel may leave more error than the rays."""


class RenderTable(Table):
    """`[render]`: how carefully the picture is made, and how it is shown."""

    method: Literal["trace", "post", "auto"] = Field(
        default="trace",
        description="'trace', 'post' to blur one sharp view instead of tracing rays, or 'auto' for the"
        " quicker of those that reach the quality",
    )
    rays: Annotated[int, Field(ge=1, le=65536)] = Field(
        default=64,
        description="lens rays per pixel on the average, for example 64; places to look at with 'post'",
    )
    smooth: bool = Field(
        default=True,
        description="false to leave the noise of few rays in what is blurred",
    )
    quality: str | Number | None = Field(
        default=None, description="'draft', 'good', 'reference' or decibels such as '40 dB', instead of rays"
    )
    supersampling: Annotated[int, Field(ge=1, le=8)] = Field(
        default=1, description="layer samples along each side of a pixel, 1 to 8; 2 for a quality above 40 dB"
    )
    max_layers: Annotated[int, Field(ge=1, le=64)] = Field(
        default=16, description="the most layers to peel, up to 64; slabs have none"
    )
    slabs: Annotated[int, Field(ge=1, le=1024)] | None = Field(
        default=None, description="how many slabs of depth to cut instead of peeling, for example 16"
    )
    slab_blur_px: Positive | None = Field(
        default=None, description="by how much blur may change within a slab in px, instead of slabs"
    )
    examine_layers: bool = Field(
        default=False, description="true to report what the layers miss, and what the umbra spares them"
    )
    view_dependent: bool = Field(
        default=False, description="true to let every lens ray see highlights and mirrors for itself"
    )
    pixel_filter: Literal["box", "tent", "gaussian"] = Field(
        default="box", description="the pixel filter: 'box', 'tent' or 'gaussian'"
    )
    exposure: Number = Field(default=0.0, description="the exposure in stops; 1 doubles the brightness")
    png_bits: Literal[8, 16] = Field(default=8, description="8 or 16 bits per channel for image.png")
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = Field(
        default=0, description="a whole number that fixes the jitter"
    )

    @model_validator(mode="before")
    @classmethod
    def _layers_for_quality(cls, values: Any) -> Any:
        if not isinstance(values, dict) or values.get("quality") is None or "supersampling" in values:
            return values
        try:
            fine = decibels_of(values["quality"]) > _FINE
        except (ValueError, TypeError):
            # Refused where all values are looked at.
            return values
        return {**values, "supersampling": 2} if fine else values

    @model_validator(mode="after")
    def _rays_or_quality(self) -> "RenderTable":
        if self.quality is not None:
            if "rays" in self.model_fields_set:
                raise ValueError("has rays, and a quality that finds its own number; leave one of them out")
            # Only asked to refuse what is no quality.
            decibels_of(self.quality)
        return self

    @model_validator(mode="after")
    def _what_post_ignores(self) -> "RenderTable":
        names = (
            "quality", "max_layers", "slabs", "slab_blur_px", "examine_layers", "view_dependent", "smooth",
            "pixel_filter",
        )  # fmt: skip
        idle = [name for name in names if name in self.model_fields_set]
        if self.method == "post" and idle:
            remedy = "say method = 'auto'" if idle[0] == "quality" else "leave one out"
            raise ValueError(f"has {idle[0]}, which is about tracing, and method = 'post'; {remedy}")
        return self

    @model_validator(mode="after")
    def _what_auto_takes(self) -> "RenderTable":
        if self.method != "auto":
            return self
        if self.quality is None:
            raise ValueError(
                "has method = 'auto' and no quality to choose by; give one such as quality = '30 dB', or say"
                " 'trace' or 'post'"
            )
        beyond = "view_dependent" if self.view_dependent else "pixel_filter"
        if self.view_dependent or self.pixel_filter != "box":
            raise ValueError(
                f"has {beyond}, which post-processing cannot do, and method = 'auto'; leave {beyond} out, or"
                " say method = 'trace'"
            )
        return self

    @model_validator(mode="after")
    def _one_thickness(self) -> "RenderTable":
        if self.slabs is not None and self.slab_blur_px is not None:
            raise ValueError("has slabs and slab_blur_px, each of which says how thick slabs are; keep one")
        return self
