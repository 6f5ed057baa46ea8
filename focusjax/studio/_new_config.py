"""The config with which somebody starts who has meshes, or a photograph with depth, and no config yet."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float

from focusjax._settings import metres
from focusjax.config import ConfigError, build_camera, parse_config
from focusjax.scene import load_mesh
from focusjax.studio._document import inline_table
from focusjax.studio._files_named import path_from
from focusjax.studio._session import Session

MESHES = frozenset({".glb", ".gltf", ".obj", ".ply", ".stl", ".off"})
"""Suffixes of mesh files."""
PHOTOS = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".heic", ".heif", ".exr"})
"""Suffixes of photographs."""

_TOWARDS_CAMERA = np.array([0.35, 0.3, 1.0])
"""From the objects to the camera: in front, a little to the right and above."""
_SIZE = (640, 480)
_FOCAL_LENGTH_MM, _SENSOR_MM = 50.0, 36.0
_FILLED = 0.82
"""Share of the frame that the objects fill."""
_LEAST_M, _SHRUNK_M = 0.03, 0.2
"""Objects smaller than the first are enlarged to the second: no lens could come close enough."""
_LARGE_M = 50.0
_MOST_PIXELS = 1024
"""Along the longer side of a photograph's picture."""


def open_session(
    paths: Sequence[Path], *, root: Path | None = None, photo: Mapping[str, Any] | None = None
) -> Session:
    """The session of a config, of meshes, or of a photograph with depth, as their suffixes say.

    The config of the latter two is new: it is written where the user saves it, by default beside the files.

    Args:
        paths: one config, one photograph, or any number of meshes.
        root: the folder below which a config's files lie; its own by default.
        photo: keys of `[scene.photo]` for a photograph, such as `depth` (a path) and `depth_unit`.

    Raises:
        ConfigError: a file that is of no known kind or cannot be used; the message names it.
    """
    kinds = {_kind(path) for path in paths}
    given = {key: value for key, value in (photo or {}).items() if value is not None}
    if given and kinds != {"photo"}:
        raise ConfigError(f"{paths[0]}: --{min(given).replace('_', '-')} is for a photograph; leave it out")
    if len(kinds) > 1 or (kinds != {"mesh"} and len(paths) > 1):
        raise ConfigError(
            f"{paths[1]}: cannot be opened together with {paths[0]}; give one config, one photograph, or"
            " meshes"
        )
    if kinds == {"config"}:
        return Session(paths[0], root=root)
    for path in paths:
        if not path.is_file():
            raise ConfigError(f"{path}: there is no such file; check the path")
    text, file = _of_photo(paths[0], given) if kinds == {"photo"} else _of_meshes(paths)
    parse_config(text, file, root=root)
    return Session(file, root=root, text=text)


def _kind(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix == ".toml":
        return "config"
    if suffix in MESHES | PHOTOS:
        return "mesh" if suffix in MESHES else "photo"
    raise ConfigError(
        f"{path}: is neither a config (toml), a mesh (glb, gltf, obj, ply, stl, off) nor a photograph"
        " (jpg, png, tif, webp, heic, exr); give one of these"
    )


def _of_meshes(paths: Sequence[Path]) -> tuple[str, Path]:
    """A config that shows the meshes, and the file that it would be."""
    folder = Path(os.path.commonpath([path.absolute().parent for path in paths]))
    names = _names([path.stem for path in paths])
    try:
        vertices = np.concatenate([load_mesh(path).vertices for path in paths]).astype(float)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    size = float(np.ptp(vertices, axis=0).max())
    scale = float(f"{_SHRUNK_M / size:.4g}") if 0 < size < _LEAST_M else 1.0
    position, target = _camera_for(scale * vertices)
    document = _started(paths[0].stem, _about_size(size, scale))
    document["camera"] = {
        "position": _written(position),
        "look_at": _written(target),
        "focal_length_mm": _FOCAL_LENGTH_MM,
        "sensor_width_mm": _SENSOR_MM,
        "resolution": list(_SIZE),
    }
    _add_lens(document)
    document["scene"] = scene = tomlkit.table()
    scene["ambient"] = 0.35
    scene["background"] = inline_table(
        {"kind": "gradient", "bottom": 0.12, "horizon": 0.3, "top": [0.32, 0.38, 0.5]}
    )
    scene["lights"] = _tables([{"kind": "directional", "direction": [-0.5, -1.0, -0.65], "colour": 0.8}])
    objects = [
        {"name": name, "file": path_from(folder, path)} | ({"scale": scale} if scale != 1.0 else {})
        for name, path in zip(names, paths, strict=True)
    ]
    scene["objects"] = _tables(objects)
    return tomlkit.dumps(document), _new_file(folder, paths[0].stem)


def _of_photo(path: Path, given: dict[str, Any]) -> tuple[str, Path]:
    """A config of a photograph with depth, and the file that it would be."""
    folder = path.absolute().parent
    if "depth" in given:
        depth = Path(given["depth"])
        folder = Path(os.path.commonpath([folder, depth.absolute().parent]))
        # The page has no field for it, so that what is missing is said before there is a page.
        if not given.get("depth_unit"):
            raise ConfigError(
                f"{depth}: nothing says what the values of this depth map mean; give depth_unit as one of"
                " m, mm, 1/m, px or relative"
            )
        given = given | {"depth": path_from(folder, depth)}
    document, file = _started(path.stem, ""), _new_file(folder, path.stem)
    _add_lens(document)
    document["scene"] = tomlkit.table(is_super_table=True)
    document["scene"]["photo"] = {"file": path_from(folder, path)} | given  # pyright: ignore[reportIndexIssue]
    camera = build_camera(parse_config(tomlkit.dumps(document), file))
    longest = max(camera.width, camera.height)
    if longest > _MOST_PIXELS:
        share = _MOST_PIXELS / longest
        size = [max(1, round(share * each)) for each in (camera.width, camera.height)]
        document["camera"] = {"resolution": size}
    return tomlkit.dumps(document), file


def _camera_for(vertices: Float[np.ndarray, "v 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Where a camera stands, and where it looks, so that all vertices are in the frame."""
    target = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    back = _TOWARDS_CAMERA / np.linalg.norm(_TOWARDS_CAMERA)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    axes = (vertices - target) @ np.column_stack([right, np.cross(back, right), back])
    across = _FILLED * _SENSOR_MM / (2.0 * _FOCAL_LENGTH_MM)
    slopes = np.array([across, across * _SIZE[1] / _SIZE[0]])
    distance = float((axes[:, 2] + (np.abs(axes[:, :2]) / slopes).max(axis=1)).max())
    return target + max(distance, 4e-3 * _FOCAL_LENGTH_MM) * back, target


def _started(title: str, note: str) -> tomlkit.TOMLDocument:
    document = tomlkit.document()
    if note:
        document.add(tomlkit.comment(note))
        document.add(tomlkit.nl())
    document["title"] = title
    return document


def _about_size(size: float, scale: float) -> str:
    if scale != 1.0:
        return f"Lengths are metres. As it is the mesh is {metres(size)} across; here it is enlarged."
    if size > _LARGE_M:
        return f"Lengths are metres: the mesh is {metres(size)} across. Give it a scale if that is not so."
    return f"Lengths are metres: the mesh is {metres(size)} across."


def _add_lens(document: tomlkit.TOMLDocument) -> None:
    document["lens"] = {"f_number": 2.8}
    document["solve"] = {"free": ["focus", "f_number"], "f_number_min": 1.4, "f_number_max": 16}


def _tables(rows: Sequence[Mapping[str, Any]]) -> Any:
    tables = tomlkit.aot()
    for row in rows:
        table = tomlkit.table()
        table.update(row)
        tables.append(table)
    return tables


def _names(stems: Sequence[str]) -> list[str]:
    """A name for each, all different."""
    return [
        stem if stems.count(stem) == 1 else f"{stem} {list(stems[: k + 1]).count(stem)}"
        for k, stem in enumerate(stems)
    ]


def _new_file(folder: Path, stem: str) -> Path:
    """A config's file in `folder` that is not there yet."""
    file, number = folder / f"{stem}.toml", 1
    while file.exists():
        number += 1
        file = folder / f"{stem}_{number}.toml"
    return file


def _written(values: np.ndarray) -> list[float]:
    return [float(f"{value:.5g}") for value in values]
