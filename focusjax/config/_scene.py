"""The scene table of a config: meshes, materials, lights and the background, or a photograph with depth."""

from typing import Annotated, Literal

from pydantic import Field, Strict, model_validator

from focusjax.config._values import Light, NotNegative, Number, Positive, Radiance, Share, Table, Vector


class ObjectTable(Table):
    """`[[scene.objects]]`: a mesh file, where it stands, and what to change about its material."""

    file: str = Field(
        description="a mesh file's path, relative to the config (glb, gltf, obj, ply, stl, off)"
    )
    name: str | None = Field(default=None, description="a name for focus points to refer to")
    translate: Vector = Field(default=(0.0, 0.0, 0.0), description="a shift [x, y, z] in metres")
    rotate_deg: Vector | Annotated[tuple[Number, Number, Number, Number], Strict(False)] = Field(
        default=(0.0, 0.0, 0.0),
        description="degrees about the world's x, then y, then z axis, or an axis and degrees about it",
    )
    scale: Number | Vector = Field(default=1.0, description="one factor, or three for x, y and z")
    colour: Annotated[tuple[Share, Share, Share], Strict(False)] | None = Field(
        default=None, description="the base colour [r, g, b], sRGB from 0 to 1"
    )
    emission: Light | None = Field(
        default=None, description="the light given off [r, g, b], linear; above 1 glows"
    )
    specular: Light | None = Field(default=None, description="the highlight's strength, for example 0.3")
    shininess: Annotated[float, Field(ge=1, allow_inf_nan=False)] | None = Field(
        default=None, description="the highlight's Phong exponent, for example 40"
    )
    reflectance: Share | Annotated[tuple[Share, Share, Share], Strict(False)] | None = Field(
        default=None, description="the share of the background that is mirrored, 0 to 1, for example 0.2"
    )
    opacity: Share | None = Field(
        default=None, description="how much of it is there, from 0 to 1, instead of what the file says"
    )
    smooth_angle_deg: Annotated[float, Field(ge=0, le=180)] | None = Field(
        default=None, description="the largest angle between faces that still looks smooth, in degrees"
    )


class DirectionalTable(Table):
    """Light from infinitely far away, such as the sun."""

    kind: Literal["directional"]
    direction: Vector = Field(description="the direction [x, y, z] that the light travels in")
    colour: Light = Field(default=1.0, description="what a white surface facing the light shows, linear")


class PointTable(Table):
    """A small lamp, weaker with the square of the distance."""

    kind: Literal["point"]
    position: Vector = Field(description="the lamp's place [x, y, z] in metres")
    intensity: Light = Field(default=1.0, description="what a white surface 1 m from the lamp shows, linear")


class ConstantTable(Table):
    """One colour everywhere at infinity."""

    kind: Literal["constant"]
    colour: Light = Field(description="the colour [r, g, b], linear")


class GradientTable(Table):
    """A sky: three colours by elevation, at infinity."""

    kind: Literal["gradient"]
    bottom: Light = Field(description="the colour straight down [r, g, b], linear")
    horizon: Light = Field(description="the colour at the horizon [r, g, b], linear")
    top: Light = Field(description="the colour straight up [r, g, b], linear")


class ImageTable(Table):
    """A panorama at infinity."""

    kind: Literal["image"]
    file: str = Field(description="an equirectangular picture's path, relative to the config")
    gain: Radiance = Field(default=1.0, description="a factor on the panorama's brightness")
    turn_deg: Number = Field(default=0.0, description="degrees by which the panorama is turned to the right")


Place = Annotated[tuple[Number, Number, Annotated[float, Field(gt=0)]], Strict(False)]
Value = Annotated[tuple[Number, Annotated[float, Field(gt=0)]], Strict(False)]


class PhotoTable(Table):
    """`[scene.photo]`: a photograph and its depth, which are all that is seen.

    Keys are the arguments of `focusjax.load_photo`, which says more.
    """

    file: str = Field(description="a photograph's path, relative to the config (jpg, png, tif, heic, exr)")
    depth: str | None = Field(
        default=None,
        description="a depth map's path (png, tif, npy, pfm, exr); left out, the photograph's own",
    )
    depth_unit: Literal["m", "mm", "1/m", "px", "relative"] | None = Field(
        default=None, description="'m', 'mm', '1/m', 'px' or 'relative', unless the file says it"
    )
    depth_scale: Positive = Field(
        default=1.0,
        description="what a stored value of 1 is in that unit, for example 0.0002 for 5000 a metre",
    )
    depth_invalid: Number | None = Field(default=None, description="the stored value that marks holes")
    depth_focal_px: Positive | None = Field(
        default=None, description="the stereo pair's focal length in the depth map's pixels, for px"
    )
    depth_offset_px: Number = Field(default=0.0, description="what is added to disparities in px")
    baseline_m: Positive | None = Field(
        default=None, description="the distance of the stereo pair's cameras in metres, for px"
    )
    anchors: Annotated[tuple[Place | Value, ...], Strict(False)] = Field(
        default=(), description="two of [x, y, metres] or [value, metres], for relative depth"
    )
    focal_length_35mm: Positive | None = Field(
        default=None, description="the focal length in mm as on 36 x 24 mm film, in place of EXIF's"
    )
    focal_length_px: Positive | None = Field(
        default=None, description="the focal length in pixels of the photograph, in place of EXIF's"
    )
    curve: Literal["srgb", "linear"] | Positive = Field(
        default="srgb", description="'srgb', 'linear', or the exponent of a power curve such as 2.2"
    )
    highlight_stops: NotNegative = Field(
        default=0.0, description="how much brighter white is than it could be stored, in stops, for example 2"
    )
    align_px: NotNegative | None = Field(
        default=None, description="pixels of the depth map by which its edges may be off, for example 2"
    )
    widest_f_number: Positive | None = Field(
        default=None,
        description="the widest f-number to prepare for; left out, that of the lens and the solve",
    )


class SceneTable(Table):
    """`[scene]`: everything that can be seen, and the light it is seen by."""

    file: str | None = Field(
        default=None,
        description="a USD or glTF file's path, relative to the config, whose meshes and lights are taken",
    )
    objects: Annotated[tuple[ObjectTable, ...], Strict(False), Field(min_length=1)] = Field(
        default=(), description="at least one [[scene.objects]] table with a file"
    )
    photo: PhotoTable | None = Field(default=None, description="a [scene.photo] table, instead of objects")
    ambient: Light = Field(default=0.0, description="light from everywhere, linear, for example 0.3")
    lights: Annotated[
        tuple[Annotated[DirectionalTable | PointTable, Field(discriminator="kind")], ...], Strict(False)
    ] = Field(default=(), description='lights of kind = "directional" or "point"')
    background: Annotated[ConstantTable | GradientTable | ImageTable, Field(discriminator="kind")] = Field(
        default=ConstantTable(kind="constant", colour=0.0),
        description='a background of kind = "constant", "gradient" or "image"',
    )
    unlit: bool = Field(default=False, description="true to show colours as they are, without lights")

    @model_validator(mode="after")
    def _objects_or_a_photograph(self) -> "SceneTable":
        if self.photo is None and self.file is None and not self.objects:
            raise ValueError(
                "has nothing to see; give a file, at least one [[scene.objects]] table, or a [scene.photo]"
            )
        others = [name for name in self.model_fields_set if name not in ("photo", "unlit")]
        if self.photo is not None and others:
            raise ValueError(
                f"has a photo, which has its own objects and light, and {min(others)}; leave one out"
            )
        return self

    @model_validator(mode="after")
    def _some_light(self) -> "SceneTable":
        lit = bool(self.lights) or self.ambient not in (0.0, (0.0, 0.0, 0.0))
        if self.unlit and lit:
            raise ValueError("is unlit and has lights; remove unlit, or the lights and the ambient light")
        # A file may have lights; where it is read it is known whether it does.
        if not self.unlit and not lit and self.photo is None and self.file is None:
            raise ValueError("has no light; add a [[scene.lights]] table, ambient light, or unlit = true")
        return self
