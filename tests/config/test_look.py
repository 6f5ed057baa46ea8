"""What a config says of the lens's look: openings, aberrations, colour, cat's eyes."""

import imageio.v3 as iio
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax.config import ConfigError, build_camera, build_lens, build_look, load_config
from focusjax.geometry import Camera
from focusjax.lens import (
    AberratedLens,
    Apodized,
    ChromaticLens,
    DarkenedLens,
    FieldCurvature,
    Mask,
    Obstructed,
    Polygon,
    PowerProfile,
    Seidel,
    Squeezed,
    ThinLens,
    VignettedLens,
)
from focusjax.optics import FRAUNHOFER

CONFIG = """
[scene]
unlit = true
[[scene.objects]]
file = "wall.ply"
[camera]
position = [0, 0, 0]
look_at = [0, 0, -1]
focal_length_mm = 50
resolution = [64, 48]
[lens]
f_number = 2
focus_distance_m = 2
"""
OPENING = '{shape = "polygon", blades = 5, obstruction = 0.3, transmission = [1, 0.4], squeeze = 1.5}'
LOOK = [
    "lens.power_profile=[0, 0.1]",
    "lens.seidel.w040_px=0.5",
    "lens.seidel.w131_px=-1",
    "lens.colour.focus_offset=[-0.02, 0, 0.02]",
    "lens.colour.bands=5",
    "lens.field_curvature=[{pixel = [32, 24], offset = 0}, {pixel = [0, 0], offset = 0.1}]",
    "lens.cats_eyes={corner_shift = 0.7}",
]


@pytest.fixture
def path(tmp_path):
    (tmp_path / "look.toml").write_text(CONFIG)
    return tmp_path / "look.toml"


def lens_of(path, *overrides: str) -> tuple[Camera, ThinLens]:
    config = load_config(path, overrides)
    camera = build_camera(config)
    lens = build_lens(config, camera, solved=False)
    assert isinstance(lens, ThinLens)
    return camera, lens


def test_an_opening_is_made_from_the_inside_out(path):
    _, lens = lens_of(path, f"lens.aperture={OPENING}")
    squeezed = lens.aperture
    assert isinstance(squeezed, Squeezed)
    assert isinstance(squeezed.whole, Apodized)
    assert isinstance(squeezed.whole.outline, Obstructed)
    assert isinstance(squeezed.whole.outline.outline, Polygon)
    assert (float(squeezed.squeeze), float(squeezed.whole.outline.obstruction)) == (1.5, 0.3)


def test_an_opening_from_an_image_is_linear_light(path):
    iio.imwrite(path.with_name("star.png"), np.array([[0, 188], [255, 0]], dtype=np.uint8))
    _, lens = lens_of(path, 'lens.aperture={shape = "image", file = "star.png"}')
    assert isinstance(lens.aperture, Mask)
    # 188 of 255 in sRGB is half of white's light.
    np.testing.assert_allclose(lens.aperture.light.values[1:3, 1:3], [[0, 0.5], [1, 0]], atol=0.005)


def test_the_look_is_put_around_the_lens(path):
    config = load_config(path, LOOK)
    camera, lens = lens_of(path, *LOOK)
    tube = build_look(config, camera, lens)
    assert isinstance(tube, VignettedLens)
    assert isinstance(tube.lens, ChromaticLens)
    assert len(tube.channels()) == 5
    aberrated = tube.lens.lens
    assert isinstance(aberrated, AberratedLens)
    seidel, profile, curvature = aberrated.aberrations
    assert isinstance(seidel, Seidel)
    assert (float(seidel.w040), float(seidel.w131)) == (0.5, -1.0)
    assert float(seidel.full_radius) == pytest.approx(0.0125)
    assert isinstance(profile, PowerProfile)
    assert isinstance(curvature, FieldCurvature)
    assert float(curvature.dioptres[0, 0]) == pytest.approx(0.1)
    assert float(curvature.dioptres[24, 32]) == pytest.approx(0.0, abs=1e-9)
    assert aberrated.lens is lens
    assert jnp.isfinite(tube.ray(camera, jnp.array([3.0, 4.0]), jnp.array([0.1, 0.2])).a).all()


def test_the_glass_of_a_thin_lens_gives_each_channel_its_focal_length(path):
    """1 / f = (n - 1) (1 / R_1 - 1 / R_2): the film stays where the line d is in focus."""
    given = "lens.colour.glass={lines={C=1.6, d=1.61, F=1.63}}"
    camera, lens = lens_of(path, given)
    made = build_look(load_config(path, [given]), camera, lens)
    c, d, f = (FRAUNHOFER[name] ** -2.0 for name in "CdF")
    curve = np.polyfit([c, d, f], [1.6, 1.61, 1.63], 2)
    shape = 1 / 0.05 / 0.61
    film = 1 / (1 / 0.05 - 1 / 2)
    for channel, wavelength in zip(made.channels(), (650.0, 510.0, 475.0), strict=True):
        power = (np.polyval(curve, wavelength**-2.0) - 1) * shape
        sharp = power - 1 / film
        # In focus there, and nowhere else. Observed: 7e-14 px.
        blur = channel.lens.blur(camera, camera.principal_point, jnp.asarray(sharp))
        assert float(blur) == pytest.approx(0.0, abs=1e-9)
    assert float(made.blur(camera, camera.principal_point, jnp.asarray(0.5))) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("colour", "message"),
    [
        ("{glass={n=[1.5, 1.5]}}", "lens.colour.glass has n = .*; expected three indices"),
        ("{glass={name='F2'}, focus_offset=[0, 0, 0.1]}", "lens.colour has focus_offset and a glass"),
        ("{glass={name='F99'}}", "lens.colour.glass: there is no glass 'F99'; did you mean"),
        ("{glass={n=[1, 1, 1]}}", "lens.colour.glass: has the index 1 at the line d, as air"),
    ],
)
def test_glass_that_a_thin_lens_cannot_have(path, colour, message):
    camera, lens = lens_of(path)
    with pytest.raises(ConfigError, match=message):
        build_look(load_config(path, [f"lens.colour={colour}"]), camera, lens)


def test_a_profile_is_put_around_the_lens_and_refused_by_its_key(path):
    override = 'lens.profile={name = "gauss_f1.8"}'
    config = load_config(path, [override])
    camera, lens = lens_of(path, override)
    assert len(build_look(config, camera, lens).channels()) == 3
    path.with_name("mine.toml").write_text("title = 1")
    wrong = {
        'lens.profile={name = "gaus_f1.8"}': "no lens profile 'gaus_f1.8'; did you mean 'gauss_f1.8'?",
        'lens.profile={file = "mine.toml"}': "mine.toml: focal_length_mm is missing",
        'lens.profile={file = "none.xml", lens = "One"}': "none.xml: this lensfun file cannot be read",
    }
    for given, message in wrong.items():
        with pytest.raises(ConfigError, match=message) as caught:
            build_look(load_config(path, [given]), camera, lens)
        assert "look.toml: lens.profile: " in str(caught.value)
    twice = load_config(path, [override, "lens.natural_falloff=true"])
    with pytest.raises(ConfigError, match=r"and so has lens\.natural_falloff"):
        build_look(twice, camera, lens)


def test_a_lensfun_file_darkens_as_at_the_lens_s_opening(path):
    entries = "".join(
        f'<vignetting model="pa" focal="50" aperture="{number}" distance="2" k1="{k1}"/>'
        for number, k1 in ((2, -0.6), (8, -0.1))
    )
    path.with_name("db.xml").write_text(
        "<lensdatabase><lens><model>One</model><cropfactor>0.9</cropfactor><calibration>"
        f'<distortion model="poly3" focal="50" k1="-0.01"/>{entries}</calibration></lens></lensdatabase>'
    )
    for number, share in ((2, 1 - 0.6), (8, 1 - 0.1)):
        given = [f"lens.f_number={number}", 'lens.profile={file = "db.xml", lens = "One"}']
        camera, lens = lens_of(path, *given)
        made = build_look(load_config(path, given), camera, lens)
        assert isinstance(made, DarkenedLens)
        corner = jnp.array([float(made.falloff.heights[-1]) * float(camera.focal_px) / 0.05, 0.0])
        film = camera.principal_point + corner
        weight = [float(made.ray(camera, at, jnp.zeros(2)).weight) for at in (film, camera.principal_point)]
        assert weight[0] / weight[1] == pytest.approx(share, rel=1e-6)


def test_a_lens_without_a_look_stays_as_it_is(path):
    camera, lens = lens_of(path)
    assert build_look(load_config(path), camera, lens) is lens


def test_a_wavefront_grows_by_the_third_order_laws(path):
    """Kyaw eq. 6.3 to 6.7: spots as 1/N^3, h/N^2, h^2/N and h^2/N, distortion as h^3."""
    names = ("w040", "w131", "w222", "w220", "w311")
    waves = [f"lens.seidel.{name}_um=3" for name in names]

    def pixels(f_number: float, height_mm: float) -> np.ndarray:
        stated = [f"lens.f_number={f_number}", "lens.seidel.f_number=2", f"lens.seidel.height_mm={height_mm}"]
        config = load_config(path, [*waves, *stated])
        camera, lens = lens_of(path, *waves, *stated)
        made = build_look(config, camera, lens)
        assert isinstance(made, AberratedLens)
        return np.array([float(getattr(made.aberrations[0], name)) for name in names])

    wide = pixels(2.0, 20.0)
    # 2 N W on the sensor: 12 um, in pixels of which 64 are 36 mm.
    camera, _ = lens_of(path)
    micrometres = 1e6 * float(camera.sensor_width) / camera.width
    assert wide[0] == pytest.approx(12.0 / micrometres)
    in_waves = [f"lens.seidel.{name}_waves=6" for name in names]
    waves = [*in_waves, "lens.seidel.wavelength_nm=500"]
    np.testing.assert_allclose(pixels(2.0, 20.0), wide, rtol=1e-12)
    waves = in_waves
    wider = pixels(2.0, 20.0)
    np.testing.assert_allclose(wider, wide * 587.56 / 500, rtol=1e-12)
    wide = wider
    np.testing.assert_allclose(wide / pixels(8.0, 20.0), [64.0, 16.0, 4.0, 4.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(pixels(2.0, 10.0) / wide, [1.0, 2.0, 4.0, 4.0, 8.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("lens.aperture.obstruction=1", "lens.aperture.obstruction is 1; expected a number below 1"),
        ("lens.aperture.transmission=[1]", "lens.aperture.transmission"),
        ("lens.aperture.squeeze=0.5", "lens.aperture.squeeze is 0.5; expected a number of at least 1"),
        ("lens.power_profile=[0.1]", "lens.power_profile"),
        ("lens.colour.bands=4", "lens.colour has 4 bands; give an odd number"),
        ("lens.colour.magnification=[1, 0, 1]", "lens.colour.magnification"),
        ("lens.cats_eyes={disk = 1}", "lens.cats_eyes.corner_shift is missing"),
        ("lens.seidel.w041_px=1", "w041_px"),
        ("lens.seidel.w040_um=1", "lens.seidel has w040_um without the f_number that it is for"),
        ("lens.seidel={w040_um=1, w131_px=1, f_number=2}", "lens.seidel has w131_px and w040_um; give all"),
        ("lens.seidel={w040_um=1, w131_waves=1, f_number=2}", "has w040_um and w131_waves; give all"),
        (
            "lens.seidel={w040_um=1, wavelength_nm=500, f_number=2}",
            "wavelength_nm, but no coefficient in waves",
        ),
        (
            "lens.seidel={w040_px=1, f_number=2}",
            "lens.seidel has f_number, but no coefficient in micrometres or waves",
        ),
        (
            "lens.seidel={w040_waves=1, wavelength_nm=0.55, f_number=2}",
            "lens.seidel.wavelength_nm is 0.55; expected",
        ),
        ("lens.profile={}", "lens.profile needs exactly one of name and file"),
        ('lens.profile={file = "db.xml"}', "lens.profile has a lensfun file and no lens"),
        ("render={method = 'post', quality = 'draft'}", "render has quality, which is about tracing"),
        ("render={method = 'auto'}", "render has method = 'auto' and no quality to choose by; give one"),
        (
            "render={method = 'auto', quality = 'draft', view_dependent = true}",
            "render has view_dependent, which post-processing cannot do, and method = 'auto'; leave",
        ),
        (
            "render={method = 'auto', quality = 'draft', pixel_filter = 'tent'}",
            "render has pixel_filter, which post-processing cannot do, and method = 'auto'; leave",
        ),
        (
            "render={method = 'auto', quality = 'draft', rays = 8}",
            "render has rays, and a quality that finds its own number",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(path, override: str, message: str):
    overrides = ["lens.aperture.shape=disk", override]
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    assert message in str(caught.value)


def test_images_that_cannot_be_openings_are_refused(path):
    with pytest.raises(ConfigError, match=r"none\.png does not exist"):
        lens_of(path, 'lens.aperture={shape = "image", file = "none.png"}')
    iio.imwrite(path.with_name("black.png"), np.zeros((4, 4), dtype=np.uint8))
    with pytest.raises(ConfigError, match="black all over"):
        lens_of(path, 'lens.aperture={shape = "image", file = "black.png"}')
