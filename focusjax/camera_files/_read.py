"""From a file to the camera in it."""

from collections.abc import Sequence
from pathlib import Path

from focusjax.camera_files._gltf import gltf_camera
from focusjax.camera_files._stored import CameraFileError, StoredCamera
from focusjax.camera_files._usd import usd_camera

_USD = (".usd", ".usda", ".usdc", ".usdz")
_GLTF = (".gltf", ".glb")


def read_camera(
    path: str | Path, name: str | None = None, *, within: Sequence[Path] | None = None
) -> StoredCamera:
    """A camera of a USD stage (extra `usd`) or of a glTF file, as it is in the file's first frame.

    What `export_camera` writes is read back whole. Of other programs' cameras glTF says the pose and the
    field of view, and USD also the sensor, focus distance and f-number.

    Args:
        path: a .usd, .usda, .usdc, .usdz, .gltf or .glb file.
        name: of the camera; not needed where there is one.
        within: folders from which files may be read that a stage names; from anywhere by default.

    Raises:
        CameraFileError: (a `ValueError`) a file that cannot be read, of no such kind, or without that camera;
            a camera that is not in perspective, or whose transform is skewed or mirrored.

    Example:
        >>> read_camera("shot.usda").focus_distance  # doctest: +SKIP
        1.3
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (*_USD, *_GLTF):
        raise CameraFileError(f"{path}: is no file of cameras; expected {', '.join((*_USD, *_GLTF))}")
    if not path.is_file():
        wrong = "is a folder; name a file in it" if path.is_dir() else "does not exist; check the path"
        raise CameraFileError(f"{path}: {wrong}")
    return gltf_camera(path, name) if ending in _GLTF else usd_camera(path, name, within)
