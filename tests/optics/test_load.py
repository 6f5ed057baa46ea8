"""Glasses and lens files: what is read, and what is refused in which words."""

import codecs
from importlib import resources

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import GLASS

from focusjax.optics import (
    LensFileError,
    abbe_number,
    air,
    first_order,
    lens_preset,
    line,
    load_lens,
    make_prescription,
    singlet,
    sphere,
)

SINGLET_DAT = "# a comment\n50 5 1.5168 18\n\n-50 2 1 18 # rear\n0 40 0 10\n"


def zemax(*, glass="GLAS N-BK7 0 0 1.5168 64.17", surface="TYPE STANDARD", stop="STOP", more="DIAM 9 1"):
    return (
        "MODE SEQ\nUNIT MM X W X CM MR CPMM\nSURF 0\nTYPE STANDARD\nCURV 0\nDISZ INFINITY\n"
        f"SURF 1\n{surface}\nCURV 0.02\n{stop}\nDISZ 5\n{glass}\n{more}\n"
        "SURF 2\nTYPE STANDARD\nCURV -0.02\nDISZ 45\nDIAM 9 1\nSURF 3\nTYPE STANDARD\nCURV 0\nDISZ 0\n"
    )


ASPHERE = (
    '{"type": "Aspheric", "r": 9, "roc": 50, "k": -1.5, "ai": [0, 1e-6, 2e-9], "d_next": 5, "mat2": "F2"}'
)


def json_lens(surface='{"type": "Spheric", "r": 9, "roc": -50, "d_next": 2, "mat2": "air"}'):
    return (
        '{"surfaces": [\n{"type": "Spheric", "r": 9, "roc": 50, "d_next": 5, "mat2": "N-BK7"},\n'
        f'{surface},\n{{"type": "Stop", "r": 5, "d_next": 40, "mat2": "air"}}\n]}}'
    )


def test_the_same_singlet_from_each_kind_of_file(write):
    wanted = float(first_order(singlet(50, -50, thickness=5, semi_diameter=9, glass=GLASS)).focal_length)
    for name, text in (("a.dat", SINGLET_DAT), ("a.zmx", zemax()), ("a.json", json_lens())):
        lens = load_lens(write(name, text))
        # Rounded indices make 2e-6 of it.
        assert float(first_order(lens).focal_length) == pytest.approx(wanted, rel=1e-5)
    assert load_lens(write("a.dat", SINGLET_DAT)).stop == 2
    assert load_lens(write("a.dat", SINGLET_DAT)).name == "a"


def test_zemax_files_in_inches_utf16_and_with_aspheres(write):
    text = zemax(surface="TYPE EVENASPH\nCONI -1.5\nPARM 2 1e-6\nPARM 3 0").replace("UNIT MM", "UNIT IN")
    lens = load_lens(write("a.zmx", codecs.BOM_UTF16_LE + text.encode("utf-16-le")))
    front = lens.surfaces[0]
    assert float(front.conic) == -1.5
    assert float(front.curvature) == pytest.approx(0.02 / 25.4)
    np.testing.assert_allclose(front.coefficients, [0.0, 1e-6 / 25.4**3, 0.0])
    assert float(lens.thicknesses[0]) == pytest.approx(127.0)


def test_parameters_of_a_standard_surface_mean_nothing(write):
    """To Zemax, whose files keep what was typed in while the surface had another type."""
    wanted = load_lens(write("a.zmx", zemax()))
    with pytest.warns(
        UserWarning, match=r"line 9: parameter 2 of SURF 1 is 1e-06, but surfaces of TYPE STAND"
    ):
        lens = load_lens(write("a.zmx", zemax(surface="TYPE STANDARD\nPARM 2 1e-6\nPARM 11 0")))
    assert eqx.tree_equal(lens, wanted)
    assert eqx.tree_equal(load_lens(write("a.zmx", zemax(more="DIAM 9 1\nPARM 2 0"))), wanted)


def test_surfaces_are_called_as_the_file_calls_them(write):
    """However many planes in air before them are left out."""
    dummy = "SURF 1\nTYPE STANDARD\nCURV 0\nDISZ 1\n"
    text = zemax(more="DIAM 80 1").replace("SURF 2", "SURF 3").replace("SURF 1", "SURF 2")
    with pytest.raises(LensFileError, match="line 11: SURF 2 of a has a semi-diameter of 80 mm"):
        load_lens(write("a.zmx", text.replace("SURF 2", dummy + "SURF 2")))
    wide = '{"type": "Spheric", "r": 60, "roc": -50, "d_next": 2, "mat2": "air"}'
    with pytest.raises(LensFileError, match=r"line 3: surfaces\[1\] of a has a semi-diameter of 60 mm"):
        load_lens(write("a.json", json_lens(wide)))


def test_the_stop_of_a_zemax_file_is_as_wide_as_it_says(write):
    lens = load_lens(write("a.zmx", "FNUM 8 0\n" + zemax()))
    assert float(first_order(lens).f_number) == pytest.approx(8.0)
    lens = load_lens(write("a.zmx", "ENPD 3 0\n" + zemax()))
    assert float(first_order(lens).entrance_pupil_radius) == pytest.approx(1.5)
    lens = load_lens(write("a.zmx", zemax(more="")))
    # As wide as the rear lets an axial beam be.
    n, height = float(GLASS.index(line())), 1 - 5 * 0.02 * (1 - 1 / float(GLASS.index(line())))
    assert float(lens.semi_diameters[0]) == pytest.approx(9 / height)
    assert n > 1.5


def test_glass_without_an_entry_is_taken_by_its_index(write):
    with pytest.warns(UserWarning, match="line 12: glass 'LASFN99' is not in the catalogue"):
        lens = load_lens(write("a.zmx", zemax(glass="GLAS LASFN99 0 0 1.8 40")))
    assert float(lens.glasses[0].index(line())) == pytest.approx(1.8)
    assert float(abbe_number(lens.glasses[0])) == pytest.approx(40.0)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.dat", "50 5 1.5\n", r"a.dat, line 1: has 3 columns; expected radius"),
        ("a.dat", "50 5 1.5 18\n-50 x 1 18\n", r"line 2: thickness is 'x'; expected a number"),
        ("a.dat", "50 5 1.5 -18\n", r"line 1: an aperture is -18; expected a positive one"),
        ("a.dat", "50 5 0.5 18\n", r"line 1: a refractive index is 0.5"),
        ("a.dat", "50 5 1.5 18\n-50 0 1 18\n", "a.dat: has no stop; expected one"),
        ("a.dat", "0 1 0 9\n50 5 1.5 18\n-50 1 1 18\n0 1 0 9\n", r"has 2 stops \(lines 1, 4\)"),
        ("a.dat", "", "a.dat: has no surfaces"),
        (
            "a.dat",
            "50 0.5 1.5 18\n-50 0 1 18\n0 1 0 9\n",
            r"line 1: the surface of line 1 and the surface of line 2 of a cross .* axis",
        ),
        (
            "a.dat",
            "0 1 0 9\n50 5 1.5 18\n",
            "line 2: the surface of line 2 of a is the last and has glass of index 1.5 behind it; expected",
        ),
        (
            "a.dat",
            "9 5 1.5 20\n-50 1 1 18\n0 1 0 16\n",
            "line 1: the surface of line 1 of a has a semi-diameter of 10 mm, but reaches 9 mm from the axis",
        ),
        (
            "a.zmx",
            zemax().replace("UNIT MM", "FNUM 0.4 0\nUNIT MM"),
            "the stop is .* wide by the file's aperture, but",
        ),
        ("a.json", "[" * 100_000, "lists within lists too deep"),
        ("a.zmx", zemax(surface="TYPE TOROIDAL"), r"line 8: surface type TOROIDAL is not supported"),
        ("a.zmx", zemax(glass="GLAS MIRROR"), "line 12: mirrors are not supported"),
        ("a.zmx", zemax(glass="GLAS N-BK8"), r"line 12: there is no glass 'N-BK8'; did you mean N-BK7"),
        ("a.zmx", zemax(glass="GLAS ___BLANK 1 0"), "line 12: a model glass has no index"),
        ("a.zmx", zemax(more="DIAM -9"), "line 13: an aperture is -9"),
        ("a.zmx", zemax(surface="TYPE EVENASPH\nPARM 9 1"), "line 9: parameter 9 of an asphere"),
        ("a.zmx", zemax(more="PARM 2"), "line 13: PARM ends early"),
        (
            "a.zmx",
            zemax(more="PARM 2.9 1"),
            "line 13: the number of a parameter is 2.9; expected a whole one",
        ),
        ("a.zmx", zemax(surface="TYPE"), "line 8: TYPE ends early; expected STANDARD or EVENASPH"),
        (
            "a.zmx",
            zemax().replace("DISZ 5", "DISZ 0.5"),
            "line 7: SURF 1 and SURF 2 of a cross within their clear radius, by 1.13 mm 9 mm from the axis",
        ),
        (
            "a.zmx",
            codecs.BOM_UTF16_LE + zemax().encode("utf-16-le")[:-1],
            "a.zmx: begins as UTF-16 text, but is none from byte 480 of 481 on; was it cut off",
        ),
        ("a.zmx", zemax(stop=""), "has no stop"),
        ("a.zmx", zemax().replace("MODE SEQ", "MODE NSC"), "line 1: mode NSC is not supported"),
        ("a.zmx", zemax().replace("UNIT MM", "UNIT FURLONG"), "line 2: unit 'FURLONG' is not known"),
        ("a.zmx", zemax()[:130], "has 2 surfaces; expected an object, a lens and an image"),
        ("a.json", json_lens()[:-20], r"a.json, line 4: "),
        ("a.json", "[]", 'has no list "surfaces"'),
        ("a.json", json_lens('{"type": "ThinLens"}'), "line 3: surface type ThinLens is not supported"),
        ("a.json", json_lens('{"type": "Spheric", "r": 9, "roc": 5}'), 'line 3: the surface has no "d_next"'),
        (
            "a.json",
            json_lens('{"type": "Spheric", "r": 0, "roc": 5, "d_next": 1}'),
            "line 3: an aperture is 0",
        ),
        (
            "a.json",
            json_lens('{"type": "Spheric", "r": 9, "roc": -50, "d_next": 2}'),
            'line 3: the surface has no "mat2"; expected a glass',
        ),
        ("a.json", json_lens(ASPHERE.replace("[0, 1e-6, 2e-9]", "3")), 'line 3: "ai" is 3; expected a list'),
        ("a.step", "", r"a.step: .step is no lens file that is known"),
    ],
)
def test_bad_files_are_refused_by_file_and_line(write, name, text, message):
    with pytest.raises(LensFileError, match=message):
        load_lens(write(name, text))


AGF = """CC a few glasses
NM N-BK7X 2 517642.251 1.5168 64.17 0 1 -
CD 1.03961212 6.00069867E-3 2.31792344E-1 2.00179144E-2 1.01046945 1.03560653E2 0 0 0 0
LD 0.31 2.5
NM SCHOTTISH 1 0 1.5168 64.17 0 1
CD 2.271890 -1.01080E-2 1.05925E-2 2.08200E-4 -7.64700E-6 4.24100E-7
LD 0.35 2.0
NM STRANGE 13 0 1.6 40 0 1
CD 1 2 3
NM LYING 2 0 1.7 64.17 0 1
CD 1.03961212 6.00069867E-3 2.31792344E-1 2.00179144E-2 1.01046945 1.03560653E2
NM TORN 2 0 x 64.17 0 1
CD 1 2
NM BARE 2 0 1.5 64.17 0 1
"""


def test_a_placeholder_of_zemax_is_not_taken_as_glass(write):
    """It writes 1.5 and 40 beside every glass that it has in a catalogue."""
    text = zemax(glass="GLAS N-BK7X 0 0 1.5 4.0E+1 0 0 0 0 0 0")
    with pytest.raises(LensFileError, match=r"line 12: n_d = 1\.5.*--glass FILE.*no glass 'N-BK7X'"):
        load_lens(write("a.zmx", text))
    lens = load_lens(write("a.zmx", text), glass=[write("more.agf", AGF)])
    for name in ("d", "F", "C"):
        np.testing.assert_allclose(lens.glasses[0].index(line(name)), GLASS.index(line(name)), rtol=1e-6)
    # What the table has is taken from there, placeholder or not.
    known = load_lens(write("a.zmx", zemax(glass="GLAS S-TIM28 0 0 1.5 4.0E+1")))
    assert float(known.glasses[0].index(line())) == pytest.approx(1.68893, abs=1e-5)
    assert float(abbe_number(known.glasses[0])) == pytest.approx(31.07, abs=0.01)


def test_a_glass_that_the_file_says_otherwise_is_reported(write):
    with pytest.warns(UserWarning, match="line 12: glass N-BK7 has n_d = 1.6 in the file and 1.5168 in the"):
        load_lens(write("a.zmx", zemax(glass="GLAS N-BK7 0 0 1.6 64.17")))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("STRANGE", "line 8: glass STRANGE has the dispersion formula 13; supported are 1, 2"),
        ("LYING", "line 10: glass LYING has n_d = 1.7, but its formula 2 gives 1.5168; expected both alike"),
        ("TORN", "line 12: n_d of glass TORN is 'x'; expected a number"),
        ("BARE", "line 14: glass BARE has no coefficients; expected a line CD"),
    ],
)
def test_glass_that_a_catalogue_does_not_give_is_refused_when_it_is_asked_for(write, name, message):
    catalogue = write("more.agf", AGF)
    with pytest.raises(LensFileError, match=rf"more\.agf, {message}"):
        load_lens(write("a.zmx", zemax(glass=f"GLAS {name} 0 0 1.5 40")), glass=[catalogue])


def test_aspheres_of_json_files(write):
    text = json_lens().replace(
        '{"type": "Spheric", "r": 9, "roc": 50, "d_next": 5, "mat2": "N-BK7"}', ASPHERE
    )
    front = load_lens(write("a.json", text)).surfaces[0]
    assert float(front.conic) == -1.5
    np.testing.assert_allclose(front.coefficients, [0.0, 1e-6, 2e-9])
    with pytest.warns(UserWarning, match=r"line 2: surfaces\[0\] is of the type Spheric, but has k = -1.5"):
        named = load_lens(write("a.json", text.replace("Aspheric", "Spheric")))
    assert eqx.tree_equal(named.surfaces[0], front)


def test_a_stop_without_a_medium_is_in_that_before_it(write):
    wanted = load_lens(write("a.json", json_lens()))
    text = json_lens().replace('"d_next": 40, "mat2": "air"', '"d_next": 40')
    assert eqx.tree_equal(load_lens(write("a.json", text)), wanted)


def facing(*, semi_diameters=(9.0, 8.5), stop=3.0, top=""):
    """Two plano-concave lenses whose hollow sides face one another, 2 mm apart, and a lens behind them.

    Both radii are 40 mm, so that the sides meet where either sag is 1 mm: sqrt(40^2 - 39^2) from the axis.
    """
    rows = (
        (0.0, 2.0, "GLAS N-BK7", 12.0),
        (1 / 40, 2.0, "", semi_diameters[0]),
        (-1 / 40, 2.0, "GLAS N-BK7", semi_diameters[1]),
        (0.0, 1.0, "", 12.0),
        (1 / 12, 6.0, "GLAS N-SF11", 9.0),
        (0.0, 1.0, "", 9.0),
        (0.0, 20.0, "STOP", stop),
    )
    blocks = "".join(
        f"SURF {number}\nTYPE STANDARD\nCURV {curvature}\nDISZ {gap}\n{more}\nDIAM {radius}\n"
        for number, (curvature, gap, more, radius) in enumerate(rows, start=1)
    )
    return f"{top}SURF 0\nDISZ INFINITY\n{blocks}SURF 8\nDISZ 0\n"


def test_surfaces_that_meet_near_their_rims_end_there(write):
    """A warning has the numbers. At 8.8882 mm the sides meet; no ray of a lens passes farther out."""
    edge = np.sqrt(40.0**2 - 39.0**2)
    said = (
        "SURF 2 and SURF 3 meet 8.888 mm from the axis, but have semi-diameters of 10 and 9.5 mm; both are"
        " taken as 8.888 mm wide"
    )
    for line_number, top, radius in ((9, "", 3.0), (10, "ENPD 10\n", None)):
        with pytest.warns(UserWarning, match=f"line {line_number}: {said}"):
            lens = load_lens(write("a.zmx", facing(semi_diameters=(10.0, 9.5), top=top)))
        np.testing.assert_allclose(lens.semi_diameters[1:3], edge, rtol=1e-9)
        np.testing.assert_allclose(lens.semi_diameters[jnp.array([0, 3, 4, 5])], [12, 12, 9, 9])
        assert radius is None or float(lens.semi_diameters[6]) == radius
    # Narrow enough as they are, though one of them alone is wider.
    assert float(load_lens(write("a.zmx", facing(semi_diameters=(9.0, 8.8)))).semi_diameters[1]) == 9.0


def test_a_stop_that_is_open_is_as_wide_as_narrowed_surfaces_let_it_be(write):
    with pytest.warns(UserWarning, match="meet 8.888 mm"):
        lens = load_lens(write("a.zmx", facing(semi_diameters=(10.0, 9.5), stop=0.0)))
    narrow = load_lens(write("a.zmx", facing(semi_diameters=(8.888, 8.888), stop=0.0)))
    # Observed: 2.2e-5, the rounding of 8.888.
    assert float(lens.semi_diameters[6]) == pytest.approx(float(narrow.semi_diameters[6]), rel=1e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # More than a fifth of one of them.
        (
            facing(semi_diameters=(12.0, 9.5)),
            "line 9: SURF 2 and SURF 3 of a cross within their clear radius",
        ),
        # The axial beam has a radius of 9 mm on SURF 2, and more on SURF 3.
        (
            facing(semi_diameters=(10.0, 9.5), top="ENPD 18\n"),
            "line 10: SURF 2 and SURF 3 of a cross within their clear radius, by 0.289 mm 9.5 mm from",
        ),
    ],
)
def test_surfaces_that_really_cross_are_refused(write, text, message):
    with pytest.raises(LensFileError, match=message):
        load_lens(write("a.zmx", text))


def test_the_shipped_retrofocus_as_its_source_has_it(write):
    """Its file is the source's but for two semi-diameters, which the reader brings down by itself."""
    shipped = lens_preset("retrofocus_35mm_f2")
    path = resources.files("focusjax.optics").joinpath("data/lenses/retrofocus_35mm_f2.zmx")
    text = (
        path.read_text("utf-8").replace("DIAM 9.5 ", "DIAM 10.747 ", 1).replace("DIAM 9.5 ", "DIAM 10.445 ")
    )
    with pytest.warns(
        UserWarning, match="SURF 8 and SURF 9 meet 9.538 mm from the axis, but have semi-diameter"
    ):
        lens = load_lens(write("a.zmx", text))
    np.testing.assert_allclose(lens.semi_diameters[7:9], 9.538, atol=5e-4)
    # The stop is as wide as SURF 9 lets it be; observed: 0.40 %.
    np.testing.assert_allclose(lens.semi_diameters, shipped.semi_diameters, rtol=5e-3)


def test_missing_files_and_unknown_presets():
    with pytest.raises(LensFileError, match=r"nowhere.dat: No such file"):
        load_lens("nowhere.dat")
    with pytest.raises(
        ValueError, match=r"there is no lens .planar.; did you mean planar_us583336_f4.5_1897"
    ):
        lens_preset("planar")


def test_prescriptions_that_make_no_sense():
    def make(gaps=(1.0, 0.0), radii=(5.0, 5.0), stop=0):
        return make_prescription([sphere(0.02)] * 2, gaps, radii, [GLASS, air()], stop=stop)

    for wrong, message in (
        ({"gaps": (1.0,)}, "2 surfaces but 1 thicknesses"),
        ({"gaps": (-1.0, 0.0)}, "surface 0 of lens has a thickness of -1 mm"),
        ({"radii": (5.0, 0.0)}, "surface 1 of lens has a semi-diameter of 0 mm"),
        ({"stop": 2}, "the stop of lens is surface 2; expected one of 0 to 1"),
        ({"radii": (5.0, 51.0)}, "surface 1 of lens has a semi-diameter of 51 mm, but reaches 50 mm"),
    ):
        with pytest.raises(ValueError, match=message):
            make(**wrong)
    with pytest.raises(
        ValueError, match=r"surface 0 of lens is the last and has glass of index 1\.517 behind it"
    ):
        make_prescription([sphere(0.02)], [0.0], [5.0], [GLASS], stop=0)
    with pytest.raises(ValueError, match="surface 0 of singlet has a curvature that is not finite"):
        singlet(float("nan"), 5, thickness=1, semi_diameter=1, glass=GLASS)
    with pytest.raises(ValueError, match="a radius of singlet is 0"):
        singlet(0, 5, thickness=1, semi_diameter=1, glass=GLASS)
