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
from PIL import Image

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


@pytest.mark.parametrize("kind", ["gdepth", "dynamic depth"])
def test_distances_along_rays_become_those_along_the_axis(tmp_path, kind):
    """A wall: all distances from the camera are 2 m, so that its corner is less far ahead."""
    picture, depth = disk_scene(WIDTH, HEIGHT)
    depth = np.full_like(depth, FAR_M)
    if kind == "gdepth":
        data = gdepth_jpeg(picture, depth, measure="OpticRay")
    else:
        data = dynamic_depth_jpeg(picture, depth, measure="OpticRay")
    found = opened(tmp_path, data)
    x, y = np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT)[:, None] + 0.5 - HEIGHT / 2
    focal = 26 / 43.2666 * np.hypot(WIDTH, HEIGHT)
    np.testing.assert_allclose(1 / found.disparity, FAR_M / np.sqrt(1 + (x**2 + y**2) / focal**2), rtol=1e-5)
    # 26 mm: the corner is 39.8 degrees off the axis, less half a pixel.
    assert 1 / found.disparity[0, 0] == pytest.approx(FAR_M * np.cos(np.arctan(43.2666 / 2 / 26)), rel=0.01)


def test_other_measures_of_distance_are_refused(tmp_path):
    data = gdepth_jpeg(*disk_scene(WIDTH, HEIGHT), measure="Sonar")
    with pytest.raises(PhotoError, match="has MeasureType = Sonar; expected OpticalAxis or OpticRay"):
        opened(tmp_path, data)


@pytest.mark.parametrize("orientation", [3, 6])
@pytest.mark.parametrize("upright", [False, True])
def test_depth_inside_a_turned_photograph_is_turned_unless_its_shape_says_that_it_was(
    tmp_path, orientation, upright
):
    picture, depth = disk_scene(WIDTH, HEIGHT)
    depth = np.where(np.arange(HEIGHT)[:, None] < 6, FAR_M, NEAR_M) + np.zeros_like(depth)
    turned = np.rot90(depth, -1) if orientation == 6 else np.rot90(depth, 2)
    exif = Image.Exif()
    exif[0x0112] = orientation
    found = opened(tmp_path, gdepth_jpeg(picture, turned if upright else depth, exif=exif))
    # Where the shape cannot say, the map is as the stored pixels are.
    wanted = np.rot90(turned, 2) if upright and orientation == 3 else turned
    np.testing.assert_allclose(found.disparity, 1 / wanted, rtol=1e-6)


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
    for length in (200, 1200):
        with pytest.raises(PhotoError, match=r"phone.heic: this photograph cannot be read") as caught:
            opened(tmp_path, heic(picture, greys)[:length], "phone.heic")
        assert "\n" not in str(caught.value)
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
