"""A lens as its maker writes it down: surfaces, what is between them, and how wide they are."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind
from focusjax._device import device_array
from focusjax._programs import jit
from focusjax.optics._glass import FRAUNHOFER, AbstractGlass, air
from focusjax.optics._height_field import HeightField
from focusjax.optics._surfaces import AbstractSurface, Conic, EvenAsphere, sphere

_AIR = 1e-3
"""By which the index of air may differ from 1."""
_EDGE = 1e-9
"""By which the square of a semi-diameter may go beyond its surface, as numbers are rounded."""
_DIRECTIONS = 32
"""Around the axis, in which surfaces that are not of revolution are looked at."""
CROSSING = 1e-6
"""Millimetres that surfaces may seem to cross by, since files give rounded numbers."""


class Prescription(eqx.Module):
    """A centred lens in air, from the scene's side to the film's. Lengths are millimetres.

    Attributes:
        surfaces: n of them, each about its own vertex; the stop is one.
        thicknesses: [n] from each vertex to the next; the last is to the film of the file, 0 if it has none.
        semi_diameters: [n] clear radius of each surface.
        glasses: n media, each after its surface; the last is air.
        stop: number of the surface that limits the axial beam, from 0 (static).
        name: what to call it (static).

    Example:
        >>> from focusjax.optics import find_glass, first_order
        >>> lens = singlet(50.0, -50.0, thickness=5.0, semi_diameter=10.0, glass=find_glass("N-BK7"))
        >>> round(float(first_order(lens).focal_length), 3)
        49.213
    """

    surfaces: tuple[AbstractSurface, ...]
    thicknesses: Float[Array, " n"]
    semi_diameters: Float[Array, " n"]
    glasses: tuple[AbstractGlass, ...]
    stop: int = eqx.field(static=True)
    name: str = eqx.field(static=True, default="lens")

    def indices(self, wavelength: Float[Array, ""]) -> Float[Array, " n_plus_1"]:
        """Refractive index at `wavelength` (nm) before the first surface and after each."""
        media = [air(), *self.glasses]
        return jnp.stack([glass.index(wavelength).astype(self.thicknesses.dtype) for glass in media])

    def vertices(self) -> Float[Array, " n"]:
        """Places of the vertices on the axis in mm, the first at 0."""
        return jnp.cumsum(self.thicknesses) - self.thicknesses

    def scaled(self, factor: float | Float[Array, ""]) -> "Prescription":
        """The lens with all lengths multiplied by `factor`: the same f-number, another focal length."""
        by = jnp.asarray(factor, dtype=self.thicknesses.dtype)
        return dataclasses.replace(
            self,
            surfaces=tuple(surface.scaled(by) for surface in self.surfaces),
            thicknesses=self.thicknesses * by,
            semi_diameters=self.semi_diameters * by,
        )


class SurfaceError(ValueError):
    """A prescription that cannot be, for what one surface is.

    Attributes:
        lens: its name.
        surfaces: numbers of the one, or of the two, that it is about, from 0.
        what: is wrong with them.
    """

    def __init__(self, lens: str, surfaces: tuple[int, ...], what: str) -> None:
        self.lens, self.surfaces, self.what = lens, surfaces, what
        super().__init__(self.of([f"surface {number}" for number in range(surfaces[-1] + 1)]))

    def of(self, names: Sequence[str]) -> str:
        """The message where surfaces are called so."""
        return f"{' and '.join(names[number] for number in self.surfaces)} of {self.lens} {self.what}"


def make_prescription(
    surfaces: Sequence[AbstractSurface],
    thicknesses: Sequence[float],
    semi_diameters: Sequence[float],
    glasses: Sequence[AbstractGlass],
    *,
    stop: int,
    name: str = "lens",
) -> Prescription:
    """A `Prescription` that makes sense.

    Raises:
        ValueError: numbers that do not match, no such stop, or glass after the last surface; as a
            `SurfaceError` a semi-diameter that is not positive or wider than its surface, a curvature that is
            not finite, a negative thickness, or surfaces that cross within the clear radius of both.
    """
    count = len(surfaces)
    for what, some in (
        ("thicknesses", thicknesses),
        ("semi-diameters", semi_diameters),
        ("glasses", glasses),
    ):
        if len(some) != count:
            raise ValueError(f"{name} has {count} surfaces but {len(some)} {what}")
    if count == 0:
        raise ValueError(f"{name} has no surfaces; expected at least one")
    if not 0 <= stop < count:
        raise ValueError(f"the stop of {name} is surface {stop}; expected one of 0 to {count - 1}")
    for number, (gap, radius) in enumerate(zip(thicknesses, semi_diameters, strict=True)):
        if not 0 < radius < float("inf"):
            raise SurfaceError(name, (number,), f"has a semi-diameter of {radius:g} mm; expected > 0")
        if not 0 <= gap < float("inf"):
            raise SurfaceError(name, (number,), f"has a thickness of {gap:g} mm; expected 0 or more")
    behind = float(glasses[-1].index(line()))
    if abs(behind - 1.0) > _AIR:
        raise SurfaceError(
            name,
            (count - 1,),
            f"is the last and has glass of index {behind:.4g} behind it; expected air, so give the surface"
            " that is missing",
        )
    lens = Prescription(
        tuple(surfaces),
        device_array(thicknesses, dtype=float),
        device_array(semi_diameters, dtype=float),
        tuple(glasses),
        stop,
        name,
    )
    check_surfaces(lens)
    return lens


def singlet(
    front_radius: float,
    back_radius: float,
    *,
    thickness: float,
    semi_diameter: float,
    glass: AbstractGlass,
    name: str = "singlet",
) -> Prescription:
    """A lens of one piece of glass with two spherical surfaces; its front is the stop.

    Args:
        front_radius: mm, positive if the centre is on the film's side; `inf` is a plane.
        back_radius: likewise; negative for a biconvex lens.
        thickness: mm along the axis.
        semi_diameter: clear radius in mm of both surfaces.
        glass: what it is made of.
        name: what to call it.

    Raises:
        ValueError: a radius of 0, a length that is no number, glass by its name only, or as
            `make_prescription`.
    """
    usage = "singlet(front_radius, back_radius, thickness=, semi_diameter=, glass=)"
    require_kind(glass, AbstractGlass, usage, '`find_glass("N-BK7")` finds one', "glass")
    front_radius, back_radius = (
        real_number(radius, f"the {side} radius of {name}", "a length in mm, or inf for a plane")
        for side, radius in (("front", front_radius), ("back", back_radius))
    )
    thickness = real_number(thickness, f"the thickness of {name}", "a length in mm")
    semi_diameter = real_number(semi_diameter, f"the semi-diameter of {name}", "a length in mm")
    if front_radius == 0 or back_radius == 0:
        raise ValueError(f"a radius of {name} is 0; expected a length, or inf for a plane")
    return make_prescription(
        [sphere(1.0 / front_radius), sphere(1.0 / back_radius)],
        [thickness, 0.0],
        [semi_diameter, semi_diameter],
        [glass, air()],
        stop=0,
        name=name,
    )


def with_element(lens: Prescription, element: int, glass: AbstractGlass) -> Prescription:
    """The lens with another glass in one of its elements; surfaces and distances stay.

    Args:
        lens: any.
        element: its number from 1, from the scene's side; cemented elements count each.
        glass: what it is made of instead.

    Raises:
        ValueError: the lens has no such element, or the glass is air at the line d.

    Example:
        >>> from focusjax.optics import find_glass, first_order
        >>> lens = singlet(50.0, -50.0, thickness=5.0, semi_diameter=10.0, glass=find_glass("N-BK7"))
        >>> round(float(first_order(with_element(lens, 1, find_glass("N-SF11"))).focal_length), 3)
        32.575
    """
    found = _elements(lens)
    if not 1 <= element <= len(found):
        raise ValueError(
            f"{lens.name} has {len(found)} elements of glass, and no element {element}; expected 1 to"
            f" {len(found)}, counted from the scene's side"
        )
    if abs(float(glass.index(line())) - 1.0) <= _AIR:
        raise ValueError(f"element {element} of {lens.name} has the index of air; expected glass")
    own = found[element - 1]
    glasses = tuple(glass if number in own else each for number, each in enumerate(lens.glasses))
    return dataclasses.replace(lens, glasses=glasses)


def _elements(lens: Prescription) -> list[list[int]]:
    """Numbers of the media of each piece of glass; a stop inside it does not part it."""
    found: list[list[int]] = []
    for number, glass in enumerate(lens.glasses):
        if abs(float(glass.index(line())) - 1.0) <= _AIR:
            continue
        inside = number == lens.stop and number > 0 and eqx.tree_equal(glass, lens.glasses[number - 1])
        if inside and found:
            found[-1].append(number)
        else:
            found.append([number])
    return found


def line(name: str = "d") -> Float[Array, ""]:
    """Wavelength in nm of a Fraunhofer line, "d" for yellow."""
    return jnp.asarray(FRAUNHOFER[name], dtype=float)


def check_surfaces(lens: Prescription) -> None:
    """Each surface goes as far as its clear radius, and is before the next up to there.

    Raises:
        SurfaceError: one that does not.
    """
    radii = np.asarray(lens.semi_diameters)
    for number, (surface, radius) in enumerate(zip(lens.surfaces, radii, strict=True)):
        if not np.isfinite([float(value) for value in surface.osculating()]).all():
            raise SurfaceError(
                lens.name, (number,), "has a curvature that is not finite; expected a radius in mm"
            )
        if isinstance(surface, Conic | EvenAsphere):
            steep = (1.0 + float(surface.conic)) * float(surface.curvature) ** 2
            if steep * radius**2 > 1.0 + _EDGE:
                raise SurfaceError(
                    lens.name,
                    (number,),
                    f"has a semi-diameter of {radius:.4g} mm, but reaches {steep**-0.5:.4g} mm from the axis;"
                    " check its radius and semi-diameter",
                )
    shares = np.linspace(0.0, 1.0, 33)
    for number, (surface, following) in enumerate(zip(lens.surfaces, lens.surfaces[1:], strict=False)):
        uneven = isinstance(surface, HeightField) or isinstance(following, HeightField)
        directions = _DIRECTIONS if uneven else 1
        across = np.repeat(shares, directions) * radii[number : number + 2].min()
        angles = np.tile(np.linspace(0.0, 2.0 * np.pi, directions, endpoint=False), len(shares))
        gap = gap_between(surface, following, float(lens.thicknesses[number]), across, angles)
        if not gap.min() >= -CROSSING:
            raise SurfaceError(
                lens.name,
                (number, number + 1),
                f"cross within their clear radius, by {-gap.min():.3g} mm"
                f" {float(across[gap.argmin()]):.3g} mm from the axis; check the thickness between them and"
                " the semi-diameters",
            )


def gap_between(
    surface: AbstractSurface,
    following: AbstractSurface,
    thickness: float,
    across: Float[np.ndarray, " r"],
    angles: Float[np.ndarray, " r"] | float = 0.0,
) -> Float[np.ndarray, " r"]:
    """Millimetres along the axis from one surface to the next, so far `across` from it; negative beyond.

    Places are at `angles` around the axis in radians, from x.
    """
    places = [jnp.asarray(across * turned, dtype=float) for turned in (np.cos(angles), np.sin(angles))]
    before, after = (np.asarray(_sags(one, *places)) for one in (surface, following))
    return thickness + after - before


@jit
def _sags(surface: AbstractSurface, x: Float[Array, " r"], y: Float[Array, " r"]) -> Float[Array, " r"]:
    return jax.vmap(surface.sag)(x, y)
