"""Materials of USD: UsdPreviewSurface's diffuse colour, emission and opacity, with their pictures.

Source: the specification of UsdPreviewSurface (openusd.org).
"""

import dataclasses
import io
import math
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from focusjax.scene import Material, TextureTable, open_picture
from focusjax.scene_files._stored import SceneFileError
from focusjax.scene_files._usd_stage import pxr, refuse_outside

_GREY = 0.18
"""Of a UsdPreviewSurface that says nothing of its diffuse colour."""


@dataclasses.dataclass(frozen=True)
class Look:
    """A material, and where on a mesh its pictures and colours are to be found.

    Attributes:
        material: its constants and picture numbers.
        uv: primvar of texture coordinates; empty without a picture.
        colours: primvar of vertex colours that the material reads; empty for none.
        transform: rows [2, 3] that take a primvar's (u, v, 1) to the picture's coordinates; None as they are.
    """

    material: Material
    uv: str = ""
    colours: str = ""
    transform: np.ndarray | None = None


class Looks:
    """Reads each material of a stage once."""

    def __init__(self, path: Path, within: Sequence[Path], textures: TextureTable):
        self._path, self._within, self._textures = path, within, textures
        self._found: dict[str, Look | None] = {}
        self._images: dict[str, Any] = {}
        self._shade, self._ar = pxr(path, "UsdShade", "Ar")

    def of(self, prim: Any) -> Look | None:
        """The look of a mesh or of a part of it; None where nothing is bound to it that can be read.

        Raises:
            SceneFileError: a picture outside the folders that may be read.
        """
        material, _ = self._shade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not material:
            return None
        key = str(material.GetPath())
        if key not in self._found:
            self._found[key] = self._read(material, key)
        return self._found[key]

    def _read(self, material: Any, key: str) -> Look | None:
        source = material.ComputeSurfaceSource()
        shader = source[0] if isinstance(source, tuple) else source
        if not shader or shader.GetIdAttr().Get() != "UsdPreviewSurface":
            warnings.warn(
                f"{self._path}: material {key} has no UsdPreviewSurface; displayColor is taken, so export it"
                " with preview surfaces",
                stacklevel=4,
            )
            return None
        plain = Material(np.full(3, _GREY), np.zeros(3), np.zeros(3))
        emission = self._value(shader, "emissiveColor", (0.0, 0.0, 0.0))
        opacity = float(self._value(shader, "opacity", 1.0))
        plain = dataclasses.replace(plain, emission=np.maximum(np.array(emission, dtype=float), 0.0))
        plain = dataclasses.replace(plain, opacity=min(max(opacity, 0.0), 1.0))
        look = self._diffuse(shader, plain)
        cutoff = float(self._value(shader, "opacityThreshold", 0.0))
        if cutoff > 0:
            look = dataclasses.replace(look, material=look.material.cut_at(cutoff))
        return look

    def _value(self, shader: Any, name: str, otherwise: Any) -> Any:
        """An input that is not connected, or connected to a material's own input."""
        given = shader.GetInput(name)
        if not given:
            return otherwise
        found = given.GetValueProducingAttributes()
        if not found or self._is_output(found[0]):
            return otherwise
        value = found[0].Get()
        return otherwise if value is None else value

    def _is_output(self, attribute: Any) -> bool:
        return self._shade.Utils.GetType(attribute.GetName()) == self._shade.AttributeType.Output

    def _source(self, shader: Any, name: str) -> Any:
        """The shader that an input is connected to, through groups; None for a value."""
        given = shader.GetInput(name)
        for attribute in given.GetValueProducingAttributes() if given else ():
            made = self._shade.Shader(attribute.GetPrim())
            if self._is_output(attribute) and made and made.GetIdAttr().Get():
                return made
        return None

    def _diffuse(self, shader: Any, plain: Material) -> Look:
        node = self._source(shader, "diffuseColor")
        if node is None:
            colour = np.array(self._value(shader, "diffuseColor", (_GREY,) * 3), dtype=float)
            return Look(dataclasses.replace(plain, base_colour=np.clip(colour, 0.0, 1.0)))
        kind = node.GetIdAttr().Get()
        white = dataclasses.replace(plain, base_colour=np.ones(3))
        if kind == "UsdPrimvarReader_float3":
            return Look(white, colours=str(self._value(node, "varname", "displayColor")))
        if kind != "UsdUVTexture":
            warnings.warn(
                f"{self._path}: {node.GetPath()} is a {kind}, which is not read; its surfaces are grey",
                stacklevel=6,
            )
            return Look(plain)
        if np.any(np.array(self._value(node, "bias", (0.0,) * 4), dtype=float) != 0):
            warnings.warn(f"{self._path}: {node.GetPath()} has a bias, which is left out", stacklevel=6)
        factor = np.array(self._value(node, "scale", (1.0,) * 4), dtype=float)[:3]
        # A picture whose opacity nobody reads has none.
        cut = self._source(shader, "opacity") is not None
        texture, opacity = self._picture(node, opaque=not cut)
        if texture < 0:
            fallback = np.array(self._value(node, "fallback", (_GREY,) * 4), dtype=float)[:3]
            return Look(dataclasses.replace(plain, base_colour=np.clip(fallback, 0.0, 1.0)))
        uv, transform = self._coordinates(node)
        material = dataclasses.replace(
            white, base_colour=np.clip(factor, 0.0, 1.0), texture=texture, opacity_texture=opacity
        )
        return Look(material, uv=uv, transform=transform)

    def _coordinates(self, node: Any) -> tuple[str, np.ndarray | None]:
        """The primvar that a picture is placed by, and what it goes through."""
        reader, transform = self._source(node, "st"), None
        if reader is not None and reader.GetIdAttr().Get() == "UsdTransform2d":
            turn = math.radians(float(self._value(reader, "rotation", 0.0)))
            scale = np.array(self._value(reader, "scale", (1.0, 1.0)), dtype=float)
            shift = np.array(self._value(reader, "translation", (0.0, 0.0)), dtype=float)
            rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
            transform = np.concatenate([rotation * scale, shift[:, None]], axis=1)
            reader = self._source(reader, "in")
        name = "st" if reader is None else self._value(reader, "varname", "st")
        return str(name) or "st", transform

    def _picture(self, node: Any, *, opaque: bool) -> tuple[int, int]:
        """Numbers of a picture's colours and opacity, -1 where it cannot be read."""
        asset = self._value(node, "file", None)
        place = "" if asset is None else str(asset.resolvedPath)
        if not place:
            named = "no file" if asset is None else f"{asset.path}, which does not exist"
            warnings.warn(
                f"{self._path}: {node.GetPath()} refers to {named}; using its fallback colour", stacklevel=7
            )
            return -1, -1
        refuse_outside(place, self._path, self._within)
        try:
            if place not in self._images:
                opened = self._ar.GetResolver().OpenAsset(self._ar.ResolvedPath(place))
                self._images[place] = open_picture(io.BytesIO(bytes(opened.GetBuffer())))
            image = self._images[place]
            if str(self._value(node, "sourceColorSpace", "auto")) == "raw":
                values = np.asarray(image.convert("RGB"), dtype=np.float32) / np.float32(255)
                self._textures.pictures.append(values)
                return len(self._textures.pictures) - 1, -1
            return self._textures.numbers(image, opaque=opaque)
        except SceneFileError:
            raise
        except Exception as error:
            warnings.warn(
                f"{self._path}: the picture {place} cannot be read ({error}); using its fallback colour",
                stacklevel=7,
            )
            return -1, -1
