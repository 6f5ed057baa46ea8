"""What all readers of lens files share: rows with the line they come from, made into a prescription.

Clear radii of files may reach a little beyond where two surfaces meet: programs write them by the rays they
traced, and need not ask whether there is room for glass. No ray passes there in a lens of glass, so such
surfaces end where they meet.
"""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from focusjax.optics._catalogue import find_glass
from focusjax.optics._glass import AbstractGlass, ConstantIndex
from focusjax.optics._lens_text import LensFileError, LensText
from focusjax.optics._paraxial import first_order
from focusjax.optics._prescription import (
    CROSSING,
    Prescription,
    SurfaceError,
    check_surfaces,
    gap_between,
    line,
    make_prescription,
)
from focusjax.optics._surfaces import AbstractSurface, Conic, EvenAsphere

_ROUNDING = 1e-5
"""By which a beam may seem wider than what it was made to pass, in single precision."""
_LEAST_SHARE = 0.8
"""Of both clear radii within which surfaces must not cross: farther in, a number of the file is wrong."""
_HALVINGS = 40


@dataclasses.dataclass
class Row:
    """One surface of a file.

    Attributes:
        line: where it begins, from 1.
        called: what the file itself calls it, such as "SURF 7".
        curvature: 1/mm.
        conic: of the surface.
        coefficients: of r^2, r^4 and so on, in mm.
        thickness: mm to the next.
        semi_diameter: mm; None where the file leaves it open.
        glass: what is after it.
        is_stop: whether it is the stop.
    """

    line: int
    called: str
    curvature: float = 0.0
    conic: float = 0.0
    coefficients: tuple[float, ...] = ()
    thickness: float = 0.0
    semi_diameter: float | None = None
    glass: AbstractGlass | None = None
    is_stop: bool = False

    def surface(self) -> AbstractSurface:
        """The surface itself; a polynomial of zeros is none."""
        curvature, conic = (jnp.asarray(value, dtype=float) for value in (self.curvature, self.conic))
        if not any(self.coefficients):
            return Conic(curvature, conic)
        return EvenAsphere(curvature, conic, jnp.asarray(self.coefficients, dtype=float))


def from_rows(
    text: LensText,
    rows: list[Row],
    name: str,
    *,
    f_number: float | None = None,
    pupil_diameter: float | None = None,
) -> Prescription:
    """The prescription of a file's rows; `f_number` or `pupil_diameter` sets its stop.

    Dummy planes in air are left out, and the gaps before and after them joined. Where clear radii reach a
    little beyond where two surfaces meet, and the axial beam does not, they end there; a warning says so.

    Raises:
        LensFileError: no surfaces, no stop or two, an opening that is missing, or what `make_prescription`
            refuses.
    """
    rows = _without_dummies(rows)
    if not rows:
        raise LensFileError(f"{text.path}: has no surfaces")
    stop, called = _stop(text, rows), [row.called for row in rows]
    for number, row in enumerate(rows):
        if row.semi_diameter is None and number != stop:
            raise text.refuse(row.line, "the surface has no aperture; expected its semi-diameter")
    # For the time being a stop that is open is in nobody's way.
    narrowest = min((row.semi_diameter for row in rows if row.semi_diameter is not None), default=0.0)
    given = [narrowest if row.semi_diameter is None else row.semi_diameter for row in rows]
    surfaces, gaps = [row.surface() for row in rows], [row.thickness for row in rows]
    glasses = [find_glass("air") if row.glass is None else row.glass for row in rows]
    radii, narrowed = narrowed_to_meet(surfaces, gaps, given, stop)
    try:
        lens = make_prescription(surfaces, gaps, radii, glasses, stop=stop, name=name)
        opened = lens
        if f_number is not None or pupil_diameter is not None or rows[stop].semi_diameter is None:
            opened = _opened(lens, f_number, pupil_diameter)
        if any(_cuts_axial_beam(opened, number) for number in narrowed):
            make_prescription(surfaces, gaps, given, glasses, stop=stop, name=name)
    except SurfaceError as error:
        raise text.refuse(rows[error.surfaces[0]].line, error.of(called)) from None
    except ValueError as error:
        raise LensFileError(f"{text.path}: {error}") from None
    try:
        check_surfaces(opened)
    except SurfaceError as error:
        radius = float(opened.semi_diameters[stop])
        why = f"the stop is {radius:.4g} mm wide by the file's aperture, but {error.of(called)}"
        raise text.refuse(rows[stop].line, why) from None
    for number in narrowed:
        text.warn(
            rows[number].line,
            f"{called[number]} and {called[number + 1]} meet {radii[number]:.4g} mm from the axis, but have"
            f" semi-diameters of {given[number]:.4g} and {given[number + 1]:.4g} mm; both are taken as"
            f" {radii[number]:.4g} mm wide, which lets the whole axial beam through",
        )
    return opened


def _stop(text: LensText, rows: list[Row]) -> int:
    """The number of the only row that is one."""
    stops = [number for number, row in enumerate(rows) if row.is_stop]
    if len(stops) != 1:
        where = ", ".join(str(rows[number].line) for number in stops)
        found = f"has {len(stops)} stops (lines {where})" if stops else "has no stop"
        raise LensFileError(f"{text.path}: {found}; expected one")
    return stops[0]


def _opened(lens: Prescription, f_number: float | None, pupil_diameter: float | None) -> Prescription:
    """The lens with its stop by f-number or pupil, or as wide as the other surfaces let an axial beam be."""
    seen = first_order(lens)
    radius = float(lens.semi_diameters[lens.stop])
    if f_number is not None:
        radius *= float(seen.f_number) / f_number
    elif pupil_diameter is not None:
        radius *= pupil_diameter / 2.0 / float(seen.entrance_pupil_radius)
    else:
        heights = _axial_heights(lens)
        others = [n for n in range(len(heights)) if n != lens.stop and heights[n] > 0]
        radius = heights[lens.stop] * min(float(lens.semi_diameters[n]) / heights[n] for n in others)
    return dataclasses.replace(lens, semi_diameters=lens.semi_diameters.at[lens.stop].set(radius))


def _cuts_axial_beam(lens: Prescription, number: int) -> bool:
    """Whether the beam from infinity that fills the stop is wider than a surface or the next one."""
    heights, radii = np.array(_axial_heights(lens)), np.asarray(lens.semi_diameters)
    wider = heights * radii[lens.stop] > radii * heights[lens.stop] * (1.0 + _ROUNDING)
    return bool(wider[number : number + 2].any())


def _axial_heights(lens: Prescription) -> list[float]:
    """How far from the axis a ray from infinity is at each surface, over what it was before the first."""
    indices = lens.indices(line())
    y, u = jnp.ones(()), jnp.zeros(())
    heights = []
    for number, surface in enumerate(lens.surfaces):
        heights.append(abs(float(y)))
        before, after = indices[number], indices[number + 1]
        u = (before * u - y * surface.osculating()[0] * (after - before)) / after
        y = y + lens.thicknesses[number] * u
    return heights


def _without_dummies(rows: list[Row]) -> list[Row]:
    kept: list[Row] = []
    before: AbstractGlass | None = None
    for row in rows:
        flat = row.curvature == 0 and not any(row.coefficients)
        if flat and not row.is_stop and _is_air(before) and _is_air(row.glass):
            if kept:
                kept[-1] = dataclasses.replace(kept[-1], thickness=kept[-1].thickness + row.thickness)
        else:
            kept.append(row)
        before = row.glass
    return kept


def _is_air(glass: AbstractGlass | None) -> bool:
    return glass is None or (isinstance(glass, ConstantIndex) and float(glass.value) == 1.0)


def narrowed_to_meet(
    surfaces: Sequence[AbstractSurface],
    thicknesses: Sequence[float],
    radii: Sequence[float],
    stop: int,
) -> tuple[list[float], list[int]]:
    """Clear radii in mm of which no two neighbours cross, and the first of each two that were narrowed.

    The stop's is left as it is, and so is what would still cross with a fifth less of both.
    """
    found, narrowed = [float(radius) for radius in radii], []
    for number in range(len(surfaces) - 1):
        pair = slice(number, number + 2)
        if stop in (number, number + 1):
            continue
        place = _meeting(surfaces[number], surfaces[number + 1], thicknesses[number], min(found[pair]))
        if place is not None and place >= _LEAST_SHARE * max(radii[pair]):
            found[pair] = place, place
            narrowed.append(number)
    return found, narrowed


def _meeting(
    surface: AbstractSurface, following: AbstractSurface, thickness: float, radius: float
) -> float | None:
    """How far from the axis, up to `radius`, two surfaces first meet; None where they do not."""
    across = np.linspace(0.0, radius, 65)
    crossed = gap_between(surface, following, thickness, across) < -CROSSING
    if crossed[0] or not crossed.any():
        return None
    apart, beyond = across[crossed.argmax() - 1], across[crossed.argmax()]
    for _ in range(_HALVINGS):
        middle = (apart + beyond) / 2.0
        if gap_between(surface, following, thickness, np.array([middle]))[0] < 0.0:
            beyond = middle
        else:
            apart = middle
    return float(apart)
