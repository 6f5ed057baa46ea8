"""What is known without a solve is refused without one."""

import pytest
from boxes_config import write_boxes
from exchange_cameras import round_lens, slid_camera

import focusjax as fj
from focusjax._arguments import ArgumentError
from focusjax.config import load_config
from focusjax.exchange import TARGETS, ExportError, export_config
from focusjax.lens import prescription_lens
from focusjax.optics import lens_preset

GLASS = "lens.prescription='gauss_us2673491_f2_1954'"
SURFACE = "lens={f_number=2, focal_surface={points=[{pixel=[1,1], blur_px=0}]}}"
SHOT = "shot={frames=3}"
BLADES = "lens.aperture={shape='polygon', blades=5}"


@pytest.fixture
def unsolved(monkeypatch):
    def solve(*_, **__):
        raise AssertionError("solved")

    monkeypatch.setattr("focusjax.exchange._solved.run", solve)
    monkeypatch.setattr("focusjax.shot.build_shot", solve)


def exported(folder, to, *changes, **how):
    """Without wishes for a focal surface, whose only settings are its points."""
    base = ["solve={}", "focus=[]"] if SURFACE in changes else []
    config = load_config(write_boxes(folder), [*base, *changes])
    file = how.pop("file", f"a{TARGETS[to].suffix}")
    return export_config(config, folder / file, to=to, **how)


CASES = {
    (
        "usd",
        "lens.swing_deg=3",
    ): "USD cannot express a lens turned against the sensor (tilt 0, swing 3 degrees)",
    (
        "mitsuba",
        BLADES,
    ): "Mitsuba cannot express an opening of 5 blades; export to usd, blender or gltf, which",
    ("usd", GLASS): "USD cannot express a real lens (gauss_us2673491_f2_1954); export to pbrt, which can",
    ("pbrt", SURFACE): "pbrt cannot express a focal surface; export to blender, which can, or add --approx",
    ("gltf", "camera.rise_mm=2"): "glTF cannot express a shifted lens (shift 0, rise 2 mm); export to usd,",
    ("usd", "lens.seidel={w131_px=2}"): "USD cannot express aberrations; add --approximate",
}


@pytest.mark.parametrize(
    ("to", "change"), CASES, ids=["swing", "blades", "glass", "surface", "rise", "seidel"]
)
def test_what_the_config_says_is_refused_before_the_solve(tmp_path, unsolved, to, change):
    single = change in (GLASS, SURFACE)
    for more, shot in (((), False),) if single else (((), False), ((SHOT,), True)):
        with pytest.raises(ExportError) as refused:
            exported(tmp_path, to, change, *more, shot=shot)
        assert str(refused.value).startswith(f"{tmp_path / 'boxes.toml'}: {CASES[to, change]}")
    with pytest.raises(AssertionError, match="solved"):
        exported(tmp_path, to, change, approximate=True)


@pytest.mark.parametrize(
    ("change", "key", "what"),
    [(GLASS, "prescription", "a real lens"), (SURFACE, "focal_surface", "a focal surface")],
    ids=["glass", "surface"],
)
@pytest.mark.parametrize("approximate", [False, True])
def test_shots_of_what_has_single_pictures_alone(tmp_path, unsolved, change, key, what, approximate):
    said = (
        f"boxes.toml: has lens.{key}, and {what} is exported for a single picture, not for a shot; leave out"
        " --shot (shot=False), or the [shot] table"
    )
    with pytest.raises(ExportError) as refused:
        exported(tmp_path, "pbrt", change, SHOT, shot=True, approximate=approximate)
    assert said in str(refused.value)


def test_an_ending_is_checked_before_the_solve(tmp_path, unsolved):
    with pytest.raises(ArgumentError, match=r"a\.usdc does not end in \.usda, which USD expects"):
        exported(tmp_path, "usd", file="a.usdc")


def test_what_a_solve_may_change_waits_for_it(tmp_path, unsolved):
    tilt = "shot={frames=3, lens=[{frame=1, tilt_deg=0}]}"
    for changes, how in (
        (["lens.tilt_deg=3", 'solve.free=["tilt"]'], {}),
        (["lens.tilt_deg=3", tilt], {"shot": True}),
        (["camera.rise_mm=2", 'solve.free=["rise"]'], {}),
    ):
        with pytest.raises(AssertionError, match="solved"):
            exported(tmp_path, "gltf" if "rise" in changes[0] else "usd", *changes, **how)


def test_a_shot_in_python_says_which_of_the_two_it_has(tmp_path):
    camera = slid_camera(shift=0.0, rise=0.0)
    surface = fj.focal_surface([(10, 20), (50, 20), (30, 50)], [0.5, 1.0, 0.8])
    bent = fj.focal_surface_lens(surface, camera, round_lens())
    glass = prescription_lens(
        lens_preset("gauss_us2673491_f2_1954"), camera, focus_distance=2.0, f_number=4.0
    )
    for lens, said in ((bent, "has a focal surface"), (glass, "is a real lens")):
        with pytest.raises(
            ArgumentError, match=rf"{said}, which is exported for a single picture and not for"
        ):
            fj.export_camera([camera] * 2, [lens] * 2, tmp_path / "c.pbrt", to="pbrt")
