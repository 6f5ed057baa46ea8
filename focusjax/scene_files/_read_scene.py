"""From a file to all that can be seen in it."""

from collections.abc import Sequence
from pathlib import Path

from focusjax.scene_files._gltf import gltf_scene
from focusjax.scene_files._read_camera import GLTF, checked, folders_of
from focusjax.scene_files._stored import StoredScene
from focusjax.scene_files._usd_scene import usd_scene


def read_scene(path: str | Path, *, within: Sequence[str | Path] | None = None) -> StoredScene:
    """Meshes and lights of a USD stage (extra `usd`) or of a glTF file.

    Units and up axis of USD are converted to metres and +y up; lights become what a white surface shows.

    Args:
        path: a .usd, .usda, .usdc, .usdz, .gltf or .glb file.
        within: folders from which files may be read that it names; the file's own by default, and ["/"] for
            anywhere.

    Raises:
        SceneFileError: (a `ValueError`) a file that cannot be read, has no meshes, or has instanced or
            animated points; nodes that are their own ancestors, or nowhere; a glTF file that requires an
            extension that is not read; files outside `within`.

    Warns:
        UserWarning: what is left out: other shapes than meshes, lights with an extent, subdivision,
            skeletons, morph targets, extensions of glTF.

    Example:
        >>> import trimesh
        >>> _ = trimesh.creation.box().export("box.glb")
        >>> stored = fj.read_scene("box.glb")
        >>> len(fj.make_scene(stored.objects, lights=stored.lights).faces)
        12
    """
    path = checked(path)
    folders = folders_of(path, within)
    return gltf_scene(path, folders) if path.suffix.lower() in GLTF else usd_scene(path, folders)
