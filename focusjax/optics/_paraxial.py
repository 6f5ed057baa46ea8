"""First-order optics: rays near the axis, as 2 x 2 matrices on (height y, slope u).

Across a surface of curvature c, n' u' = n u - y c (n' - n); over a gap t, y' = y + t u. With [[A, B], [C, D]]
from the first vertex to the last, the focal length in air is -1 / C and the rear focal point -A / C behind
the last vertex. With [[a, b], [c, d]] up to the stop, the stop is seen at b / a behind the first vertex, 1 /
a times as large.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.optics._prescription import Prescription, line


class FirstOrder(eqx.Module):
    """Cardinal points and pupils. Lengths in mm; places are positive towards the film.

    Attributes:
        focal_length: effective focal length; negative for a diverging lens, infinite for an afocal one.
        back_focal_distance: from the last vertex to the rear focal point.
        front_focal_distance: from the first vertex to the front focal point; usually negative.
        front_principal_plane: from the first vertex.
        rear_principal_plane: from the last vertex.
        entrance_pupil: from the first vertex.
        entrance_pupil_radius: for the stop as it is.
        exit_pupil: from the last vertex.
        exit_pupil_radius: for the stop as it is.
        f_number: focal length over entrance pupil diameter.
    """

    focal_length: Float[Array, ""]
    back_focal_distance: Float[Array, ""]
    front_focal_distance: Float[Array, ""]
    front_principal_plane: Float[Array, ""]
    rear_principal_plane: Float[Array, ""]
    entrance_pupil: Float[Array, ""]
    entrance_pupil_radius: Float[Array, ""]
    exit_pupil: Float[Array, ""]
    exit_pupil_radius: Float[Array, ""]
    f_number: Float[Array, ""]


@jit
def first_order(lens: Prescription, wavelength: Float[Array, ""] | None = None) -> FirstOrder:
    """Cardinal points and pupils of `lens` at a `wavelength` in nm, that of the line d if None.

    Example:
        >>> lens = fj.lens_preset("planar_us583336_f4.5_1897")
        >>> round(float(first_order(lens).focal_length), 2)
        49.39
    """
    indices = lens.indices(line() if wavelength is None else wavelength)
    whole, to_stop = system_matrices(lens, indices)
    (A, _), (C, D) = whole
    (a, b), (c, d) = to_stop
    # From before the stop on: whole = rear part times front part.
    determinant = a * d - b * c
    _, (b_rear, d_rear) = (whole @ jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])]) / determinant).T
    radius = lens.semi_diameters[lens.stop]
    focal_length, pupil_radius = -1.0 / C, radius / jnp.abs(a)
    return FirstOrder(
        focal_length=focal_length,
        back_focal_distance=-A / C,
        front_focal_distance=D / C,
        front_principal_plane=D / C + focal_length,
        rear_principal_plane=-A / C - focal_length,
        entrance_pupil=b / a,
        entrance_pupil_radius=pupil_radius,
        exit_pupil=-b_rear / d_rear,
        exit_pupil_radius=radius * indices[lens.stop] / jnp.abs(d_rear),
        f_number=jnp.abs(focal_length) / (2.0 * pupil_radius),
    )


def system_matrices(
    lens: Prescription, indices: Float[Array, " n_plus_1"]
) -> tuple[Float[Array, "2 2"], Float[Array, "2 2"]]:
    """[[A, B], [C, D]] from the first vertex to the last, in air; and to the stop, before it refracts."""
    curvatures = jnp.stack([surface.osculating()[0] for surface in lens.surfaces])
    before, after = indices[:-1], indices[1:]
    zero, one = jnp.zeros_like(before), jnp.ones_like(before)

    def matrices(rows: list[list[Array]]) -> Array:
        return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)

    bends = matrices([[one, zero], [-curvatures * (after - before) / after, before / after]])
    # Of the gap before each surface; there is none before the first.
    gaps = matrices([[one, jnp.roll(lens.thicknesses, 1).at[0].set(0.0)], [zero, one]])

    def step(matrix: Array, bend_and_gap: tuple[Array, Array]) -> tuple[Array, Array]:
        bend, gap = bend_and_gap
        arrived = gap @ matrix
        return bend @ arrived, arrived

    whole, arrived = jax.lax.scan(step, jnp.eye(2, dtype=indices.dtype), (bends, gaps))
    return whole, arrived[lens.stop]


@jit
def film_distance(
    lens: Prescription, indices: Float[Array, " n_plus_1"], disparity: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Where the film has to be for a plane to be sharp, by first-order optics, and how large it is there.

    Args:
        lens: in millimetres.
        indices: refractive indices.
        disparity: 1/mm, inverse distance of the plane in focus from the entrance pupil; 0 is infinity.

    Returns:
        Distance in mm from the last vertex to the film, and the film height in mm of a point of that plane
        per unit of the slope at which the entrance pupil sees it: the focal length at infinity.
    """
    ((A, B), (C, D)), ((a, b), _) = system_matrices(lens, indices)
    pupil = b / a
    # The object's distance from the first vertex is (1 - pupil w) / w.
    near = 1.0 - pupil * disparity
    slope = C * near + D * disparity
    return -(A * near + B * disparity) / slope, -1.0 / slope


def stopped_down(
    lens: Prescription, f_number: float | Float[Array, ""], wavelength: Float[Array, ""] | None = None
) -> Prescription:
    """The lens with its stop opened or closed so that its f-number for far things is `f_number`.

    Not checked against the opening that the maker gives it; `opened_to` is.
    """
    seen = first_order(lens, wavelength)
    radius = lens.semi_diameters[lens.stop] * seen.f_number / f_number
    return dataclasses.replace(lens, semi_diameters=lens.semi_diameters.at[lens.stop].set(radius))


def opened_to(lens: Prescription, f_number: float) -> Prescription:
    """`stopped_down`, checked.

    Raises:
        ValueError: not a positive number, or an opening beyond that of the prescription.
    """
    if not 0 < f_number < float("inf"):
        raise ValueError(f"f-number is {f_number}; expected a positive number such as 2.8")
    widest = float(first_order(lens).f_number)
    if f_number < widest * (1 - 1e-3):
        raise ValueError(f"{lens.name} opens to f/{widest:.3g} at most; f/{f_number:g} is beyond that")
    return stopped_down(lens, f_number)


def with_focal_length(lens: Prescription, focal_length: float) -> Prescription:
    """The lens scaled to a focal length in mm; the f-number stays.

    Raises:
        ValueError: a focal length that is not positive, or a lens that has none (afocal) or a negative one.
    """
    if not 0 < focal_length < float("inf"):
        raise ValueError(f"focal length is {focal_length} mm; expected a positive length")
    return lens.scaled(focal_length / converging_length(lens))


def converging_length(lens: Prescription) -> float:
    """The focal length in mm of a lens that forms real images of far things.

    Raises:
        ValueError: it is afocal or diverging.
    """
    length = float(first_order(lens).focal_length)
    extent = float(jnp.sum(lens.thicknesses)) + float(jnp.max(lens.semi_diameters))
    if not abs(length) < 1e6 * extent:
        raise ValueError(f"{lens.name} is afocal: it forms no image of far things on any film")
    if length < 0:
        raise ValueError(
            f"{lens.name} has a focal length of {length:.4g} mm; only a converging lens forms an image on a"
            " film"
        )
    return length
