"""What a mesh file says about colour, from trimesh's several kinds of visuals to one `Part`."""

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from jaxtyping import Float
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from focusjax.scene._images import decode_srgb, unit_range
from focusjax.scene._material import UNTEXTURED, Material
from focusjax.scene._object import DEFAULT_ALBEDO
from focusjax.scene._part import Part
from focusjax.scene._textures import TextureTable


def part_of(mesh: trimesh.Trimesh, textures: TextureTable, *, linear_colours: bool) -> Part:
    """The mesh as a `Part` with its normals, texture coordinates, colours and material.

    Args:
        mesh: as trimesh loaded it, unprocessed.
        textures: receives the pictures the mesh uses.
        linear_colours: vertex colours are linear, as glTF defines, not sRGB.
    """
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64)
    # Reading the property would compute normals that the file does not hold.
    stored = mesh._cache.cache.get("vertex_normals")
    normals = None if stored is None else np.asarray(stored, dtype=np.float64)
    visual = mesh.visual
    uv, colours, opacity, in_corners = None, None, None, False
    if isinstance(visual, TextureVisuals):
        if np.shape(visual.uv)[:1] == (len(vertices),):
            uv = np.asarray(visual.uv, dtype=np.float64)[:, :2]
        if "color" in visual.vertex_attributes:
            colours = np.asarray(visual.vertex_attributes["color"])
        if colours is not None and getattr(visual.material, "alphaMode", None) == "BLEND":
            opacity = _fourth(colours)
        material = _material(visual.material, textures, has_uv=uv is not None)
        beside = mesh.vertex_attributes.get("color")
        if colours is None and beside is not None and material.texture == UNTEXTURED:
            # Texture coordinates without a picture: the vertex colours are what the file means.
            colours, material = np.asarray(beside), replace(material, base_colour=np.ones(3))
    else:
        assert isinstance(visual, ColorVisuals)
        # No colours at all, per-vertex and per-face ones: trimesh names them by `kind`.
        if visual.kind == "face":
            colours, in_corners = np.repeat(np.asarray(visual.face_colors), 3, axis=0), True
        elif visual.kind == "vertex":
            colours = np.asarray(visual.vertex_colors)
        grey = DEFAULT_ALBEDO if colours is None else 1.0
        material = _plain(np.full(3, grey))
    if colours is not None:
        colours = unit_range(colours)[:, :3]
        colours = colours if linear_colours else decode_srgb(colours)
    if in_corners:
        corners = faces.ravel()
        vertices, faces = vertices[corners], np.arange(len(corners)).reshape(-1, 3)
        normals = None if normals is None else normals[corners]
    return Part(vertices, faces, material, normals, uv, colours, opacity)


def _fourth(colours: np.ndarray) -> Float[np.ndarray, "v"] | None:
    """The alpha of vertex colours that have one."""
    return unit_range(colours)[:, 3] if colours.shape[1] == 4 else None


def _material(found: object, textures: TextureTable, *, has_uv: bool) -> Material:
    """A `Material` of a trimesh material, PBR (linear factors) or simple (sRGB colours)."""
    if isinstance(found, PBRMaterial):
        return _of_pbr(found, textures, has_uv=has_uv)
    if isinstance(found, SimpleMaterial):
        return _of_simple(found, textures, has_uv=has_uv)
    main = getattr(found, "main_color", None)
    return _plain(
        np.full(3, DEFAULT_ALBEDO) if main is None else decode_srgb(unit_range(np.asarray(main))[:3])
    )


def _of_pbr(found: PBRMaterial, textures: TextureTable, *, has_uv: bool) -> Material:
    factor = found.baseColorFactor
    image = found.baseColorTexture
    emission = np.zeros(3) if found.emissiveFactor is None else np.asarray(found.emissiveFactor)
    if found.emissiveTexture is not None and emission.any():
        warnings.warn(
            f"material {found.name!r} in {textures.source} has an emissive texture, which is not"
            " supported; it is taken as not emitting (give the object an emission instead)",
            stacklevel=2,
        )
        emission = np.zeros(3)
    rgba = np.ones(4) if factor is None else unit_range(np.asarray(factor))
    # glTF: alpha means nothing unless the material says what.
    opaque = found.alphaMode not in ("MASK", "BLEND")
    texture, opacity_texture = _pictured(image, textures, opaque=opaque, has_uv=has_uv)
    material = replace(
        _plain(rgba[:3], emission=emission, texture=texture),
        opacity=1.0 if opaque else float(rgba[3]),
        opacity_texture=opacity_texture,
    )
    if found.alphaMode == "MASK":
        material = material.cut_at(0.5 if found.alphaCutoff is None else found.alphaCutoff)
    return _noted(material, found.name, textures)


def _pictured(
    image: Image.Image | None, textures: TextureTable, *, opaque: bool, has_uv: bool
) -> tuple[int, int]:
    """Numbers of the colours and of the opacity of a material's picture, -1 where there is none."""
    if image is None:
        return UNTEXTURED, UNTEXTURED
    if not has_uv:
        warnings.warn(
            f"{textures.source} has a texture but no texture coordinates to place it by; using the material"
            " colour instead",
            stacklevel=2,
        )
        return UNTEXTURED, UNTEXTURED
    return textures.numbers(image, opaque=opaque)


def _noted(material: Material, name: str | None, textures: TextureTable) -> Material:
    """`material`, with a warning if nobody will see it: often an exporter's mistake."""
    if material.opacity == 0.0:
        warnings.warn(
            f"material {name!r} of {textures.source} is wholly transparent and will not be seen; give the"
            " object an opacity if that is a mistake",
            stacklevel=2,
        )
    return material


def _of_simple(found: SimpleMaterial, textures: TextureTable, *, has_uv: bool) -> Material:
    keys = ("kd", "ks", "ke", "ns", "illum", "d", "tr")
    stated = {key: _numbers(key, found.kwargs, textures.source) for key in keys}
    # Where a file gives texture coordinates but no picture, trimesh puts a grey one it makes itself,
    # which unlike pictures that were read has no file format.
    image = found.image
    pictured = None if image is None or image.format is None else image
    opacity_map = _file_name(found.kwargs.get("map_d"))
    opaque = opacity_map is not None
    texture, opacity_texture = _pictured(pictured, textures, opaque=opaque, has_uv=has_uv)
    if opacity_map is not None and has_uv:
        opacity_texture = textures.opacity_file(opacity_map)
    albedo = np.full(3, DEFAULT_ALBEDO)
    if texture != UNTEXTURED:
        # As in most programs, a picture stands for the diffuse colour instead of being tinted by it.
        albedo = np.ones(3)
    elif stated["kd"] is not None:
        albedo = decode_srgb(np.minimum(stated["kd"], 1.0))
    # Illumination models 0 and 1 of MTL files have no highlight, whatever Ks says.
    glossy = stated["illum"] is not None and stated["illum"][0] >= 2
    plain = _plain(
        albedo,
        emission=stated["ke"],
        specular=stated["ks"] if glossy else None,
        shininess=32.0 if stated["ns"] is None else max(1.0, float(stated["ns"][0])),
        texture=texture,
    )
    opacity = _opacity_of_mtl(stated["d"], stated["tr"])
    material = replace(plain, opacity=opacity, opacity_texture=opacity_texture)
    return _noted(material, found.name, textures)


def _opacity_of_mtl(dissolve: np.ndarray | None, transparency: np.ndarray | None) -> float:
    """Of d, or of its complement Tr."""
    if dissolve is not None:
        return min(float(dissolve[0]), 1.0)
    return 1.0 if transparency is None else 1.0 - min(float(transparency[0]), 1.0)


def _file_name(stated: Sequence[str] | str | None) -> str | None:
    """The file of an MTL map line, whose options come first."""
    words = stated.split() if isinstance(stated, str) else list(stated or ())
    return words[-1] if words else None


def _plain(
    albedo: Float[np.ndarray, "3"],
    *,
    emission: Float[np.ndarray, "3"] | None = None,
    specular: Float[np.ndarray, "3"] | None = None,
    shininess: float = 32.0,
    texture: int = UNTEXTURED,
) -> Material:
    return Material(
        base_colour=np.asarray(albedo, dtype=np.float64),
        emission=np.zeros(3) if emission is None else np.asarray(emission, dtype=np.float64),
        specular=np.zeros(3) if specular is None else np.asarray(specular, dtype=np.float64),
        shininess=shininess,
        texture=texture,
    )


def _numbers(key: str, stated: dict, source: str) -> Float[np.ndarray, "3"] | None:
    """Three numbers of an MTL line, which may hold one for all, as text or parsed."""
    if key not in stated:
        return None
    try:
        values = np.broadcast_to(np.asarray(stated[key], dtype=np.float64), (3,))
    except ValueError:
        values = np.full(3, np.nan)
    if not (np.isfinite(values).all() and (values >= 0).all()):
        warnings.warn(
            f"the material of {source} has {key.capitalize()} {stated[key]}, which is not one or three"
            " numbers of at least 0; it is left out",
            stacklevel=2,
        )
        return None
    return values.copy()
