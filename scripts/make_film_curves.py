"""Writes the tables of response curves that come with focusjax, from the formulas in their headers.

    python scripts/make_film_curves.py

The emulsions are generic: straight lines between a toe and a shoulder of soft bends, with round numbers that
are typical of their kind. They are those of no product.
"""

import math
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

FOLDER = Path(__file__).parents[1] / "focusjax" / "film" / "data"
GREY = 0.18
EMULSION = """# {title}
# Not of a product. Source: the formula below, by scripts/make_film_curves.py.
# D = {base} {slope:+} [b({toe}, {toe_width}) - b({shoulder}, {shoulder_width})], with
# b(p, s) = s ln(1 + exp((x - p) / s)) and x = {axis}.
"""
FILMIC = """# Filmic display curve.
# Source: John Hable, "Uncharted 2: HDR Lighting", Game Developers Conference 2010: f(c) / f(11.2) with
# f(c) = (c (A c + C B) + D E) / (c (A c + B) + D F) - E / F, A..F = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30.
# By scripts/make_film_curves.py: c is {gain:.6f} times the signal, so that a metered grey of 0.18 is shown as
# 0.18, and what is above white is white. The density is -log10 of the light.
"""


def bend(x: np.ndarray, place: float, width: float) -> np.ndarray:
    """0 before `place` and x - place after it, with a bend of a `width`."""
    return width * np.logaddexp(0.0, (x - place) / width)


def emulsion(x: np.ndarray, base: float, slope: float, toe: tuple, shoulder: tuple) -> np.ndarray:
    return base + slope * (bend(x, *toe) - bend(x, *shoulder))


def hable(c: np.ndarray | float) -> np.ndarray | float:
    a, b, c_, d, e, f = 0.15, 0.50, 0.10, 0.20, 0.02, 0.30
    return (c * (a * c + c_ * b) + d * e) / (c * (a * c + b) + d * f) - e / f


def write(name: str, header: str, x: np.ndarray, density: np.ndarray) -> None:
    rows = "\n".join(f"{place:.2f},{value:.5f}" for place, value in zip(x, density, strict=True))
    (FOLDER / name).write_text(f"{header}log_exposure,density\n{rows}\n")


def write_emulsion(name: str, title: str, axis: str, x: np.ndarray, base, slope, toe, shoulder) -> None:
    header = EMULSION.format(
        title=title, base=base, slope=slope, axis=axis, toe=f"{toe[0]:g}", toe_width=toe[1],
        shoulder=f"{shoulder[0]:g}", shoulder_width=shoulder[1],
    )  # fmt: skip
    write(name, header, x, emulsion(x, base, slope, toe, shoulder))


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    exposed = "log10 of the exposure over that of a metered grey"
    # Straight parts of 3.2 and 2.8 decades; a density of 0.1 above the base at the speed point of ISO 6.
    x = np.arange(-300, 401, 10) / 100
    write_emulsion(
        "negative.csv", "Generic colour negative film.", exposed, x, 0.2, 0.6, (-1.25, 0.12), (2.0, 0.2)
    )
    write_emulsion(
        "black_and_white.csv",
        "Generic black and white negative film.",
        exposed, x, 0.25, 0.62, (-1.25, 0.14), (1.6, 0.2),
    )  # fmt: skip
    # The place of its curve is arbitrary: the enlarger's light is set for a grey.
    x = np.arange(-100, 301, 5) / 100
    printed = "log10 of the exposure"
    write_emulsion(
        "paper.csv", "Generic photographic paper.", printed, x, 0.06, 2.6, (0.35, 0.08), (1.15, 0.07)
    )
    x = np.arange(-250, 151, 5) / 100

    def slide(shoulder: float) -> np.ndarray:
        # Falling: the bends trade their places.
        return emulsion(x, 0.15, -1.7, (-1.35, 0.15), (shoulder, 0.12)) + 1.7 * (shoulder + 1.35)

    grey = -math.log10(GREY)
    place = round(brentq(lambda s: np.interp(0.0, x, slide(s)) - 0.15 - grey, 0.0, 1.0), 4)
    base = 0.15 + 1.7 * (place + 1.35)
    header = EMULSION.format(
        title="Generic colour reversal (slide) film.", base=f"{base:g}", slope=-1.7, axis=exposed,
        toe="-1.35", toe_width=0.15, shoulder=f"{place:g}", shoulder_width=0.12,
    )  # fmt: skip
    write("reversal.csv", header, x, slide(place))
    gain = brentq(lambda k: hable(k * GREY) / hable(11.2) - GREY, 0.1, 20.0)
    white = math.log10(11.2 / gain / GREY)
    x = np.append(np.arange(-400, math.floor(white * 10) * 10 + 1, 10) / 100, math.ceil(white * 100) / 100)
    light = np.minimum(hable(gain * GREY * 10.0**x) / hable(11.2), 1.0)
    write("filmic.csv", FILMIC.format(gain=gain), x, np.abs(np.log10(light)))


if __name__ == "__main__":
    main()
