"""Mesh files as trimesh reads them, with every refusal and remark in one sentence."""

import contextlib
import io
import logging
import struct
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.exchange.load import mesh_formats
from trimesh.resolvers import FilePathResolver

from focusjax.scene._gltf import (
    check_extensions,
    check_gltf_place,
    gltf_for_trimesh,
    gltf_node_names,
    gltf_parents,
    say_what_moves,
)
from focusjax.scene._gltf_attributes import with_attributes
from focusjax.scene._images import open_picture
from focusjax.scene._sizes import check_bytes, check_mesh, gltf_json

_DATA = {".mtl", ".bin", ".glb", ".gltf", ".obj"}
"""Endings of files beside a mesh that are no pictures."""


class Assets(FilePathResolver):
    """Finds files beside the mesh, and remembers those that are missing, damaged or not to be read.

    trimesh carries on without a texture it cannot load, and says so in its debug log only.
    """

    def __init__(self, source: str, within: Sequence[Path] | None):
        super().__init__(source, allow_anywhere=True)
        self.missing: dict[str, str] = {}
        self.outside: list[str] = []
        self._within = None if within is None else [folder.resolve() for folder in within]

    def namespaced(self, namespace: str) -> "Assets":
        made = Assets(str(Path(self.parent) / namespace), self._within)
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


def read_mesh_file(path: Path, assets: Assets) -> list[tuple[str, trimesh.Trimesh, Float[np.ndarray, "4 4"]]]:
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
    except FileNotFoundError as error:
        _refuse_outside(path, assets)
        lost = next(iter(assets.missing), error)
        raise ValueError(
            f"mesh file {path} refers to {lost}, which does not exist; put it there, or export the"
            " scene again"
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
    broken = (ValueError, KeyError, IndexError, TypeError, AttributeError, struct.error)
    try:
        gltf_parents(content["nodes"])
        _check_roots(content)
        for number in range(len(content["nodes"])):
            check_gltf_place(content["nodes"], number)
        names = gltf_node_names(content)
    except broken as error:
        raise ValueError(
            f"mesh file {path} cannot be read (its nodes: {error}); export the scene again"
        ) from error
    check_extensions(path, content)
    try:
        source = gltf_for_trimesh(path, with_attributes(content))
        say_what_moves(path, content)
    except broken as error:
        raise ValueError(
            f"mesh file {path} cannot be read (its meshes: {error}); export the scene again"
        ) from error
    return io.BytesIO(source), names


def _check_roots(content: dict[str, Any]) -> None:
    """Raise a `ValueError` where a scene is of nodes that the file does not have."""
    count = len(content["nodes"])
    for number, scene in enumerate(content.get("scenes", ())):
        for root in scene.get("nodes", ()):
            if not (isinstance(root, int) and 0 <= root < count):
                raise ValueError(f"scene {number} has node {root!r}, and there are {count} nodes")


def _refuse_outside(path: Path, assets: Assets) -> None:
    """A stranger's file that asks for files elsewhere may be up to something."""
    if assets.outside:
        raise ValueError(
            f"mesh file {path} refers to {assets.outside[0]}, outside the folders that may be read; move it"
            " there, or allow more with --root DIR, or within=[DIR] in Python"
        )
