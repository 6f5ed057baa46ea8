"""From the tables of a config to openings and to what a lens does beyond focusing."""

import math

import numpy as np

from focusjax.config._errors import about_key, located
from focusjax.config._load import Config
from focusjax.config._look import ColourTable, ImageTable, PolygonTable, SeidelTable
from focusjax.geometry import Camera
from focusjax.lens import (
    AberratedLens,
    AbstractAberration,
    AbstractAperture,
    AbstractLens,
    DarkenedLens,
    Disk,
    Seidel,
    ThinLens,
    apodized,
    chromatic_lens,
    cosine_falloff,
    field_curvature,
    focal_surface,
    hooded_lens,
    lens_profile,
    load_lensfun,
    load_profile,
    mask,
    obstructed,
    polygon,
    power_profile,
    profiled_lens,
    seidel,
    seidel_of_wavefront,
    squeezed,
    table_falloff,
    thin_lens_dispersion,
    vignetted_lens,
)
from focusjax.optics import find_glass
from focusjax.scene import read_image


def build_aperture(config: Config) -> AbstractAperture:
    """The opening of `[lens.aperture]`.

    Raises:
        ValueError: an image that cannot be read or lets no light through.
    """
    table = config.lens.aperture
    if isinstance(table, ImageTable):
        shape = mask(read_image(config.reach.file(table.file, "lens.aperture.file")).mean(axis=-1))
    else:
        shape = Disk()
        if isinstance(table, PolygonTable):
            shape = polygon(
                table.blades, rotation=math.radians(table.rotation_deg), roundness=table.roundness
            )
        if table.obstruction:
            shape = obstructed(table.obstruction, shape)
        if table.transmission is not None:
            shape = apodized(table.transmission, shape)
    return squeezed(table.squeeze, shape) if table.squeeze > 1 else shape


def build_look(config: Config, camera: Camera, lens: AbstractLens) -> AbstractLens:
    """A lens that renders as `[lens]` says, made from the one that focuses; itself where it says nothing.

    Raises:
        ConfigError: a lens that is closed, for what needs an opening.
    """
    table = config.lens
    with located(config.source):
        made = lens
        if table.profile is not None:
            made = _profiled(config, camera, lens)
        terms: list[AbstractAberration] = []
        if table.seidel is not None:
            terms.append(_seidel(table.seidel, camera, lens))
        if table.power_profile is not None:
            terms.append(power_profile(table.power_profile))
        if table.field_curvature:
            places = np.array([point.pixel for point in table.field_curvature])
            offsets = [point.offset for point in table.field_curvature]
            terms.append(field_curvature(focal_surface(places, offsets, basis="affine"), camera))
        if terms:
            made = AberratedLens(made, tuple(terms))
        if table.colour is not None:
            colour = table.colour
            offsets = _focus_offsets(colour, camera)
            made = chromatic_lens(
                made, focus_offset=offsets, magnification=colour.magnification, bands=colour.bands
            )
        if table.cats_eyes is not None:
            eyes = table.cats_eyes
            made = vignetted_lens(made, camera, corner_shift=eyes.corner_shift, disk=eyes.disk)
        if table.hood is not None:
            radius, distance = table.hood.diameter_mm / 2000, table.hood.length_mm / 1000
            made = hooded_lens(made, radius=radius, distance=distance)
        if table.natural_falloff:
            made = DarkenedLens(made, cosine_falloff())
        if table.falloff is not None:
            heights = [each / 1000 for each in table.falloff.heights_mm]
            darker = table_falloff(
                camera, heights, table.falloff.shares, extrapolate=table.falloff.extrapolate
            )
            made = DarkenedLens(made, darker)
    return made


def _focus_offsets(table: ColourTable, camera: Camera) -> tuple[float, ...]:
    """Dioptres by which red, green and blue focus nearer.

    Raises:
        ValueError: a glass that is not known, or that does not refract.
    """
    if table.glass is None:
        return table.focus_offset
    with about_key("lens.colour.glass"):
        return thin_lens_dispersion(table.glass.made(find_glass), float(camera.focal_length))


def _profiled(config: Config, camera: Camera, lens: AbstractLens) -> AbstractLens:
    """The lens with what `[lens.profile]` says.

    Raises:
        ValueError: a profile that cannot be read, or that is not for this lens and camera.
    """
    table = config.lens.profile
    assert table is not None
    with about_key("lens.profile"):
        if table.file is None:
            assert table.name is not None
            profile = lens_profile(table.name)
        elif table.lens is None:
            profile = load_profile(config.reach.file(table.file, "file"))
        else:
            path = config.reach.file(table.file, "file")
            # Vignetting is of one opening and distance, and a pinhole has none.
            radius = float(lens.parallax(camera)) / float(camera.focal_px)
            profile = load_lensfun(
                path,
                table.lens,
                focal_length=float(camera.focal_length),
                aperture=float(camera.focal_length) / (2.0 * radius) if radius > 0 else None,
                focus_distance=float(lens.focus_distance()) if isinstance(lens, ThinLens) else math.inf,
            )
        darkens = profile.illumination is not None or profile.cats_eyes is not None
        own = [key for key in ("natural_falloff", "falloff", "cats_eyes") if getattr(config.lens, key)]
        if darkens and own:
            raise ValueError(f"has vignetting of its own, and so has lens.{own[0]}; leave that out")
        return profiled_lens(lens, profile, camera, colour=table.colour, extrapolate=table.extrapolate)


def _seidel(table: SeidelTable, camera: Camera, lens: AbstractLens) -> Seidel:
    lengths = table.wavefront()
    if not lengths:
        return seidel(lens, camera, **table.in_unit("px"))
    assert table.f_number is not None
    height = None if table.height_mm is None else 1e-3 * table.height_mm
    return seidel_of_wavefront(lens, camera, f_number=table.f_number, height=height, **lengths)
