"""Mesh files as scene objects: whatever trimesh reads, placed, coloured and checked."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from focusjax.scene._images import decode_srgb
from focusjax.scene._material import UNTEXTURED, opacity_of, shininess_of, triple
from focusjax.scene._object import DEFAULT_SMOOTH_ANGLE, SceneObject, assemble
from focusjax.scene._part import Part, check_part
from focusjax.scene._placement import placement
from focusjax.scene._textures import TextureTable


def load_mesh(
    path: str | Path,
    *,
    name: str | None = None,
    translate: Sequence[float] = (0.0, 0.0, 0.0),
    rotate: Sequence[float] = (0.0, 0.0, 0.0),
    scale: float | Sequence[float] = 1.0,
    colour: object = None,
    emission: object = None,
    specular: object = None,
    shininess: float | None = None,
    reflectance: object = None,
    opacity: float | None = None,
    smooth_angle: float | None = None,
    within: Sequence[Path] | None = None,
) -> SceneObject:
    """A mesh file (glb, gltf, obj, ply, stl, off and more) as one object of a scene.

    All geometries of the file's scene graph are joined, each with its transform. Base-colour
    textures, material colours, emissive factors (glTF; Ke in MTL), Ks and Ns in MTL, and
    vertex or face colours are kept. sRGB data are decoded to linear; glTF factors and glTF vertex
    colours are linear already. Opacity is that of glTF's alpha modes (MASK with its cutoff; BLEND, with the
    alpha of factor, texture and vertex colours), of d, Tr and map_d in MTL, and of the alpha channel of any
    other texture. Left out: metalness and roughness, normal maps, emissive textures, refraction, skeletons
    and morph targets. Of glTF's extensions docs/exchange.md names those that are read.

    Args:
        path: the file.
        name: unique within a scene; the file's name without its ending by default.
        translate: metres [3].
        rotate: degrees about world x, then y, then z [3], or an axis and the degrees about it [4].
        scale: one factor or three; applied first, then `rotate`, then `translate`.
        colour: sRGB base colour, 0 to 1, instead of the file's colours and textures.
        emission: linear radiance the surface sends out, instead of the file's; may exceed 1.
        specular: linear Phong coefficient instead of the file's.
        shininess: Phong exponent, at least 1, instead of the file's.
        reflectance: share of the background that is mirrored, 0 to 1; files are taken to mirror nothing.
        opacity: 0 to 1, instead of all that the file says of opacity; 1 makes it opaque all over.
        smooth_angle: degrees up to which edges are shaded smooth. By default the file's normals
            are used, and 40 degrees where it has none.
        within: folders from which files may be read that the mesh file names, such as textures; from anywhere
            by default.

    Raises:
        ValueError: the file is missing, too large, cannot be read or holds no triangles, or none with an
            area; it names a file outside `within`; it requires an extension of glTF that is not read;
            vertices that are not finite; faces out of range; a bad value.

    Warns:
        UserWarning: a texture the file refers to is missing, damaged, or has no texture coordinates
            (the material's colour is used instead); a material nobody will see; meshes that skeletons or
            morph targets deform.

    Example:
        >>> import trimesh
        >>> _ = trimesh.creation.box().export("box.ply")
        >>> box = fj.load_mesh("box.ply", scale=0.5, translate=(0, 0, -2))
        >>> box.name, len(box.faces), box.vertices.min(axis=0).tolist()
        ('box', 12, [-0.25, -0.25, -2.25])
    """
    path = Path(path)
    what = f"mesh file {path}"
    found, pictures, opacities = _parts(path, what, within)
    parts = [part for _, part in found]
    return assemble(
        path.stem if name is None else name,
        [_overridden(part, colour, emission, specular, shininess, reflectance, opacity) for part in parts],
        pictures,
        opacities,
        placement(translate, rotate, scale),
        what=what,
        smooth_angle=DEFAULT_SMOOTH_ANGLE if smooth_angle is None else smooth_angle,
        keep_normals=smooth_angle is None,
    )


def load_objects(path: str | Path, *, within: Sequence[Path] | None = None) -> tuple[SceneObject, ...]:
    """All of a mesh file where it stands, an object for each node of its scene graph that has a mesh.

    Nodes of one name get numbers: `chair`, `chair 2`. Arguments, errors and warnings are those of
    `load_mesh`.
    """
    path = Path(path)
    what = f"mesh file {path}"
    found, pictures, opacities = _parts(path, what, within)
    named: dict[str, list[Part]] = {}
    for name, part in found:
        named.setdefault(name, []).append(part)
    return tuple(object_of_parts(name, parts, pictures, opacities, what) for name, parts in named.items())


def object_of_parts(
    name: str,
    parts: Sequence[Part],
    pictures: Sequence[np.ndarray],
    opacities: Sequence[np.ndarray],
    what: str,
) -> SceneObject:
    """Checked pieces in world metres as one object, with those pictures that they use."""
    used = sorted({part.material.texture for part in parts} - {UNTEXTURED})
    cut = sorted({part.material.opacity_texture for part in parts} - {UNTEXTURED})
    numbers = [{own: number for number, own in enumerate(some)} for some in (used, cut)]
    return assemble(
        name,
        [dataclasses.replace(part, material=part.material.renumbered(*numbers)) for part in parts],
        tuple(pictures[k] for k in used),
        tuple(opacities[k] for k in cut),
        np.eye(4),
        what=what,
        smooth_angle=DEFAULT_SMOOTH_ANGLE,
        keep_normals=True,
    )


def _parts(
    path: Path, what: str, within: Sequence[Path] | None
) -> tuple[
    list[tuple[str, Part]], tuple[Float[np.ndarray, "_ _ 3"], ...], tuple[Float[np.ndarray, "_ _"], ...]
]:
    """The checked pieces of a mesh file with the names of their nodes; its colour and opacity pictures."""
    # trimesh takes long to import.
    from focusjax.scene._mesh_file import Assets, read_mesh_file
    from focusjax.scene._visual import part_of

    assets = Assets(str(path), within)
    geometries = read_mesh_file(path, assets)
    textures = TextureTable(source=what, find=assets.get)
    linear_colours = path.suffix.lower() in (".glb", ".gltf")
    parts = []
    for name, mesh, matrix in geometries:
        part = part_of(mesh, textures, linear_colours=linear_colours)
        check_part(part, what)
        parts.append((name, moved_part(part, matrix)))
    return parts, tuple(textures.pictures), tuple(textures.opacities)


def moved_part(part: Part, matrix: Float[np.ndarray, "4 4"]) -> Part:
    """`part` with a scene-graph transform applied."""
    linear = matrix[:3, :3]
    if np.array_equal(matrix, np.eye(4)):
        return part
    if abs(np.linalg.det(linear)) == 0.0:
        # Flattened on purpose, as some files do with shadows: no matrix turns normals then.
        normals = None
    else:
        normals = None if part.normals is None else part.normals @ np.linalg.inv(linear)
    return dataclasses.replace(
        part,
        vertices=part.vertices @ linear.T + matrix[:3, 3],
        faces=part.faces[:, ::-1] if np.linalg.det(linear) < 0 else part.faces,
        normals=normals,
    )


def _overridden(
    part: Part,
    colour: object,
    emission: object,
    specular: object,
    shininess: float | None,
    reflectance: object,
    opacity: float | None,
) -> Part:
    """`part` with the values given in place of its material's, and of what its vertices say of the same."""
    changes: dict[str, object] = {}
    if colour is not None:
        changes["base_colour"] = decode_srgb(triple(colour, "colour", largest=1.0))
        changes["texture"] = UNTEXTURED
    if emission is not None:
        changes["emission"] = triple(emission, "emission")
    if specular is not None:
        changes["specular"] = triple(specular, "specular")
    if shininess is not None:
        changes["shininess"] = shininess_of(shininess)
    if reflectance is not None:
        changes["reflectance"] = triple(reflectance, "reflectance", largest=1.0)
    if opacity is not None:
        changes |= {"opacity": opacity_of(opacity, "opacity"), "opacity_texture": UNTEXTURED, "cutoff": None}
    return dataclasses.replace(
        part,
        material=dataclasses.replace(part.material, **changes),  # type: ignore[arg-type]
        colours=None if colour is not None else part.colours,
        opacity=None if opacity is not None else part.opacity,
    )
