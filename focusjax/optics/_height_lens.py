"""Lenses with surfaces from pictures of heights (Lee10 section 3): alone, or ahead of other glass."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax.optics._glass import AbstractGlass, air
from focusjax.optics._height_field import HeightField
from focusjax.optics._prescription import Prescription, check_surfaces, line, make_prescription
from focusjax.optics._rounding import without_rounding
from focusjax.optics._surfaces import sphere

_AIR = 1e-3
"""By which the index of glass has to be more than 1 at the least."""


def height_field(
    picture: Float[np.ndarray, "rows columns"],
    *,
    width: float,
    scale: float,
    towards: str,
    step: float = 0.0,
) -> HeightField:
    """A surface of glass from a picture of its heights, as one sees it from behind the lens.

    Args:
        picture: heights, as many rows as columns, the first row at the top; the vertex is in the middle.
        width: mm from the middle of the first column to that of the last.
        scale: mm by which a height of 1 stands out of the glass beyond one of 0.
        towards: the side that glass stands out to: "scene", of a front, or "film", of a back.
        step: what heights are multiples of, such as 1 / 65535 of 16 bits from 0 to 1; the smoothest surface
            is taken that they may have been rounded from. 0 takes them as they are.

    Raises:
        ValueError: fewer than 4 rows, other than square, numbers that are not finite, a width that is not
            positive, or another side.

    Example:
        >>> plate = height_field(np.full((9, 9), 0.5), width=20.0, scale=1.0, towards="scene")
        >>> float(plate.sag(jnp.asarray(3.0), jnp.asarray(0.0)))
        0.0
    """
    if picture.ndim != 2 or picture.shape[0] != picture.shape[1] or picture.shape[0] < 4:
        raise ValueError(
            f"has {' x '.join(str(each) for each in picture.shape)} heights; expected as many rows as"
            " columns, at least 4, so crop or resample it"
        )
    bad = ~np.isfinite(picture)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise ValueError(
            f"has {int(bad.sum())} heights that are not finite, the first in row {row}, column {column};"
            " expected numbers, so fill them in"
        )
    if not 0 < width < math.inf:
        raise ValueError(f"has a width of {width:g} mm; expected a positive one")
    if not math.isfinite(scale):
        raise ValueError(f"has a scale of {scale:g} mm; expected a finite one")
    if towards not in ("scene", "film"):
        raise ValueError(f"has towards {towards!r}; expected 'scene', of a front, or 'film', of a back")
    if step > 0.0:
        picture = without_rounding(picture, step)
    count = picture.shape[0]
    low, high = (count - 1) // 2, count // 2
    vertex = picture[[low, low, high, high], [low, high, low, high]].mean()
    out = -scale if towards == "scene" else scale
    # Rows go down in a picture, and y up in a lens.
    heights = out * (picture - vertex)[::-1]
    spacing = jnp.asarray(width / (count - 1), dtype=float)
    return HeightField(jnp.asarray(heights, dtype=float), spacing)


def height_field_lens(
    front: HeightField,
    back: HeightField | None = None,
    *,
    thickness: float,
    glass: AbstractGlass,
    semi_diameter: float | None = None,
    name: str = "height field",
) -> Prescription:
    """A lens of one piece of glass between one or two height fields; its front is the stop.

    Args:
        front: on the scene's side.
        back: on the film's side; flat if not given.
        thickness: mm along the axis.
        glass: what it is made of.
        semi_diameter: clear radius in mm; as far as there are heights if not given.
        name: what to call it.

    Raises:
        ValueError: a clear radius beyond the heights, glass with the index of air, or as `make_prescription`.

    Example:
        >>> from focusjax.optics import find_glass, first_order
        >>> y, x = np.mgrid[-10:10:41j, -10:10:41j]
        >>> bowl = height_field(-0.01 * (x**2 + y**2), width=20.0, scale=1.0, towards="scene")
        >>> lens = height_field_lens(bowl, thickness=3.0, glass=find_glass("1.5"))
        >>> round(float(first_order(lens).focal_length), 2)
        100.0
    """
    fields = [front] if back is None else [front, back]
    widest = min(float(field.reach()) for field in fields)
    radius = widest if semi_diameter is None else semi_diameter
    if radius > widest * (1.0 + 1e-6):
        raise ValueError(
            f"{name} has a clear radius of {radius:g} mm, and heights to {widest:.4g} mm from the axis,"
            " a cell less than the picture; make the one smaller or the other larger"
        )
    index = float(glass.index(line()))
    if index <= 1.0 + _AIR:
        raise ValueError(f"{name} has glass of index {index:.5g}; expected more than 1, such as 1.5168")
    surfaces = [front, sphere(0.0) if back is None else back]
    return make_prescription(surfaces, [thickness, 0.0], [radius] * 2, [glass, air()], stop=0, name=name)


def put_ahead(plate: Prescription, lens: Prescription, gap: float) -> Prescription:
    """A piece of glass on the scene's side of a lens, whose stop is kept; both in mm as they are.

    Args:
        plate: what light meets first.
        lens: behind it.
        gap: mm from the plate's last vertex to the lens's first.

    Raises:
        ValueError: surfaces that cross.

    Example:
        >>> from focusjax.optics import find_glass, first_order, lens_preset, singlet
        >>> flat = singlet(np.inf, np.inf, thickness=2.0, semi_diameter=20.0, glass=find_glass("1.5"))
        >>> triplet = lens_preset("cooke_triplet_50mm_f4")
        >>> both = put_ahead(flat, triplet, 5.0)
        >>> change = first_order(both).focal_length - first_order(triplet).focal_length
        >>> bool(abs(change) < 1e-4), both.stop - triplet.stop
        (True, 2)
    """
    before = plate.thicknesses.at[-1].set(gap)
    made = dataclasses.replace(
        lens,
        surfaces=(*plate.surfaces, *lens.surfaces),
        thicknesses=jnp.concatenate([before, lens.thicknesses]),
        semi_diameters=jnp.concatenate([plate.semi_diameters, lens.semi_diameters]),
        glasses=(*plate.glasses, *lens.glasses),
        stop=lens.stop + len(plate.surfaces),
        name=f"{lens.name} behind {plate.name}",
    )
    check_surfaces(made)
    return made
