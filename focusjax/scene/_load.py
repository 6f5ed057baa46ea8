"""Mesh files as scene objects: whatever trimesh reads, placed, coloured and checked."""

import contextlib
import dataclasses
import io
import logging
import struct
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.exchange.load import mesh_formats
from trimesh.resolvers import FilePathResolver

from focusjax.scene._gltf import gltf_for_trimesh, gltf_node_names, gltf_parents
from focusjax.scene._images import decode_srgb, open_picture
from focusjax.scene._material import UNTEXTURED, opacity_of, shininess_of, triple
from focusjax.scene._object import DEFAULT_SMOOTH_ANGLE, SceneObject, assemble
from focusjax.scene._part import Part, check_part
from focusjax.scene._placement import placement
from focusjax.scene._sizes import check_bytes, check_mesh, gltf_json
from focusjax.scene._visual import TextureTable, part_of

_DATA = {".mtl", ".bin", ".glb", ".gltf", ".obj"}
"""Endings of files beside a mesh that are no pictures."""


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
    other texture. Left out: metalness and roughness, normal maps, emissive textures, refraction.

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
            area; it names a file outside `within`; vertices that are not finite; faces out of range; a bad
            value.

    Warns:
        UserWarning: a texture the file refers to is missing, damaged, or has no texture coordinates
            (the material's colour is used instead); a material nobody will see.
    """
    path = Path(path)
    what = f"mesh file {path}"
    found, textures = _parts(path, what, within)
    parts = [part for _, part in found]
    return assemble(
        path.stem if name is None else name,
        [_overridden(part, colour, emission, specular, shininess, reflectance, opacity) for part in parts],
        tuple(textures.pictures),
        tuple(textures.opacities),
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
    found, textures = _parts(path, what, within)
    named: dict[str, list[Part]] = {}
    for name, part in found:
        named.setdefault(name, []).append(part)
    return tuple(
        object_of_parts(name, parts, textures.pictures, textures.opacities, what)
        for name, parts in named.items()
    )


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

    def renumbered(part: Part) -> Part:
        own = part.material
        material = dataclasses.replace(
            own,
            texture=used.index(own.texture) if own.texture in used else UNTEXTURED,
            opacity_texture=cut.index(own.opacity_texture) if own.opacity_texture in cut else UNTEXTURED,
        )
        return dataclasses.replace(part, material=material)

    return assemble(
        name,
        [renumbered(part) for part in parts],
        tuple(pictures[k] for k in used),
        tuple(opacities[k] for k in cut),
        np.eye(4),
        what=what,
        smooth_angle=DEFAULT_SMOOTH_ANGLE,
        keep_normals=True,
    )


def _parts(
    path: Path, what: str, within: Sequence[Path] | None
) -> tuple[list[tuple[str, Part]], TextureTable]:
    """The checked pieces of a mesh file with the names of their nodes, and the pictures they refer to."""
    assets = _Assets(str(path), within)
    geometries = _read(path, assets)
    textures = TextureTable(source=what, find=assets.get)
    linear_colours = path.suffix.lower() in (".glb", ".gltf")
    parts = []
    for name, mesh, matrix in geometries:
        part = part_of(mesh, textures, linear_colours=linear_colours)
        check_part(part, what)
        parts.append((name, moved_part(part, matrix)))
    return parts, textures


class _Assets(FilePathResolver):
    """Finds files beside the mesh, and remembers those that are missing, damaged or not to be read.

    trimesh carries on without a texture it cannot load, and says so in its debug log only.
    """

    def __init__(self, source: str, within: Sequence[Path] | None):
        super().__init__(source, allow_anywhere=True)
        self.missing: dict[str, str] = {}
        self.outside: list[str] = []
        self._within = None if within is None else [folder.resolve() for folder in within]

    def namespaced(self, namespace: str) -> "_Assets":
        made = _Assets(str(Path(self.parent) / namespace), self._within)
        made.missing, made.outside = self.missing, self.outside
        return made

    def absolute(self, name: str) -> Path:
        path = super().absolute(name)
        if not self._allowed(path):
            raise ValueError(f"{name} is outside the folders that may be read")
        if path.is_file():
            check_bytes(path)
        return path

    def _allowed(self, path: Path) -> bool:
        return self._within is None or any(path.is_relative_to(folder) for folder in self._within)

    def get(self, name: str) -> bytes:
        try:
            data = super().get(name)
        except Exception:
            # A path from another machine leads nowhere here; one that leads somewhere is refused.
            path = super().absolute(name)
            if path.exists() and not self._allowed(path):
                self.outside.append(name)
            self.missing[name] = "does not exist"
            raise
        if Path(name).suffix.lower() not in _DATA:
            try:
                open_picture(io.BytesIO(data)).verify()
            except Exception:
                self.missing[name] = "is not a readable picture (png and jpg always are)"
        return data


_UNREADABLE = ("failed to load image", "`image/ktx2` textures are unsupported")
"""How trimesh begins to say, to its developers only, that a picture is left out."""


class _Remarks(logging.Handler):
    """Keeps what trimesh logs, which would otherwise reach the terminal with a traceback."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.levelno >= logging.WARNING or record.getMessage().startswith(_UNREADABLE):
            self.lines.append(record.getMessage())


@contextlib.contextmanager
def _remarks() -> Iterator[list[str]]:
    logger, remarks = logging.getLogger("trimesh"), _Remarks()
    propagated, logger.propagate = logger.propagate, False
    level = logger.level
    logger.setLevel(logging.DEBUG)
    logger.addHandler(remarks)
    try:
        yield remarks.lines
    finally:
        logger.removeHandler(remarks)
        logger.setLevel(level)
        logger.propagate = propagated


def _read(path: Path, assets: _Assets) -> list[tuple[str, trimesh.Trimesh, Float[np.ndarray, "4 4"]]]:
    """The meshes of the file, each with the name of its node and its matrix file_from_mesh."""
    if not path.is_file():
        wrong = "is a folder; name a file in it" if path.is_dir() else "does not exist; check the path"
        raise ValueError(f"mesh file {path} {wrong}")
    ending = path.suffix.lower().lstrip(".")
    if ending not in mesh_formats():
        raise ValueError(
            f"mesh file {path} has an unknown format {ending!r}; expected glb, gltf, obj, ply, stl or off"
        )
    try:
        check_mesh(path)
    except ValueError as error:
        raise ValueError(f"mesh file {path} is too large: {error}") from None
    source, names = _source(path)
    try:
        # Unprocessed: processing would drop vertices that are not finite and merge others unasked.
        with _remarks() as remarks:
            scene = trimesh.load_scene(source, file_type=ending, resolver=assets, process=False)
        found = []
        for node in scene.graph.nodes_geometry:
            matrix, key = scene.graph[node]
            if isinstance(scene.geometry[key], trimesh.Trimesh):
                # Several pieces of one node have its number before their own.
                name = names[int(node.partition("_")[0])] if names else str(key)
                found.append((name, scene.geometry[key], np.asarray(matrix, dtype=np.float64)))
    except IndexError as error:
        raise ValueError(
            f"mesh file {path} cannot be read: a face refers to a vertex that is out of range ({error});"
            " export the mesh again"
        ) from error
    except Exception as error:
        _refuse_outside(path, assets)
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise ValueError(
            f"mesh file {path} cannot be read ({reason}); is it a complete {ending} file?"
        ) from error
    _refuse_outside(path, assets)
    undecoded = [remark for remark in remarks if "placeholder zeros" in remark]
    if undecoded:
        raise ValueError(
            f"mesh file {path} is compressed with an extension that cannot be decoded ({undecoded[0]});"
            " export it without compression"
        )
    for remark in remarks:
        if "unable to load image" not in remark and not remark.startswith(_UNREADABLE):
            warnings.warn(f"mesh file {path}: {remark}", stacklevel=4)
    if any(remark.startswith(_UNREADABLE) for remark in remarks) and not assets.missing:
        warnings.warn(
            f"mesh file {path} holds a picture of a format that cannot be read (png and jpg always can);"
            " using the material colour instead",
            stacklevel=4,
        )
    for name, trouble in assets.missing.items():
        warnings.warn(
            f"mesh file {path} refers to {name}, which {trouble}; using the material colour instead",
            stacklevel=4,
        )
    found = [each for each in found if len(each[1].faces)]
    if not found:
        raise ValueError(f"mesh file {path} has no faces; expected a mesh of triangles")
    return found


def _source(path: Path) -> tuple[str | io.BytesIO, list[str]]:
    """What trimesh is to read, and of glTF the names of the nodes whose numbers it will name."""
    content = gltf_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("nodes"), list):
        return str(path), []
    try:
        gltf_parents(content["nodes"])
        return io.BytesIO(gltf_for_trimesh(path, content)), gltf_node_names(content)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error) as error:
        raise ValueError(
            f"mesh file {path} cannot be read (its nodes: {error}); export the scene again"
        ) from error


def _refuse_outside(path: Path, assets: _Assets) -> None:
    """A stranger's file that asks for files elsewhere may be up to something."""
    if assets.outside:
        raise ValueError(
            f"mesh file {path} refers to {assets.outside[0]}, outside the folders that may be read; move it"
            " there, or allow more with --root DIR"
        )


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
