"""Files of strangers: what they may refer to, and what they claim to hold."""

import json
import struct
import zlib

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from focusjax.scene import load_mesh, read_image

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"


def gltf(count):
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        # Without a view of data an accessor is all zeros.
        "accessors": [{"componentType": 5126, "type": "VEC3", "count": count}],
    }


def png(width, height):
    """A picture that says how large it is, and holds next to nothing."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


def glb(content):
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON") + text


def test_meshes_that_claim_more_than_there_is_memory_for(tmp_path):
    """44 GiB of zeros for 400 bytes of text."""
    (tmp_path / "a.gltf").write_text(json.dumps(gltf(4_000_000_000)))
    (tmp_path / "a.glb").write_bytes(glb(gltf(4_000_000_000)))
    for name in ("a.gltf", "a.glb"):
        with pytest.raises(ValueError, match=rf"{name} is too large: its accessors have 4000000000 elements"):
            load_mesh(tmp_path / name)


@pytest.mark.parametrize(("width", "height"), [(12_500, 12_500), (60_000, 60_000)])
def test_pictures_that_claim_more_than_there_is_memory_for(tmp_path, width, height):
    (tmp_path / "a.png").write_bytes(png(width, height))
    with pytest.raises(
        ValueError, match=r"image file .*a\.png cannot be read: .* pixels.*; make it smaller|so make"
    ):
        read_image(tmp_path / "a.png")


def test_exr_files_are_looked_at_before_they_are_read(tmp_path):
    path = tmp_path / "a.exr"
    pixels = {"RGB": np.zeros((2, 3, 3), np.float32)}
    with OpenEXR.File(
        {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, pixels
    ) as file:
        file.write(str(path))
    assert read_image(path).shape == (2, 3, 3)
    data = path.read_bytes()
    # The data window: from (0, 0) to (2, 1) is made to end at (29999, 29999).
    window = struct.pack("<4i", 0, 0, 2, 1)
    assert data.count(window) == 2
    path.write_bytes(data.replace(window, struct.pack("<4i", 0, 0, 29_999, 29_999)))
    with pytest.raises(ValueError, match="it has 30000 x 30000 pixels; expected at most 134 million"):
        read_image(path)


def obj(folder, material):
    folder.mkdir(exist_ok=True)
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{TRIANGLE}usemtl m\nf 1/1 2/2 3/3\n")
    (folder / "a.mtl").write_text(f"newmtl m\nKd 0.5 0.5 0.5\nmap_Kd {material}\n")
    return folder / "a.obj"


def test_a_mesh_may_not_read_files_elsewhere(tmp_path):
    Image.new("RGB", (1, 1)).save(tmp_path / "secret.png")
    path = obj(tmp_path / "theirs", "../secret.png")
    with pytest.raises(
        ValueError, match=r"a\.obj refers to \.\./secret\.png, outside the folders that may be"
    ):
        load_mesh(path, within=[tmp_path / "theirs"])
    assert load_mesh(path, within=[tmp_path]).name == "a"
    assert load_mesh(path).name == "a"


def test_a_path_of_another_machine_is_a_missing_texture(tmp_path):
    path = obj(tmp_path / "theirs", "/home/somebody/tree.png")
    with pytest.warns(UserWarning, match=r"refers to /home/somebody/tree\.png, which does not exist"):
        load_mesh(path, within=[tmp_path / "theirs"])
