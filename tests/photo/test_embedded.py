"""Depth inside photographs of phones: made here, opened, and refused where it is damaged."""

import numpy as np
import pytest
from depth_photos import (
    FAR_M,
    NEAR_M,
    XMP,
    disk_scene,
    dynamic_depth_jpeg,
    gdepth_jpeg,
    heic,
    jpeg,
    with_segments,
)

from focusjax.photo import PhotoError, load_photo

WIDTH, HEIGHT = 64, 48


def opened(folder, data, name="phone.jpg", **settings):
    file = folder / name
    file.write_bytes(data)
    return load_photo(file, focal_length_35mm=26, align_px=0, **settings)


@pytest.mark.parametrize("kind", ["gdepth", "extended", "millimetres", "dynamic depth"])
def test_android_photographs_bring_their_depth_and_unit(tmp_path, kind):
    picture, depth = disk_scene(WIDTH, HEIGHT)
    data = {
        "gdepth": lambda: gdepth_jpeg(picture, depth),
        "extended": lambda: gdepth_jpeg(picture, depth, extended=True),
        "millimetres": lambda: gdepth_jpeg(picture, depth, units="mm", per_metre=1000),
        "dynamic depth": lambda: dynamic_depth_jpeg(picture, depth),
    }[kind]()
    found = opened(tmp_path, data)
    np.testing.assert_allclose(found.disparity, 1 / depth, rtol=1e-6)


def test_a_heic_brings_its_depth_and_unit(tmp_path):
    pytest.importorskip("pi_heif", reason="extra photo is not installed")
    picture, depth = disk_scene(WIDTH, HEIGHT)
    greys = np.round(255 * (1 / depth - 1 / FAR_M) / (1 / NEAR_M - 1 / FAR_M)).astype(np.uint8)
    found = opened(tmp_path, heic(picture, greys), "phone.heic")
    # The encoder is off by one grey at most: 1.5 / 255.
    np.testing.assert_allclose(found.disparity, 1 / depth, atol=0.006)
    assert found.light[HEIGHT // 2, WIDTH // 2, 0] > 0.5
    with pytest.raises(PhotoError, match="there is no depth in this photograph"):
        opened(tmp_path, heic(picture), "plain.heic")
    with pytest.raises(PhotoError, match=r"phone.heic: this photograph cannot be read"):
        opened(tmp_path, heic(picture, greys)[:200], "phone.heic")
    said = r"the file says that its depth is in 1/m, and depth_unit is 'mm'"
    with pytest.raises(PhotoError, match=said):
        opened(tmp_path, heic(picture, greys), "phone.heic", depth_unit="mm")


def test_damaged_or_dangerous_metadata_are_refused(tmp_path):
    picture, depth = disk_scene(WIDTH, HEIGHT)
    with pytest.raises(PhotoError, match=r"its depth map should be \d+ bytes from \d+ on, but the file ends"):
        opened(tmp_path, dynamic_depth_jpeg(picture, depth, cut=40))
    bomb = (
        b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        b"&b;</x:xmpmeta>"
    )
    with pytest.raises(PhotoError, match="its XMP declares a document type or an entity"):
        opened(tmp_path, with_segments(jpeg(picture), [XMP + bomb]))
    whole = gdepth_jpeg(picture, depth)
    with pytest.raises(PhotoError, match="GDepth:Data is no base64"):
        opened(tmp_path, whole.replace(b'GDepth:Data="iVBO', b'GDepth:Data="!!!!'))
    with pytest.raises(PhotoError, match="expected 0 < near < far"):
        opened(tmp_path, whole.replace(b'Near="0.5"', b'Near="9.5"'))
    with pytest.raises(PhotoError, match="its XMP is damaged"):
        opened(tmp_path, whole.replace(b"</rdf:RDF>", b"</rdf:RDX>"))
