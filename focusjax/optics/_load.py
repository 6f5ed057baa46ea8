"""Lenses from files, and those that come with the package."""

import dataclasses
import difflib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from focusjax.optics._lens_text import LensFileError, LensText
from focusjax.optics._pbrt import read_pbrt
from focusjax.optics._prescription import Prescription
from focusjax.optics._read_agf import glass_finder
from focusjax.optics._read_json import read_json, read_toml
from focusjax.optics._read_zemax import read_zemax

_READERS = {".dat": read_pbrt, ".zmx": read_zemax, ".json": read_json, ".toml": read_toml}
LENS_FILES = tuple(_READERS)
"""Endings of files that `load_lens` reads."""


@dataclasses.dataclass(frozen=True)
class Preset:
    """A lens that comes with the package.

    Attributes:
        file: its data in `data/lenses`.
        title: what it is.
        year: of the patent; None where the source names none.
    """

    file: str
    title: str
    year: int | None


PRESETS = {
    "planar_us583336_f4.5_1897": Preset(
        "planar_us583336_f4.5_1897.zmx", "Planar, P. Rudolph, US 583,336 example 2, f/4.5", 1897
    ),
    "gauss_jp62087922_f1.8_1987": Preset(
        "gauss_jp62087922_f1.8_1987.json", "Double Gauss, JP 62-087922 example 1, f/1.8", 1987
    ),
    "retrofocus_35mm_f2": Preset("retrofocus_35mm_f2.zmx", "Retrofocus wide angle 35 mm, f/2", None),
    "cooke_triplet_50mm_f4": Preset("cooke_triplet_50mm_f4.json", "Cooke triplet 50 mm, f/4", None),
    "biogon_us2721499_f4.5_1955": Preset(
        "biogon_us2721499_f4.5_1955.json", "Wide angle, L. Bertele, US 2,721,499 example 2, f/4.5", 1955
    ),
    "gauss_us2673491_f2_1954": Preset(
        "gauss_us2673491_f2_1954.json", "Double Gauss, A. W. Tronnier, US 2,673,491, f/2", 1954
    ),
    "sonnar_us1998704_f2_1935": Preset(
        "sonnar_us1998704_f2_1935.json", "Portrait lens, L. Bertele, US 1,998,704 example I, f/2", 1935
    ),
}
"""Lenses that come with the package, by name; `data/CREDITS.md` says where they are from."""


def load_lens(path: str | Path, *, glass: Sequence[str | Path] = ()) -> Prescription:
    """A lens file: pbrt (.dat), Zemax sequential (.zmx), DeepLens (.json), or its keys as TOML (.toml).

    A `UserWarning` reports, by file and line, what is not taken as it stands in the file.

    Args:
        path: the lens file.
        glass: AGF catalogues in which its glasses are looked up, before the table of `find_glass`.

    Raises:
        LensFileError: another ending, or a file that cannot be read; the message names file and line.

    Example:
        >>> from pathlib import Path
        >>> from focusjax.optics import pbrt_lens_text
        >>> _ = Path("triplet.dat").write_text(pbrt_lens_text(fj.lens_preset("cooke_triplet_50mm_f4"), 40.0))
        >>> len(fj.load_lens("triplet.dat").thicknesses)
        7
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise LensFileError(
            f"{path}: {path.suffix or 'no ending'} is no lens file that is known; expected .dat (pbrt), .zmx"
            " (Zemax), .json (DeepLens) or .toml"
        )
    return reader(LensText(path, glass_finder(glass)))


def lens_preset(name: str) -> Prescription:
    """A lens that comes with the package, as its source has it: see `PRESETS`.

    Raises:
        ValueError: no such lens; the message gives the nearest names.

    Example:
        >>> lens_preset("planar_us583336_f4.5_1897").stop
        5
    """
    preset = PRESETS.get(name)
    if preset is None:
        near = difflib.get_close_matches(name, PRESETS, n=3, cutoff=0.3) or list(PRESETS)
        raise ValueError(f"there is no lens {name!r}; did you mean {', '.join(near)}?")
    folder = resources.files("focusjax.optics").joinpath("data/lenses")
    with resources.as_file(folder.joinpath(preset.file)) as path:
        return dataclasses.replace(load_lens(path), name=name)
