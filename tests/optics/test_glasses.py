"""Glasses by their names, numbers and catalogues."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from optics_lenses import GLASS

from focusjax.optics import FRAUNHOFER, LensFileError, abbe_number, find_glass, glass_names, line, read_agf


def test_files_that_are_no_catalogue(write):
    for text, message in (("", "has no glass; expected an AGF"), ("NM A 2\n", "line 1: NM ends early")):
        with pytest.raises(LensFileError, match=message):
            read_agf(write("a.agf", text))


def formula_line(formula, coefficients):
    """n_d by the formulas as Zemax's manual has them, in plain floats."""
    c, w = [*coefficients, *[0.0] * 10], FRAUNHOFER["d"] * 1e-3
    pole = 1 / (w**2 - 0.028)
    n = {
        1: lambda: (c[0] + c[1] * w**2 + sum(c[i] * w ** (2 - 2 * i) for i in range(2, 6))) ** 0.5,
        3: lambda: c[0] + c[1] * pole + c[2] * pole**2 + c[3] * w**2 + c[4] * w**4 + c[5] * w**6,
        4: lambda: (1 + c[0] + c[1] * w**2 / (w**2 - c[2] ** 2) + c[3] / (w**2 - c[4] ** 2)) ** 0.5,
        5: lambda: c[0] + c[1] / w + c[2] / w**3.5,
        6: lambda: (1 + sum(c[i] * w**2 / (w**2 - c[i + 1]) for i in range(0, 8, 2))) ** 0.5,
    }[formula]()
    return n, f"NM G {formula} 0 {n:.12f} 50 0 1\nCD {' '.join(map(str, coefficients))}\nLD 0.3 2\n"


@pytest.mark.parametrize(
    ("formula", "coefficients"),
    [
        (1, (2.271890, -1.01080e-2, 1.05925e-2, 2.08200e-4, -7.64700e-6, 4.24100e-7)),
        (3, (1.5, 5e-3, 1e-5, -3e-3, 2e-5, -1e-6)),
        (4, (0.2, 1.05, 0.1, -0.01, 9.0)),
        (5, (1.49, 1.2e-2, 4e-4)),
        (6, (1.0, 6e-3, 0.2, 2e-2, 0.9, 100.0, 0.01, 150.0)),
    ],
)
def test_dispersion_formulas_are_those_of_the_manual(write, formula, coefficients):
    wanted, text = formula_line(formula, coefficients)
    glass = read_agf(write("a.agf", text)).find("g")
    np.testing.assert_allclose(glass.index(line()), wanted, rtol=1e-9)
    # Glass disperses: blue is bent more.
    assert float(glass.index(line("F"))) > float(glass.index(line("C")))


def test_common_names_of_glass():
    for name, same in (("BK7", "N-BK7"), ("SIO2", "SILICA"), ("F_SILICA", "SILICA"), ("acrylic", "PMMA")):
        assert eqx.tree_equal(find_glass(name), find_glass(same))
    # Malitson's own: 1.4585, 67.8.
    assert float(find_glass("SILICA").index(line())) == pytest.approx(1.45846, abs=1e-5)


def test_glasses_have_the_numbers_of_the_catalogue():
    assert len(glass_names()) == 1586
    # Schott's own for N-BK7.
    for name, wanted in (("d", 1.51680), ("F", 1.52238), ("C", 1.51432), ("g", 1.52668)):
        assert round(float(GLASS.index(line(name))), 5) == wanted
    assert round(float(abbe_number(GLASS)), 2) == 64.17
    assert float(abbe_number(find_glass("1.62/36.4"))) == pytest.approx(36.4)
    assert float(find_glass("1.62").index(line("F"))) == pytest.approx(1.62)
    assert list(FRAUNHOFER) == sorted(FRAUNHOFER, key=FRAUNHOFER.get)


def test_a_model_glass_is_near_the_real_one():
    """Between F and C; its use beyond is a guess."""
    for name in ("N-BK7", "F2", "N-SF11", "N-LAK9"):
        real = find_glass(name)
        model = find_glass(f"{float(real.index(line()))}/{float(abbe_number(real))}")
        for wavelength in (486.1, 520.0, 550.0, 620.0, 656.3):
            at = jnp.asarray(wavelength)
            # Observed: 4.4e-4 for N-SF11, 3e-5 for N-BK7.
            assert float(model.index(at)) == pytest.approx(float(real.index(at)), abs=5e-4)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("N-SK61", "there is no glass 'N-SK61'; did you mean N-SK16"),
        ("0.9", "a refractive index is 0.9"),
        ("1.5/-3", "an Abbe number is -3"),
        ("1.5.2", "glass '1.5.2' is no number"),
    ],
)
def test_glasses_that_are_none(name, message):
    with pytest.raises(ValueError, match=message):
        find_glass(name)
