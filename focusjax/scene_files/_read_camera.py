"""From a file to the camera in it."""

from collections.abc import Sequence
from pathlib import Path

from focusjax.scene_files._gltf import gltf_camera
from focusjax.scene_files._stored import CameraFrames, SceneFileError, StoredCamera
from focusjax.scene_files._usd_camera import usd_camera_frames

USD = (".usd", ".usda", ".usdc", ".usdz")
GLTF = (".gltf", ".glb")


def read_camera(
    path: str | Path, name: str | None = None, *, within: Sequence[str | Path] | None = None
) -> StoredCamera:
    """A camera of a USD stage (extra `usd`) or of a glTF file, as it is in the file's first frame.

    What `export_camera` writes is read back whole. Of other programs' cameras glTF says the pose and the
    field of view, and USD also the sensor, focus distance and f-number.

    Args:
        path: a .usd, .usda, .usdc, .usdz, .gltf or .glb file.
        name: of the camera; not needed where there is one.
        within: folders from which files may be read that a stage names; the file's own by default, and
            ["/"] for anywhere.

    Raises:
        SceneFileError: (a `ValueError`) a file that cannot be read, of no such kind, or without that camera;
            a camera that is not in perspective, or whose transform is skewed or mirrored.

    Example:
        >>> camera = fj.look_at((0, 0, 1), (0, 0, 0), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=1.25, f_number=2.0, focal_length=0.05)
        >>> _ = fj.export_camera(camera, lens, "shot.usda", to="usd")
        >>> round(float(fj.read_camera("shot.usda").focus_distance), 6)
        1.25
    """
    path = checked(path)
    if path.suffix.lower() in GLTF:
        return gltf_camera(path, name)
    return usd_camera_frames(path, name, folders_of(path, within), first_only=True).cameras[0]


def read_camera_frames(
    path: str | Path, name: str | None = None, *, within: Sequence[str | Path] | None = None
) -> CameraFrames:
    """A camera in all frames of its file; of glTF, whose animations are not read, in one.

    Arguments and errors are those of `read_camera`.
    """
    path = checked(path)
    if path.suffix.lower() in GLTF:
        return CameraFrames((gltf_camera(path, name),), 24.0)
    return usd_camera_frames(path, name, folders_of(path, within))


def folders_of(path: Path, within: Sequence[str | Path] | None) -> list[Path]:
    """The folders that files may be read from: those given, or the one that `path` is in."""
    return [path.parent] if within is None else [Path(folder) for folder in within]


def checked(path: str | Path) -> Path:
    """The path of a file that is there and of a kind that can hold a scene.

    Raises:
        SceneFileError: it is not.
    """
    path = Path(path)
    if path.suffix.lower() not in (*USD, *GLTF):
        raise SceneFileError(
            f"{path}: is no file of scenes with cameras; expected {', '.join((*USD, *GLTF))}"
        )
    if not path.is_file():
        wrong = "is a folder; name a file in it" if path.is_dir() else "does not exist; check the path"
        raise SceneFileError(f"{path}: {wrong}")
    return path
