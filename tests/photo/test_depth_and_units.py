"""Depth files and their units: values by hand, holes, and a sentence for everything that cannot be used."""

import struct
import warnings

import numpy as np
import OpenEXR
import pytest
from depth_photos import disk_scene, jpeg, png, png16
from PIL import Image

from focusjax.photo import PhotoError, load_photo
from focusjax.photo._depth_file import read_depth
from focusjax.photo._units import DepthUnit, disparity_of

WIDTH, HEIGHT = 48, 36


@pytest.fixture
def photo_file(tmp_path):
    file = tmp_path / "photo.jpg"
    file.write_bytes(jpeg(disk_scene()[0]))
    return file


def load(photo_file, name, **settings):
    return load_photo(
        photo_file, depth=photo_file.parent / name, focal_length_35mm=26, align_px=0, **settings
    )


def pfm(values, order):
    head = f"Pf\n{values.shape[1]} {values.shape[0]}\n{'-1.0' if order == '<' else '1.0'}\n".encode()
    return head + np.flipud(values).astype(f"{order}f4").tobytes()


@pytest.mark.parametrize("kind", ["8 bit", "16 bit", "npy", "pfm little", "pfm big", "exr"])
def test_every_kind_of_file_gives_the_same_disparity(photo_file, kind):
    _, depth = disk_scene()
    folder = photo_file.parent
    if kind == "8 bit":
        (folder / "d.png").write_bytes(png((depth * 100).astype(np.uint8)))
        name, settings = "d.png", {"depth_unit": "m", "depth_scale": 0.01}
    elif kind == "16 bit":
        Image.fromarray((depth * 1000).astype(np.uint16)).save(folder / "d.png")
        name, settings = "d.png", {"depth_unit": "mm"}
    elif kind == "npy":
        np.save(folder / "d.npy", 1 / depth)
        name, settings = "d.npy", {"depth_unit": "1/m"}
    elif kind == "exr":
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"Z": depth.astype(np.float32)}) as file:
            file.write(str(folder / "d.exr"))
        name, settings = "d.exr", {"depth_unit": "m"}
    else:
        (folder / "d.pfm").write_bytes(pfm(depth, "<" if "little" in kind else ">"))
        name, settings = "d.pfm", {"depth_unit": "m"}
    found = load(photo_file, name, **settings)
    np.testing.assert_allclose(found.disparity, 1 / depth, rtol=1e-6)
    assert found.measured.all()


def test_stereo_disparity_and_anchors(photo_file):
    _, depth = disk_scene()
    pixels = 900.0 * 0.2 / depth - 30.0
    np.save(photo_file.parent / "d.npy", pixels * 4)
    found = load(
        photo_file,
        "d.npy",
        depth_unit="px",
        depth_scale=0.25,
        depth_focal_px=900,
        baseline_m=0.2,
        depth_offset_px=30,
    )
    np.testing.assert_allclose(found.disparity, 1 / depth, rtol=1e-6)
    np.save(photo_file.parent / "r.npy", 200 - 50 / depth)
    for anchors in ([(24, 18, 0.5), (2, 2, 2.0)], [(100, 0.5), (175, 2.0)]):
        found = load(photo_file, "r.npy", depth_unit="relative", anchors=anchors)
        np.testing.assert_allclose(found.disparity, 1 / depth, rtol=1e-5)


def test_holes_are_no_depth(photo_file):
    _, depth = disk_scene()
    depth = depth.copy()
    depth[5:10, 5:10], depth[0, 0], depth[0, 1] = np.nan, -3, np.inf
    np.save(photo_file.parent / "d.npy", depth)
    found = load(photo_file, "d.npy", depth_unit="m")
    assert not found.measured[5:10, 5:10].any()
    assert not found.measured[0, 0]
    assert (~found.measured).sum() == 26
    # Infinitely far is a depth.
    assert found.disparity[0, 1] == 0
    np.testing.assert_allclose(found.disparity[5:10, 5:10], 0.5, rtol=1e-6)
    assert np.isfinite(found.disparity).all()


def refused(photo_file, name="d.png", **settings):
    with pytest.raises(PhotoError) as caught:
        load(photo_file, name, **settings)
    return str(caught.value)


def test_what_is_missing_or_contradicts_itself_is_refused_in_words(photo_file):
    folder = photo_file.parent
    _, depth = disk_scene()
    (folder / "d.png").write_bytes(png((depth * 100).astype(np.uint8)))
    said = refused(photo_file)
    assert "d.png: nothing says what the values of this depth map mean; give depth_unit" in said
    said = refused(photo_file, depth_unit="relative", anchors=[(1, 1, 2.0), (24, 18, 2.0)])
    assert "both anchors are 2 m away, which makes everything flat" in said
    said = refused(photo_file, depth_unit="relative", anchors=[(1, 1, 2.0), (50, 0.5)])
    assert "one anchor is a place [x, y, metres] and the other a value [value, metres]" in said
    assert "focal length of the stereo pair" in refused(photo_file, depth_unit="px")
    said = refused(photo_file, depth_unit="m", baseline_m=0.1)
    assert "baseline_m is of a stereo pair, whose depth unit is 'px', and the unit is 'm'; leave" in said
    assert "needs two anchors, and has 0" in refused(photo_file, depth_unit="relative")
    said = refused(photo_file, depth_unit="relative", anchors=[(1, 1, 2.0), (3, 1, 1.0)])
    assert "both anchors have the value 200" in said
    assert "no such depth map" in refused(photo_file, "none.png", depth_unit="m")
    (folder / "cut.png").write_bytes((folder / "d.png").read_bytes()[:60])
    assert "cut.png: this depth map cannot be read" in refused(photo_file, "cut.png", depth_unit="m")
    (folder / "cut.pfm").write_bytes(pfm(depth, "<")[:-9])
    assert "the PFM file is cut off" in refused(photo_file, "cut.pfm", depth_unit="m")
    Image.fromarray(disk_scene()[0]).save(folder / "colour.png")
    assert "is a colour picture (RGB)" in refused(photo_file, "colour.png", depth_unit="m")
    assert ": this is a folder, not a depth map; name a file in it" in refused(photo_file, "")
    head = b"Pf\n%s\n-1.0\n" + bytes(64)
    (folder / "less.pfm").write_bytes(head % b"-4 -4")
    assert "less.pfm: the PFM file is of -4 x -4 pixels; expected 1" in refused(photo_file, "less.pfm")
    (folder / "text.pfm").write_bytes(head % b"a b")
    assert "text.pfm: the PFM file has no width, height and scale" in refused(photo_file, "text.pfm")
    (folder / "more.pfm").write_bytes(head % b"99999 99999")
    assert "more.pfm: it has 99999 x 99999 pixels; expected at most" in refused(photo_file, "more.pfm")
    np.save(folder / "empty.npy", np.full((HEIGHT, WIDTH), np.nan))
    assert "no value of this depth map is valid" in refused(photo_file, "empty.npy", depth_unit="m")
    near = np.ones((HEIGHT, WIDTH))
    near[3, 4] = 1e-30
    np.save(folder / "near.npy", near)
    assert "in m the nearest place is 1e-30 m away" in refused(photo_file, "near.npy", depth_unit="m")
    np.save(folder / "wide.npy", np.ones((HEIGHT, 2 * WIDTH)))
    said = refused(photo_file, "wide.npy", depth_unit="m")
    assert "the depth map is 96 x 36 pixels" in said
    assert "photograph photo.jpg 48 x 36" in said


def test_arrays_are_refused_by_their_header(photo_file):
    def header(shape, length):
        text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
        return b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text + bytes(length)

    file = photo_file.parent / "d.npy"
    file.write_bytes(header((1000000, 1000000), 800))
    said = refused(photo_file, "d.npy", depth_unit="m")
    assert "d.npy: it has 1000000 x 1000000 pixels; expected at most 134 million, so make it smaller" in said
    file.write_bytes(header((HEIGHT, WIDTH), 800))
    said = refused(photo_file, "d.npy", depth_unit="m")
    assert "d.npy: the NPY file is cut off (800 of 13824 bytes); copy it again" in said
    file.write_bytes(b"\x93NUM")
    assert "d.npy: this depth map cannot be read" in refused(photo_file, "d.npy", depth_unit="m")


@pytest.mark.parametrize("mode", ["LA", "RGBA"])
def test_transparent_depth_is_a_hole(photo_file, mode):
    grey = (disk_scene()[1] * 100).astype(np.uint8)
    alpha = np.where(np.arange(WIDTH) < 5, 0, 255).astype(np.uint8) + np.zeros_like(grey)
    Image.fromarray(np.dstack([grey] * (len(mode) - 1) + [alpha]), mode).save(photo_file.parent / "d.png")
    found = load(photo_file, "d.png", depth_unit="m", depth_scale=0.01)
    assert not found.measured[:, :5].any()
    assert found.measured[:, 5:].all()


def test_three_equal_channels_of_8_bits_are_one(photo_file):
    """An uncompressed picture, of which a row has 160 bytes: no 16 bits."""
    grey = np.full((40, 53), 150, np.uint8)
    Image.fromarray(np.dstack([grey] * 3)).save(photo_file.parent / "d.bmp")
    found = load(photo_file, "d.bmp", depth_unit="m", depth_scale=0.01)
    np.testing.assert_allclose(found.disparity, 1 / 1.5, rtol=1e-6)


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_several_channels_of_16_bits_are_refused(photo_file, channels):
    """Pillow would give their upper 8 bits: depth 256 times too small."""
    values = np.repeat((disk_scene()[1] * 1000)[..., None], channels, axis=2)
    (photo_file.parent / "d.png").write_bytes(png16(values))
    said = refused(photo_file, depth_unit="mm")
    assert "d.png: this depth map has 16 bits in each of several channels" in said


@pytest.mark.parametrize(
    ("anchors", "said"),
    [
        # 0.5 1/m over 10 values: what is below 202 would be behind infinity.
        ([(212, 2.0), (222, 1.0)], r"with these anchors 7\d % of the depth map falls behind infinity"),
        ([(0, 1.0), (4, 0.8)], r"with these anchors the nearest places are 5\.\d cm away"),
    ],
)
def test_anchors_that_cannot_be_right_get_a_warning(photo_file, anchors, said):
    np.save(photo_file.parent / "d.npy", np.linspace(0, 255, WIDTH)[None].repeat(HEIGHT, 0))
    with pytest.warns(UserWarning, match=said):
        load(photo_file, "d.npy", depth_unit="relative", anchors=anchors)


def test_distances_that_no_photograph_has_get_a_warning(photo_file):
    file = photo_file.parent / "d.npy"
    np.save(file, disk_scene()[1])
    with pytest.warns(
        UserWarning, match=r"in mm half of the photograph is nearer than 0\.002 m, which is un"
    ):
        load(photo_file, "d.npy", depth_unit="mm")
    np.save(file, disk_scene()[1] * 1000)
    with pytest.warns(
        UserWarning, match=r"in m half of the photograph is farther than 2e\+03 m, which is un"
    ):
        load(photo_file, "d.npy", depth_unit="m")
    for far in (np.inf, 1e10):
        np.save(file, np.full((HEIGHT, WIDTH), far))
        said = refused(photo_file, "d.npy", depth_unit="m")
        assert "everything in this depth map is infinitely far, which leaves nothing to refocus" in said


@pytest.mark.parametrize(("unit", "called"), [("m", "metres"), ("mm", "millimetres")])
def test_greys_called_metres_get_a_warning(photo_file, unit, called):
    grey = np.linspace(30, 255, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH).astype(np.uint8)
    (photo_file.parent / "d.png").write_bytes(png(grey))
    with pytest.warns(UserWarning, match=r"values of 0 to 255 look like 8-bit greys, not " + called + ";"):
        load(photo_file, "d.png", depth_unit=unit)


def test_the_photograph_itself_is_refused_in_words(tmp_path):
    file = tmp_path / "photo.jpg"
    with pytest.raises(PhotoError, match="there is no such photograph"):
        load_photo(file)
    with pytest.raises(PhotoError, match="this is a folder, not a photograph; name a file in it"):
        load_photo(tmp_path)
    whole = jpeg(disk_scene()[0])
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PhotoError, match="this photograph cannot be read"):
        load_photo(file)
    file.write_bytes(whole)
    with pytest.raises(PhotoError, match="there is no depth in this photograph"):
        load_photo(file)
    np.save(tmp_path / "d.npy", disk_scene()[1])
    with pytest.raises(PhotoError, match="EXIF does not say the focal length"):
        load_photo(file, depth=tmp_path / "d.npy", depth_unit="m")
    with pytest.raises(PhotoError, match="the curve is 'log'"):
        load_photo(file, depth=tmp_path / "d.npy", depth_unit="m", curve="log")


def exif(orientation, film_mm=None):
    made = Image.Exif()
    made[0x0112] = orientation
    if film_mm is not None:
        made.get_ifd(0x8769)[0xA405] = film_mm
    return made


@pytest.mark.parametrize("upright_depth", [False, True])
def test_exif_turns_the_photograph_and_its_depth(tmp_path, upright_depth):
    picture, depth = disk_scene()
    depth = depth.copy()
    depth[:6] = 4.0
    file = tmp_path / "photo.jpg"
    # Orientation 6: shown after a quarter turn clockwise.
    file.write_bytes(jpeg(picture, exif(6, 26)))
    np.save(tmp_path / "d.npy", np.rot90(depth, -1) if upright_depth else depth)
    found = load_photo(file, depth=tmp_path / "d.npy", depth_unit="m", align_px=0)
    assert (found.camera.width, found.camera.height) == (HEIGHT, WIDTH)
    np.testing.assert_allclose(found.disparity[:, -6:], 0.25, rtol=1e-6)
    np.testing.assert_allclose(float(found.camera.focal_px), 26 / 43.2666 * np.hypot(48, 36), rtol=1e-5)
    file.write_bytes(jpeg(picture, exif(3, 26)))
    with pytest.raises(PhotoError, match=r"EXIF turns this photograph \(orientation 3\)"):
        load_photo(file, depth=tmp_path / "d.npy", depth_unit="m")


def test_light_is_linear_and_highlights_grow_by_the_stated_rule(tmp_path):
    grey = np.full((HEIGHT, WIDTH, 3), 188, np.uint8)
    grey[0] = 255
    Image.fromarray(grey).save(tmp_path / "p.png")
    np.save(tmp_path / "d.npy", disk_scene()[1])
    rest = {"depth": tmp_path / "d.npy", "depth_unit": "m", "focal_length_px": 40, "align_px": 0}
    assert load_photo(tmp_path / "p.png", **rest).light[9, 9, 0] == pytest.approx(0.5029, abs=1e-4)
    assert load_photo(tmp_path / "p.png", curve=2.0, **rest).light[9, 9, 0] == pytest.approx((188 / 255) ** 2)
    brighter = load_photo(tmp_path / "p.png", highlight_stops=3, **rest).light
    assert brighter[0, 0, 0] == pytest.approx(8.0)
    assert brighter[9, 9, 0] == pytest.approx(0.5029, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "mode"),
    [("p.png", "I;16"), ("p.tiff", "I;16"), ("p.tiff", "I;16B"), ("p.pgm", "I;16"), ("p.tiff", "I")],
)
def test_greys_of_16_bits_keep_their_range(tmp_path, name, mode):
    ramp = np.linspace(0, 65535, WIDTH).astype(np.uint16)[None].repeat(HEIGHT, 0)
    kind = {"I;16": "<u2", "I;16B": ">u2", "I": "<i4"}[mode]
    picture = Image.frombytes(mode, (WIDTH, HEIGHT), ramp.astype(kind).tobytes())
    picture.save(tmp_path / name)
    np.save(tmp_path / "d.npy", np.full((HEIGHT, WIDTH), 2.0))
    rest = {"depth": tmp_path / "d.npy", "depth_unit": "m", "focal_length_px": 40, "curve": "linear"}
    light = load_photo(tmp_path / name, **rest).light
    np.testing.assert_allclose(light, (ramp / 65535)[..., None].repeat(3, 2), atol=1e-7)
    if name == "p.png":
        picture.save(tmp_path / name, exif=exif(6))
        turned = load_photo(tmp_path / name, **rest).light
        np.testing.assert_allclose(turned, np.rot90(light, -1), atol=1e-7)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGBA", "CMYK", "YCbCr", "LAB"])
def test_pictures_of_8_bits_of_any_kind_are_read(tmp_path, mode):
    grey = np.where(np.arange(WIDTH) < 9, 0, 255).astype(np.uint8)[None].repeat(HEIGHT, 0)
    grey = Image.fromarray(np.dstack([grey] * 3))
    if mode == "LAB":
        plain = Image.new("L", grey.size, 128)
        made = Image.merge("LAB", [grey.getchannel(0), plain, plain])
    else:
        made = grey.convert(mode)
    made.save(tmp_path / "p.tiff")
    np.save(tmp_path / "d.npy", np.full((HEIGHT, WIDTH), 2.0))
    found = load_photo(tmp_path / "p.tiff", depth=tmp_path / "d.npy", depth_unit="m", focal_length_px=40)
    np.testing.assert_allclose(found.light[5, [2, 30]], [[0, 0, 0], [1, 1, 1]], atol=0.02)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.full((HEIGHT, WIDTH), 0.5, np.float32), "the greys of this photograph are floats"),
        (np.full((HEIGHT, WIDTH), 70000, np.int32), "go from 70000 to 70000; expected 0 to 65535"),
    ],
)
def test_greys_without_a_white_are_refused(tmp_path, values, said):
    Image.fromarray(values).save(tmp_path / "p.tiff")
    with pytest.raises(PhotoError, match=rf"p\.tiff: .*{said}"):
        load_photo(tmp_path / "p.tiff")


def test_the_step_of_stored_values_becomes_one_of_disparity(tmp_path):
    (tmp_path / "d.png").write_bytes(png(np.full((4, 4), 100, np.uint8)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = disparity_of(read_depth(tmp_path / "d.png"), DepthUnit("m", scale=0.02), (4, 4))
    assert found[0][0, 0] == pytest.approx(0.5)
    assert found[2] == pytest.approx(0.02 / 4)


@pytest.mark.parametrize("kind", ["one part", "layers", "parts", "half"])
def test_colour_and_depth_of_another_renderer_are_a_scene(tmp_path, capfd, kind):
    """As Mitsuba, Blender (layers in one part, Z of 1e10 where nothing is) and Nuke (parts) name them."""
    picture, depth = disk_scene()
    light = (picture / 255.0).astype(np.float16 if kind == "half" else np.float32)
    z = depth.astype(np.float32)
    z[:3] = 1e10
    rgb = dict(zip("RGB", np.moveaxis(light, 2, 0).copy(), strict=True))
    noise = {f"ViewLayer.Normal.{c}": np.zeros_like(z) for c in "XYZ"}
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if kind == "layers":
        named = {f"ViewLayer.Combined.{c}": plane for c, plane in rgb.items()}
        named |= {f"ViewLayer.DiffCol.{c}": np.zeros_like(z) for c in "RGB"}
        parts = [OpenEXR.Part(head, named | noise | {"ViewLayer.Depth.Z": z})]
    elif kind == "parts":
        parts = [OpenEXR.Part(head | {"name": "beauty"}, rgb), OpenEXR.Part(head | {"name": "z"}, {"Z": z})]
    else:
        parts = [OpenEXR.Part(head, rgb | {"Z": z})]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "frame.exr"))
    found = load_photo(tmp_path / "frame.exr", depth_unit="m", focal_length_px=60)
    np.testing.assert_allclose(found.light, light, rtol=1e-6)
    # Rendered edges are where they are.
    np.testing.assert_allclose(found.disparity, 1 / z, rtol=1e-6)
    assert found.edge_px == 1
    (tmp_path / "cut.exr").write_bytes((tmp_path / "frame.exr").read_bytes()[:700])
    with pytest.raises(PhotoError, match=r"cut\.exr cannot be read: it is cut off or damaged; copy it again"):
        load_photo(tmp_path / "cut.exr", depth_unit="m", focal_length_px=60)
    assert capfd.readouterr() == ("", "")
