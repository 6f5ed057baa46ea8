"""Write focusjax/optics/data/glass_dispersion.csv from a copy of the refractiveindex.info database (CC0 1.0).

    git clone https://github.com/polyanskiy/refractiveindex.info-database
    python scripts/make_glass_table.py refractiveindex.info-database

Needs PyYAML. Of glasses of one name that several makers have, the first of MAKERS is taken.
"""

import argparse
import csv
import math
from pathlib import Path

import yaml

TABLE = Path(__file__).parents[1] / "focusjax/optics/data/glass_dispersion.csv"
MAKERS = ("schott", "ohara", "hikari", "hoya", "cdgm", "sumita")
OTHERS = {
    "SILICA": "main/SiO2/nk/Malitson.yml",
    "CAF2": "main/CaF2/nk/Malitson.yml",
    "PMMA": "organic/(C5H8O2)n - poly(methyl methacrylate)/nk/Szczurowski.yml",
    "POLYCARB": "organic/(C16H14O3)n - polycarbonate/nk/Sultanova.yml",
    "POLYSTYR": "organic/(C8H8)n - polystyrene/nk/Sultanova.yml",
    "E48R": "other/commercial polymers/ZeonexE48R/nk/Sultanova.yml",
}
"""Crystals and plastics by the names that Zemax has for them."""
COEFFICIENTS = 17
LINES = {"d": 0.5875618, "F": 0.4861327, "C": 0.6562725}


def read(path: Path) -> tuple[int, tuple[str, str], list[str]]:
    """Formula (2 or 3), range of wavelengths and coefficients of a file, as text."""
    found = next(
        part for part in yaml.safe_load(path.read_text("utf-8"))["DATA"] if "formula" in part["type"]
    )
    formula = int(found["type"].split()[1])
    lowest, highest = str(found["wavelength_range"]).split()
    numbers = str(found["coefficients"]).split()
    if formula == 1:
        # The same series with poles as wavelengths, not as their squares.
        numbers[2::2] = [f"{float(pole) ** 2:.10g}" for pole in numbers[2::2]]
        formula = 2
    if formula not in (2, 3):
        raise ValueError(f"{path}: has formula {formula}; expected 1, 2 or 3")
    return formula, (lowest, highest), numbers


def index(formula: int, numbers: list[str], micrometres: float) -> float:
    """The refractive index at a wavelength."""
    first, *rest = (float(number) for number in numbers)
    pairs = list(zip(rest[::2], rest[1::2], strict=True))
    square = micrometres**2
    if formula == 2:
        return math.sqrt(1 + first + sum(b * square / (square - c) for b, c in pairs))
    return math.sqrt(first + sum(a * micrometres**e for a, e in pairs))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("database", type=Path, help="folder of the database")
    data = parser.parse_args().database / "database/data"
    files = [
        (maker, path.stem, path)
        for maker in MAKERS
        for path in sorted((data / "specs" / maker / "optical").glob("*.yml"))
    ]
    files += [("other", name, data / place) for name, place in OTHERS.items()]
    seen = set()
    with TABLE.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(
            ["maker", "glass", "formula", "lambda_min_um", "lambda_max_um", "nd", "Vd"]
            + [f"c{number}" for number in range(COEFFICIENTS)]
        )
        for maker, name, path in files:
            if name.lower() in seen:
                continue
            seen.add(name.lower())
            formula, ends, numbers = read(path)
            if len(numbers) > COEFFICIENTS:
                raise ValueError(f"{path}: has {len(numbers)} coefficients; expected {COEFFICIENTS} at most")
            d, f, c = (index(formula, numbers, LINES[line]) for line in ("d", "F", "C"))
            writer.writerow([maker, name, formula, *ends, f"{d:.6f}", f"{(d - 1) / (f - c):.3f}", *numbers])
    print(f"{TABLE}: {len(seen)} glasses")


if __name__ == "__main__":
    main()
