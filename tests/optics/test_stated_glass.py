"""Glasses by what tables of lens files and configs state of them, and lenses with them."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import GLASS, biconvex

from focusjax.optics import (
    FRAUNHOFER,
    LensFileError,
    abbe_number,
    air,
    find_glass,
    first_order,
    lens_preset,
    line,
    load_lens,
    make_prescription,
    sphere,
    stated_glass,
    with_element,
)

REFERENCES = json.loads((Path(__file__).parents[1] / "data" / "lens_references.json").read_text())
# Printed in Schott's data sheets.
SHEETS = {
    "N-BK7": {
        "b": [1.03961212, 0.231792344, 1.01046945],
        "c_um2": [0.00600069867, 0.0200179144, 103.560653],
    },
    "F2": {
        "b": [1.34533359, 0.209073176, 0.937357162],
        "c_um2": [0.00997743871, 0.0470450767, 111.886764],
    },
}
TOML = """
info = "mine"
[[surfaces]]
type = "Spheric"
r = 9
roc = 50
d_next = 5
[surfaces.mat2.sellmeier]
b = [1.03961212, 0.231792344, 1.01046945]
c_um2 = [0.00600069867, 0.0200179144, 103.560653]
[[surfaces]]
type = "Spheric"
r = 9
roc = -50
d_next = 2
mat2 = "air"
[[surfaces]]
type = "Stop"
r = 5
d_next = 40
"""


def indices(glass, wavelengths=REFERENCES["wavelengths_nm"]):
    return [float(glass.index(jnp.asarray(each))) for each in wavelengths]


@pytest.mark.parametrize("name", SHEETS)
def test_sellmeier_coefficients_give_optilands_indices(name):
    found = indices(stated_glass({"sellmeier": SHEETS[name]}))
    # Observed: 2e-16.
    np.testing.assert_allclose(found, REFERENCES["indices"][name], rtol=1e-12)


def test_an_abbe_number_is_what_it_is_defined_as():
    glass = stated_glass({"n_d": 1.62, "v_d": 36.4})
    n_d, n_f, n_c = indices(glass, [FRAUNHOFER[name] for name in "dFC"])
    assert n_d == pytest.approx(1.62, rel=1e-14)
    assert (n_d - 1) / (n_f - n_c) == pytest.approx(36.4, rel=1e-12)


def test_indices_at_lines_are_met_and_joined_as_glass_does():
    printed = {"C": 1.51432, "d": 1.51680, "F": 1.52238, "g": 1.52668}
    glass = stated_glass({"lines": printed})
    assert indices(glass, [FRAUNHOFER[name] for name in printed]) == pytest.approx(
        [*printed.values()], abs=1e-14
    )
    # Observed: 3.4e-6, of five printed digits.
    np.testing.assert_allclose(indices(glass), REFERENCES["indices"]["N-BK7"], atol=1e-5)
    assert float(abbe_number(glass)) == pytest.approx(64.17, abs=0.1)


def test_indices_of_the_channels_are_met_and_differentiable():
    glass = stated_glass({"n": [1.51, 1.52, 1.53]})
    assert indices(glass, (650.0, 510.0, 475.0)) == pytest.approx([1.51, 1.52, 1.53], abs=1e-14)
    assert 1.51 < indices(glass, (587.5618,))[0] < 1.52
    slopes = jax.grad(lambda glass: glass.index(jnp.asarray(510.0)))(glass).indices
    np.testing.assert_allclose(slopes, [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "says nothing of its index; give n_d and v_d, sellmeier, n, or lines"),
        ({"v_d": 50}, "has v_d without n_d"),
        ({"n_d": 1.5}, "has n_d = 1.5 without v_d; give its Abbe number, too"),
        ({"n_d": 0.9, "v_d": 50}, "has the index 0.9 as n_d; expected at least 1, and below 5"),
        ({"n_d": 1.5, "v_d": -3}, "has v_d = -3; expected a positive Abbe number"),
        ({"n_d": 1.5, "v_d": 60, "n": [1, 1, 1]}, "has n_d and n, which both say its index; give one"),
        ({"n": [1.5, 1.5, 1.5], "v_d": 60}, "has n and v_d, which both say its index"),
        ({"index": 1.5}, "has 'index'; expected n_d, sellmeier, n, lines, or v_d beside n_d"),
        ({"n": [1.5, 1.6]}, r"has n = \[1.5, 1.6\]; expected three indices"),
        ({"n": [1.5, 1.6, 5.0]}, "has the index 5 as n of blue; expected at least 1, and below 5"),
        ({"n": [1.5, "x", 1.5]}, "has n of green = 'x'; expected a number"),
        ({"lines": {"d": 1.5}}, "expected two to 5 indices by the names of their lines"),
        ({"lines": {"d": 1.5, "q": 1.5}}, "has the line 'q'; expected some of i, h, g"),
        ({"lines": {"i": 1.0, "h": 1.0, "g": 4.9}}, "has the index 11.6.* at 475 nm"),
        ({"sellmeier": {"b": [1.0]}}, "expected a table of b and c_um2, as many of each"),
        ({"sellmeier": {"b": [1.0, 2.0], "c_um2": [0.01]}}, "has 2 numbers b and 1 numbers c_um2"),
        ({"sellmeier": {"b": [1.0], "c_um2": [0.3]}}, "is infinite at 547.7 nm; expected no such wavelength"),
        # Nanometres squared.
        (
            {"sellmeier": {"b": [1.0], "c_um2": [6000.7]}},
            "has the index 0.999981 at 475 nm; expected at least 1",
        ),
    ],
)
def test_tables_that_make_no_glass(table, message):
    with pytest.raises(ValueError, match=message):
        stated_glass(table)


def test_a_lens_file_in_toml_with_coefficients(tmp_path):
    (tmp_path / "mine.toml").write_text(TOML)
    lens = load_lens(tmp_path / "mine.toml")
    assert (lens.name, lens.stop) == ("mine", 2)
    # The singlet of the same glass by name.
    wanted, found = first_order(biconvex()), first_order(lens)
    assert float(found.focal_length) == pytest.approx(float(wanted.focal_length), rel=1e-12)


def test_a_lens_file_in_json_with_an_abbe_number(tmp_path):
    glass = '{"n_d": 1.62, "v_d": 36.4}'
    (tmp_path / "mine.json").write_text(
        f'{{"surfaces": [{{"type": "Spheric", "r": 9, "roc": 50, "d_next": 5, "mat2": {glass}}},'
        ' {"type": "Spheric", "r": 9, "roc": -50, "d_next": 2, "mat2": "air"},'
        ' {"type": "Stop", "r": 5, "d_next": 40}]}'
    )
    assert float(abbe_number(load_lens(tmp_path / "mine.json").glasses[0])) == pytest.approx(36.4)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sellmeier", "selmeier", "line 4: the glass has 'selmeier'; expected n_d, sellmeier"),
        ("r = 9", "r = ", "mine.toml: this is not valid TOML (.*); mend that line"),
        ('mat2 = "air"', "", 'line 12: the surface has no "mat2"; expected a glass'),
        ("surfaces", "surface", 'has no list "surfaces"'),
    ],
)
def test_toml_files_that_cannot_be_read(tmp_path, old, new, message):
    (tmp_path / "mine.toml").write_text(TOML.replace(old, new))
    with pytest.raises(LensFileError, match=message):
        load_lens(tmp_path / "mine.toml")


def test_an_element_gets_another_glass():
    triplet = lens_preset("cooke_triplet_50mm_f4")
    flint = stated_glass({"sellmeier": SHEETS["F2"]})
    changed = with_element(triplet, 3, flint)
    different = np.asarray(changed.indices(line()) != triplet.indices(line()))
    # After the last surface but one: three elements and a stop.
    assert different.tolist() == [number == len(different) - 2 for number in range(len(different))]
    assert float(changed.indices(jnp.asarray(475.0))[-2]) == pytest.approx(REFERENCES["indices"]["F2"][0])


def test_cemented_elements_count_each_and_a_stop_parts_none():
    surfaces = [sphere(0.01), sphere(0.0), sphere(-0.01), sphere(0.005)]
    flint = find_glass("F2")
    lens = make_prescription(surfaces, [2, 2, 2, 0], [5, 4, 5, 5], [GLASS, GLASS, flint, air()], stop=1)
    other = find_glass("N-SF11")
    assert with_element(lens, 1, other).glasses[:3] == (other, other, flint)
    assert with_element(lens, 2, other).glasses[:3] == (GLASS, GLASS, other)


def test_elements_that_are_not_there():
    with pytest.raises(
        ValueError, match="biconvex has 1 elements of glass, and no element 2; expected 1 to 1"
    ):
        with_element(biconvex(), 2, GLASS)
    with pytest.raises(ValueError, match="element 1 of biconvex has the index of air; expected glass"):
        with_element(biconvex(), 1, air())
