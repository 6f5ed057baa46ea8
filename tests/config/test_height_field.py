"""A lens from pictures of its surfaces in a config: read, built, run, and refused where it cannot be."""

import json

import imageio.v3 as iio
import numpy as np
import OpenEXR
import pytest
from boxes_config import write_boxes
from typer.testing import CliRunner

from focusjax.cli import app
from focusjax.config import Config, ConfigError, build_camera, build_lens, build_real_lens, load_config
from focusjax.config._build_real import _whole
from focusjax.lens import PrescriptionLens, ThinLens
from focusjax.optics import find_glass, first_order, lens_preset, singlet

RADIUS, WIDTH, SCALE = 60.0, 28.0, 2.0
GLASS = "lens.height_field.glass={n_d=1.5168, v_d=64.17}"
KEYS = [
    f"lens.height_field.width_mm={WIDTH}",
    f"lens.height_field.scale_mm={SCALE}",
    "lens.height_field.thickness_mm=4",
    "lens.height_field.diameter_mm=18",
    GLASS,
    "lens.f_number=8",
]


def sphere_heights(count=128):
    """From 0 to 1, of a sphere in the middle."""
    y, x = np.meshgrid(*[np.linspace(-WIDTH / 2, WIDTH / 2, count)] * 2, indexing="ij")
    return 1.0 + (np.sqrt(RADIUS**2 - np.minimum(x**2 + y**2, 2 * RADIUS * SCALE * 0.95)) - RADIUS) / SCALE


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("heights")
    heights = sphere_heights()
    np.save(folder / "dome.npy", heights)
    np.save(folder / "grey.npy", np.full((16, 16), 0.4))
    np.save(folder / "hole.npy", np.where(heights > 0.9998, np.nan, heights))
    np.save(folder / "wide.npy", heights[:60])
    np.save(folder / "whole.npy", np.round(heights * 1000).astype(np.int32))
    iio.imwrite(folder / "dome.png", np.round(heights * 65535).astype(np.uint16))
    iio.imwrite(folder / "coarse.png", np.round(heights * 255).astype(np.uint8))
    channels = {"Y": heights.astype(np.float32)}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION}, channels).write(str(folder / "dome.exr"))
    (folder / "text.png").write_text("no picture")
    return write_boxes(folder)


def config_of(boxes, file, *more) -> Config:
    return load_config(boxes, [f'lens.height_field.file="{file}"', *KEYS, *more])


def lens_of(boxes, file, *more) -> PrescriptionLens:
    config = config_of(boxes, file, *more)
    camera = build_camera(config)
    thin = build_lens(config, camera, solved=False)
    assert isinstance(thin, ThinLens)
    lens = build_real_lens(config, camera, thin)
    assert isinstance(lens, PrescriptionLens)
    return lens


@pytest.mark.parametrize("file", ["dome.npy", "dome.png", "dome.exr"])
def test_each_kind_of_file_makes_the_same_lens(boxes, file):
    """A plano-convex singlet, whose focal length and back focus follow from its radius."""
    wanted = singlet(RADIUS, np.inf, thickness=4.0, semi_diameter=9.0, glass=find_glass("1.5168/64.17"))
    found, wanted = first_order(_whole(config_of(boxes, file))), first_order(wanted)
    for name in ("focal_length", "back_focal_distance"):
        assert float(getattr(found, name)) == pytest.approx(float(getattr(wanted, name)), rel=1e-4), name


def test_it_takes_the_focal_length_of_the_camera(boxes):
    found = first_order(lens_of(boxes, "dome.npy").prescription)
    assert float(found.focal_length) == pytest.approx(50.0, rel=1e-9)


@pytest.mark.slow
def test_a_run_focuses_it_by_its_rays_and_fits_polynomials(boxes, tmp_path):
    options = ["--set", 'lens.height_field.file="dome.npy"', "--set", "solve.free=['focus']"]
    # Nearer to the axis than there, since the field of one piece of glass is curved.
    options += ["--set", "focus.0.point=[-0.15, 0, -1.75]"]
    for key in KEYS:
        options += ["--set", key]
    result = CliRunner().invoke(app, ["run", str(boxes), *options, "--out", str(tmp_path)])
    assert result.exit_code in (0, 3), result.output
    glass = json.loads((tmp_path / "report.json").read_text())["lens"]["glass"]
    assert (glass["name"], glass["poor_fit"]) == ("dome", "")
    assert 0 < glass["fit"]["worst_px"] <= 0.05
    assert iio.imread(tmp_path / "image.png").std() > 10


def test_ahead_of_a_prescription_it_is_more_glass(boxes):
    more = 'lens.prescription="cooke_triplet_50mm_f4"', "lens.height_field.ahead_mm=6"
    whole = _whole(
        config_of(
            boxes, "grey.npy", *more, "lens.height_field.diameter_mm=20", "lens.height_field.width_mm=60"
        )
    )
    assert whole.name == "cooke_triplet_50mm_f4 behind grey"
    np.testing.assert_allclose(whole.thicknesses[:2], [4.0, 6.0])
    # A plate turns no ray from far away.
    alone = first_order(lens_preset("cooke_triplet_50mm_f4"))
    assert float(first_order(whole).focal_length) == pytest.approx(float(alone.focal_length))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ([], "lens.height_field.file is missing; give the front's heights"),
        (
            ['lens.height_field.file="a.npy"', "lens.height_field.width_mm=0"],
            "lens.height_field.width_mm is 0",
        ),
        (
            ['lens.height_field.file="a.npy"', "lens.height_field.thickness_mm=0"],
            "lens.height_field.thickness_mm is 0",
        ),
        (
            ['lens.height_field.file="a.npy"', "lens.height_field.glass={n_d=1.5}"],
            "has n_d = 1.5 without v_d",
        ),
        (
            ['lens.height_field.file="a.npy"', "lens.tilt_deg=3"],
            "has lens.height_field, but lens.tilt_deg is given; a lens with a height field is not turned",
        ),
        (
            ['lens.height_field.file="a.npy"', "solve.free=['focus', 'tilt']"],
            "has lens.height_field, but solve.free has 'tilt'; a lens with a height field is not turned",
        ),
        (
            ['lens.height_field.file="a.npy"', "lens.height_field.ahead_mm=3"],
            "has ahead_mm in its height_field and no prescription to be ahead of; leave it out",
        ),
        (
            ['lens.height_field.file="a.npy"', 'lens.prescription="cooke_triplet_50mm_f4"'],
            "has a height_field and a prescription, but not how far ahead of it; give ahead_mm",
        ),
        (
            ['lens.height_field.file="a.npy"', "lens.height_field.glass={n=[1.5, 1.51, 1.52]}"],
            "lens has n of red, green and blue for the height_field, and spectral is not true",
        ),
    ],
)
def test_tables_that_make_no_sense(boxes, overrides, message):
    with pytest.raises(ConfigError) as caught:
        load_config(boxes, [*KEYS, *overrides])
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("file", "more", "message"),
    [
        ("none.png", [], "none.png: there is no such picture of heights; check the path"),
        ("text.png", [], "text.png: these heights cannot be read"),
        (
            "coarse.png",
            [],
            "coarse.png: has 8 bits, whose 256 steps would be facets in glass; expected a grey",
        ),
        (
            "whole.npy",
            [],
            "whole.npy: has whole numbers of type int32; expected a grey PNG",
        ),
        (
            "dome.npy",
            ["lens.height_field.glass={n=[1, 1, 1]}", "lens.spectral=true"],
            "lens.height_field: dome has glass of index 1; expected more than 1, such as 1.5168",
        ),
        (
            "dome.npy",
            ["lens.height_field.thickness_mm=0.3"],
            "lens.height_field: surface 0 and surface 1 of dome cross within their clear radius, by 0.3",
        ),
        ("wide.npy", [], "wide.npy: has 60 x 128 heights; expected as many rows as columns"),
        ("hole.npy", [], "hole.npy: has 4 heights that are not finite, the first in row 63, column 63"),
        ("grey.npy", [], "grey is afocal: it forms no image of far things on any film"),
        (
            "dome.npy",
            ["lens.height_field.diameter_mm=30"],
            "dome has a clear radius of 15 mm, and heights to 13",
        ),
        ("dome.npy", ["lens.height_field.scale_mm=-2"], "only a converging lens forms an image"),
        ("dome.npy", ["lens.height_field.glass={name='F99'}"], "lens.height_field: there is no glass 'F99'"),
        (
            "dome.npy",
            ["lens.aperture={shape='polygon', blades=6}"],
            "has a height field, whose stop is round",
        ),
    ],
)
def test_pictures_that_make_no_lens(boxes, file, more, message):
    with pytest.raises(ConfigError) as caught:
        lens_of(boxes, file, *more)
    assert message in str(caught.value)
