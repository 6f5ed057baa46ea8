"""From `lens.prescription` and `[lens.height_field]` to a real lens."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from focusjax.config._errors import about_key, located
from focusjax.config._height_field import height_lens
from focusjax.config._load import Config
from focusjax.geometry import Camera
from focusjax.lens import (
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    TiltedPrescriptionLens,
    TiltShiftLens,
    prescription_lens,
    spectral_lens,
    tilted_lens,
)
from focusjax.optics import (
    LENS_FILES,
    LensFileError,
    Prescription,
    first_order,
    glass_finder,
    lens_preset,
    load_lens,
    put_ahead,
    with_element,
)


def build_real_lens(
    config: Config, camera: Camera, lens: ThinLens | TiltShiftLens, *, wide_open: bool = False
) -> PrescriptionLens | TiltedPrescriptionLens | SpectralLens | None:
    """The real lens of `[lens]` with the settings of an ideal one: focal length, focus, opening and tilt.

    None of an ideal one.

    With `wide_open` it is open as far as the config and it allow.

    Raises:
        ConfigError: a file that cannot be read, no such lens, or one that cannot be opened or focused so.
    """
    table = config.lens
    if table.real is None:
        return None
    with _refusals(config):
        prescription = _whole(config)
        f_number = float(lens.f_number(camera))
        if wide_open:
            f_number = min(
                f_number, max(config.solve.f_number_min, float(first_order(prescription).f_number))
            )
        made = prescription_lens(
            prescription,
            camera,
            focus_distance=float(lens.focus_distance()),
            f_number=f_number,
            aperture=lens.aperture,
        )
        coloured = spectral_lens(made, bands=table.spectral_bands) if table.spectral else made
        if not isinstance(lens, TiltShiftLens):
            return coloured
        turned = lens.movements(camera)
        return tilted_lens(coloured, camera, tilt=float(turned.tilt), swing=float(turned.swing))


def widest_real(config: Config) -> float | None:
    """The f-number of the real lens of `[lens]` with its stop open; None of an ideal lens.

    Raises:
        ConfigError: as `build_real_lens`.
    """
    if config.lens.real is None:
        return None
    with _refusals(config):
        return float(first_order(_whole(config)).f_number)


@contextlib.contextmanager
def _refusals(config: Config) -> Iterator[None]:
    """What a lens refuses, as errors of the config."""
    with located(config.source):
        try:
            yield
        except LensFileError as error:
            raise ValueError(f"lens.prescription: {error}") from error


def _whole(config: Config) -> Prescription:
    """The prescription, with the height field ahead of it; or the one that there is.

    Raises:
        LensFileError: a file that cannot be read.
        ValueError: as `_prescription`; a height field that cannot be.
    """
    name, table = config.lens.prescription, config.lens.height_field
    lens = None if name is None else _prescription(config, name)
    if table is None:
        assert lens is not None
        return lens
    with about_key("lens.height_field"):
        front = config.reach.file(table.file, "file")
        back = None if table.back_file is None else config.reach.file(table.back_file, "back_file")
        plate = height_lens(table, front, back)
        if lens is None:
            return plate
        assert table.ahead_mm is not None
        return put_ahead(plate, lens, table.ahead_mm)


def _prescription(config: Config, name: str) -> Prescription:
    """A lens file, beside the config if its path is relative, or one that comes along; with its own elements.

    Raises:
        LensFileError: a file that cannot be read.
        ValueError: no file's name, and no lens that comes along; an element or a glass that is not there.
    """
    glass = [config.reach.file(file, "lens.glass") for file in config.lens.glass]
    if Path(name).suffix.lower() in LENS_FILES:
        lens = load_lens(config.reach.file(name, "lens.prescription"), glass=glass)
    else:
        try:
            lens = lens_preset(name)
        except ValueError as error:
            files = ", ".join(LENS_FILES)
            raise ValueError(f"lens.prescription: {error} Or give a lens file ({files})") from error
    find = glass_finder(glass)
    for number, table in enumerate(config.lens.elements):
        with about_key(f"lens.elements.{number}"):
            lens = with_element(lens, table.element, table.glass.made(find))
    return lens
