"""Aberrations as functions of image height, as data sheets have them (Kyaw 2013 sections 6 and 7.2)."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._monotone_cubic import monotone_pieces, place_in_table
from focusjax.geometry import Camera
from focusjax.lens._base import frame_corners
from focusjax.lens._height_curve import HeightCurve
from focusjax.lens._length import length
from focusjax.lens.aberrations._base import AbstractAberration, Bounds

KINDS = {"distortion": True, "sagittal": True, "tangential": True, "spherical": True} | {
    "coma": False,
    "shift": False,
}
"""Names of tables, and whether they are the same on both sides of the axis."""


class TabulatedAberrations(AbstractAberration):
    """Aberrations of any order in the field, over any lens: tables over the height on the film.

    With h the distance of a film point from the axis on the film, e the direction away from there, b the
    ray's parallax and u = b / (f R) its place on the pupil of radius R, the ray of an ideal lens is moved by

        - S(h) (b - (b.e) e) - T(h) (b.e) e           sagittal and tangential focus,
        - A(h) |u|^2 b                                spherical aberration,
        + C(h) (|u|^2 e + 2 (u.e) u)                  coma,
        + [h / (1 + D(h)) - h - L(h)] e               distortion, and lateral colour of a channel,

    the lengths on the film in pixels. Seidel's five are S = c h^2, T = 3 c' h^2, constant A, C = c h and
    D = c h^2. Tables that are not there cost nothing.

    - "distortion": D, the share by which a point lands farther from the axis than it should, (h - r) / r with
      r its height through an ideal lens (Kyaw eq. 6.8), at the height h where it lands. Below 0 is barrel,
      above 0 pincushion.
    - "sagittal": S in 1/m: by how much rays across the plane of the axis focus nearer.
    - "tangential": T in 1/m: the same of those in the plane of the axis.
    - "spherical": A in 1/m: by how much the rim focuses nearer than the middle; above 0 under-corrected.
    - "coma": C in metres on the film: a third of the tail's length, which points to the axis above 0.
    - "shift": L in metres on the film: by how much a colour's picture lies farther from the axis.

    Between heights tables are followed by `HeightCurve`s. `tabulated_aberrations` makes them.

    Attributes:
        reach: metres from the axis to the tables' end.
        places: [k] shares of it, from 0 to 1.
        values: [k] of each table, by its name.
        full_radius: R in metres, of the opening that "spherical" and "coma" are for. Stopped down, rays have
            the aberrations of the part that they pass.
    """

    reach: Float[Array, ""]
    places: Float[Array, " k"]
    values: dict[str, Float[Array, " k"]]
    full_radius: Float[Array, ""]

    def offset(
        self,
        camera: Camera,
        film_point: Float[Array, "2"],
        pupil_point: Float[Array, "2"],
        b: Float[Array, "2"],
    ) -> Float[Array, "2"]:
        del pupil_point
        height, away = _off_axis(camera, film_point)
        found = self._at(height)
        u = b / self._full(camera)
        along, square = b @ away, u @ u
        moved = _outwards(found, camera, height) * away
        if "sagittal" in found:
            moved -= found["sagittal"] * (b - along * away)
        if "tangential" in found:
            moved -= found["tangential"] * along * away
        if "spherical" in found:
            moved -= found["spherical"] * square * b
        if "coma" in found:
            moved += found["coma"] / _pitch(camera) * (square * away + 2.0 * (u @ away) * u)
        return moved

    def bounds(self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]) -> Bounds:
        height, away = _off_axis(camera, film_point)
        found = self._at(height)
        S, T, A, C = _blurs(found, height)
        # (b.e) e is b / 2 and as much again, mirrored at e. Coma's circles lie in a disk that they touch on
        # both sides, 1.5 C around.
        square = (parallax / self._full(camera)) ** 2
        flat, coma = 0.5 * (S + T), 1.5 * C / _pitch(camera) * square
        return Bounds(
            least=flat + jnp.minimum(A * square, 0.0),
            most=flat + jnp.maximum(A * square, 0.0),
            shift=(coma + _outwards(found, camera, height)) * away,
            spread=jnp.abs(coma) + 0.5 * jnp.abs(T - S) * parallax,
        )

    def overall(self, camera: Camera, parallax: Float[Array, ""]) -> Bounds:
        corners = frame_corners(camera, self.full_radius.dtype)
        away = jnp.sqrt(((corners - camera.principal_point[None]) ** 2).sum(axis=1).max())
        least, most = self._extents(away * _pitch(camera))
        (s0, t0, a0, c0), (s1, t1, a1, c1) = (_blurs(each, away) for each in (least, most))
        square = (parallax / self._full(camera)) ** 2
        apart = jnp.maximum(jnp.abs(t1 - s0), jnp.abs(t0 - s1))
        moved = 3.0 * jnp.maximum(-c0, c1) / _pitch(camera) * square
        if "distortion" in most:
            shares = [end["distortion"] / (1.0 + end["distortion"]) for end in (least, most)]
            moved += away * jnp.maximum(*map(jnp.abs, shares))
        if "shift" in most:
            moved += jnp.maximum(-least["shift"], most["shift"]) / _pitch(camera)
        none = jnp.zeros_like(away)
        return Bounds(
            least=0.5 * (s0 + t0) + jnp.minimum(a0, 0.0) * square,
            most=0.5 * (s1 + t1) + jnp.maximum(a1, 0.0) * square,
            shift=jnp.stack([none, none]),
            spread=moved + 0.5 * apart * parallax,
        )

    def defocus(
        self, camera: Camera, film_point: Float[Array, "2"], parallax: Float[Array, ""]
    ) -> Float[Array, ""]:
        # The mean of |u|^2 weighted by |u|^2 is two thirds of the rim's.
        height, _ = _off_axis(camera, film_point)
        S, T, A, _ = _blurs(self._at(height), height)
        return 0.5 * (S + T) + 2.0 / 3.0 * A * (parallax / self._full(camera)) ** 2

    def _at(self, height: Float[Array, ""]) -> dict[str, Float[Array, ""]]:
        """All tables at a height in metres; beyond their end their last lines go on."""
        share = height / self.reach
        number, t = place_in_table(self.places, share)
        beyond = jnp.maximum(share - 1.0, 0.0) / (self.places[-1] - self.places[-2])
        found = {}
        for name, values in self.values.items():
            pieces = monotone_pieces(self.places, values, level_start=KINDS[name])
            # Number by number, which XLA fetches quicker than rows.
            c0, c1, c2, c3 = (pieces[:, power][number] for power in range(4))
            found[name] = c0 + t * (c1 + t * (c2 + t * c3)) + beyond * (values[-1] - values[-2])
        return found

    def _extents(
        self, height: Float[Array, ""]
    ) -> tuple[dict[str, Float[Array, ""]], dict[str, Float[Array, ""]]]:
        """The least and the largest value of each table from the axis to `height`."""
        least, most = {}, {}
        for name, end in self._at(height).items():
            reached = jnp.where(self.reach * self.places <= height, self.values[name], end)
            least[name] = jnp.minimum(reached.min(), end)
            most[name] = jnp.maximum(reached.max(), end)
        return least, most

    def _full(self, camera: Camera) -> Float[Array, ""]:
        """Pixels per dioptre of the full opening's rim."""
        return camera.focal_px * self.full_radius


def tabulated_aberrations(
    curves: Mapping[str, HeightCurve | None], full_radius: Float[Array, ""] | float
) -> tuple[TabulatedAberrations, ...]:
    """The fewest `TabulatedAberrations` for some curves: one for all that have the same heights.

    Args:
        curves: by name of the table; None is left out.
        full_radius: metres, of the opening that "spherical" and "coma" are for.

    Raises:
        ValueError: an unknown name, or a curve that is not even where its kind is, or the other way round.

    Example:
        >>> from focusjax.lens import AberratedLens, height_curve, thin_lens
        >>> barrel = height_curve([0.0, 0.01, 0.02], [0.0, -0.01, -0.04])
        >>> terms = tabulated_aberrations({"distortion": barrel}, 0.0125)
        >>> lens = AberratedLens(thin_lens(focus_distance=2, aperture_radius=0.0125), terms)
    """
    groups: dict[bytes, dict[str, HeightCurve]] = {}
    for name, curve in curves.items():
        if name not in KINDS:
            raise ValueError(f"there is no aberration {name!r}; expected one of {', '.join(KINDS)}")
        if curve is None:
            continue
        if curve.even != KINDS[name]:
            kind = "even" if KINDS[name] else "odd"
            raise ValueError(f"the curve of {name} has even = {curve.even}; expected an {kind} one")
        groups.setdefault(np.asarray(curve.heights).tobytes(), {})[name] = curve
    made = []
    for group in groups.values():
        one = next(iter(group.values()))
        values = {name: curve.values for name, curve in group.items()}
        made.append(
            TabulatedAberrations(one.reach, one.places, values, jnp.asarray(full_radius, dtype=float))
        )
    return tuple(made)


def _outwards(
    found: dict[str, Float[Array, ""]], camera: Camera, height: Float[Array, ""]
) -> Float[Array, ""]:
    """Pixels that a film point looks farther out than an ideal lens's."""
    moved = jnp.zeros_like(height)
    if "distortion" in found:
        moved -= height * found["distortion"] / (1.0 + found["distortion"])
    if "shift" in found:
        moved -= found["shift"]
    return moved / _pitch(camera)


def _off_axis(camera: Camera, film_point: Float[Array, "2"]) -> tuple[Float[Array, ""], Float[Array, "2"]]:
    """Metres from the axis on the film, and the direction away from there, which is 0 on it."""
    from_axis = film_point - camera.principal_point
    pixels = length(from_axis)
    return pixels * _pitch(camera), from_axis / jnp.where(pixels > 0.0, pixels, 1.0)


def _pitch(camera: Camera) -> Float[Array, ""]:
    """Metres on the film that a pixel's side takes."""
    return camera.sensor_width / camera.width


def _blurs(found: dict[str, Float[Array, ""]], like: Float[Array, ""]) -> list[Float[Array, ""]]:
    names = ("sagittal", "tangential", "spherical", "coma")
    return [found.get(name, jnp.zeros_like(like)) for name in names]
