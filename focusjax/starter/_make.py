"""The folder that `focusjax new` makes."""

import importlib.resources
import re
from pathlib import Path

from focusjax.config import schema_text
from focusjax.io import whole_folder

SCHEMA = "focusjax.schema.json"
"""The schema's file beside the config, which its first line names for editors."""
_MESHES = ("spot.glb", "bulbs.ply", "floor.obj")


def make_starter(folder: Path) -> Path:
    """Make `folder` with a commented config of the folder's name, its meshes, and its schema for editors.

    Args:
        folder: must not be there yet.

    Returns:
        The config's path.

    Raises:
        ValueError: it is there already, or has no name that a folder can have; nothing is written.
        OSError: it cannot be written.
    """
    if folder.suffix == ".toml" or not folder.name or not folder.name.isprintable():
        raise ValueError(f"{folder} is no name for a folder; expected one such as first_picture")
    if folder.exists() or folder.is_symlink():
        raise ValueError(f"{folder} is there already, and nothing is overwritten; choose another name")
    held = importlib.resources.files("focusjax.starter")
    title = " ".join(re.split(r"[\s_-]+", folder.name)).strip().capitalize() or folder.name
    text = (held / "starter.toml").read_text(encoding="utf-8")
    text = text.replace("@TITLE@", _escaped(title))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with whole_folder(folder) as stage:
        for mesh in _MESHES:
            (stage / mesh).write_bytes((held / mesh).read_bytes())
        (stage / SCHEMA).write_text(schema_text(), encoding="utf-8")
        (stage / f"{folder.name}.toml").write_text(text, encoding="utf-8")
    return folder / f"{folder.name}.toml"


def _escaped(text: str) -> str:
    """As it stands between quotes in TOML."""
    return text.replace("\\", "\\\\").replace('"', '\\"')
