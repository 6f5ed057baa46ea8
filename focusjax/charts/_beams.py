"""Rays from points of the scene through a real lens, and what they show of it. Lengths are millimetres."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.optics import Prescription, first_order, line, trace, trace_path

FULL_FRAME = 21.63
"""Half the diagonal in mm of a 36 mm x 24 mm film."""
_LINE = 1001
"""Rays along a line across the pupil."""
_NEAR_AXIS = 1e-3
"""Field angle in radians at which a lens does not distort."""
_LEAST_LIGHT = 0.1
"""Share of the axis's light below which a field point counts as dark."""


@jit
def _through(
    lens: Prescription, wavelength: Array, start: Float[Array, "r 3"], way: Float[Array, "r 3"]
) -> tuple[Float[Array, "r 3"], Float[Array, "r 3"], Float[Array, " r"]]:
    indices = lens.indices(wavelength)
    rays = jax.vmap(lambda p, d: trace(lens, indices, p, d))(start, way)
    return rays.position, rays.direction, rays.clearance


@dataclasses.dataclass
class Beam:
    """Rays that pass a lens.

    Attributes:
        pupil: where they cross the plane of the entrance pupil [r, 2].
        position: on the last surface [r, 3].
        slope: dx/dz and dy/dz behind it [r, 2].
    """

    pupil: np.ndarray
    position: np.ndarray
    slope: np.ndarray

    def at(self, place: float) -> np.ndarray:
        """Where the rays cross the plane z = `place`, counted from the first vertex [r, 2]."""
        return self.position[:, :2] + self.slope * (place - self.position[:, 2:])

    def best_place(self) -> float:
        """Z of the plane where the rays are closest together, by their variance."""
        at_zero = self.at(0.0)
        spread, slope = at_zero - at_zero.mean(axis=0), self.slope - self.slope.mean(axis=0)
        return -float((spread * slope).sum() / (slope**2).sum())


def beam(
    lens: Prescription,
    field: float,
    *,
    wavelength: float | None = None,
    distance: float = np.inf,
    across: int = 41,
    width: float = 1.5,
    scattered: bool = False,
) -> Beam:
    """The rays of a point at the angle `field` (radians, upwards) that pass, over a square grid of the pupil.

    Args:
        lens: in mm.
        field: angle to the axis at the entrance pupil.
        wavelength: nm; that of the line d if None.
        distance: mm from the entrance pupil along the axis.
        across: rays along each side of the grid.
        width: half the grid's side, in radii of the entrance pupil.
        scattered: put each ray anywhere in its cell of the grid, so that no pattern shows.
    """
    pupil, points = _grid(lens, across, width, scattered)
    start, way = rays_from(lens, field, distance, points, pupil)
    at = line() if wavelength is None else jnp.asarray(wavelength, dtype=float)
    position, direction, clearance = (np.asarray(part) for part in _through(lens, at, start, way))
    passed = clearance >= 0
    slope = direction[passed, :2] / direction[passed, 2:]
    return Beam(np.asarray(points)[passed], position[passed], slope)


def rays_from(
    lens: Prescription, field: float, distance: float, points: np.ndarray, pupil: float
) -> tuple[Float[Array, "r 3"], Float[Array, "r 3"]]:
    """Starts and unit directions of rays of a scene point towards `points` [r, 2] of the pupil plane."""
    target = np.column_stack([points, np.full(len(points), pupil)])
    if np.isinf(distance):
        way = np.broadcast_to([0.0, np.sin(field), np.cos(field)], target.shape)
    else:
        way = target - np.array([0.0, -np.tan(field) * distance, pupil - distance])
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    # From before the first surface, as bulging as it may be.
    before = 2.0 * float(lens.semi_diameters[0])
    start = target - way * ((pupil + before) / way[:, 2:])
    return jnp.asarray(start, dtype=float), jnp.asarray(way, dtype=float)


def _grid(lens: Prescription, across: int, width: float, scattered: bool) -> tuple[float, np.ndarray]:
    seen = first_order(lens)
    cells = np.stack(np.meshgrid(np.arange(across), np.arange(across)), axis=-1).reshape(-1, 2)
    offset = np.random.default_rng(0).random(cells.shape) if scattered else 0.5
    radius = float(seen.entrance_pupil_radius) * width
    return float(seen.entrance_pupil), radius * ((cells + offset) / across * 2.0 - 1.0)


def paths(lens: Prescription, field: float, count: int, film: float) -> list[np.ndarray]:
    """Points (z, y) of `count` rays of a far point at `field`, from the lowest to the highest that pass.

    The outermost two are the rim rays (the marginal rays, of a point on the axis), as far as rounding lets
    them pass. None where no light passes.
    """
    ends = _rims(lens, field)
    if ends is None:
        return []
    start, way = _fan(lens, field, np.linspace(*ends, count))
    rays, met = _paths(lens, start, way)
    found = []
    for number in range(count):
        if float(rays.clearance[number]) < 0:
            continue
        direction, last = np.asarray(rays.direction[number]), np.asarray(met[number, -1])
        end = last + direction * (film - last[2]) / direction[2]
        found.append(np.vstack([start[number], met[number], end])[:, [2, 1]])
    return found


def _fan(
    lens: Prescription, field: float, heights: np.ndarray
) -> tuple[Float[Array, "r 3"], Float[Array, "r 3"]]:
    """Rays of a far point at `field` towards heights [r] of the pupil, in its radii."""
    seen = first_order(lens)
    points = np.column_stack([np.zeros_like(heights), heights * float(seen.entrance_pupil_radius)])
    return rays_from(lens, field, np.inf, points, float(seen.entrance_pupil))


def _rims(lens: Prescription, field: float) -> tuple[float, float] | None:
    """The lowest and the highest ray of a far point that pass, as heights in radii of the pupil."""

    def passing(heights: np.ndarray) -> np.ndarray:
        return heights[np.asarray(_through(lens, line(), *_fan(lens, field, heights))[2]) >= 0]

    reach = 1.5
    found = passing(np.linspace(-reach, reach, _LINE))
    if not len(found):
        return None
    pitch = 2.0 * reach / (_LINE - 1)
    # Once more between the last ray that passes and the first that does not.
    steps = np.linspace(0.0, pitch, _LINE)
    return float(passing(found[0] - steps).min()), float(passing(found[-1] + steps).max())


@jit
def _paths(lens: Prescription, start: Array, way: Array) -> tuple:
    indices = lens.indices(line())
    return jax.vmap(lambda p, d: trace_path(lens, indices, p, d))(start, way)


def largest_field(lens: Prescription) -> float:
    """The angle in radians of a full frame's corner, or the largest at which there is light to speak of."""
    angle = float(np.arctan(FULL_FRAME / float(first_order(lens).focal_length)))
    axis = len(beam(lens, 0.0).pupil)
    for share in np.linspace(1.0, 0.3, 15):
        if len(beam(lens, share * angle, width=1.5).pupil) >= _LEAST_LIGHT * axis:
            return float(share * angle)
    return 0.3 * angle


def film_at(lens: Prescription) -> float:
    """Z of the film that gives far points on the axis the least spot."""
    return beam(lens, 0.0).best_place()


@dataclasses.dataclass
class FieldCurves:
    """Focus and distortion over the field.

    Attributes:
        angles: field angles in radians [n].
        tangential: focus of rays in the plane of axis and point, in mm from the film [n].
        sagittal: focus of rays across that plane, in mm from the film [n].
        distortion: in % [n].
    """

    angles: np.ndarray
    tangential: np.ndarray
    sagittal: np.ndarray
    distortion: np.ndarray


def field_curves(lens: Prescription, fields: np.ndarray, film: float) -> FieldCurves:
    """Tangential and sagittal focus and distortion for some field angles in radians.

    Of rays close to the one through the middle of the beam that passes; distortion is against the scale of
    the picture near the axis, where the film is. Differences of near rays take float64.
    """
    tangential, sagittal, scales = [], [], []
    step = 1e-3 * float(first_order(lens).entrance_pupil_radius)
    pupil, reach = float(first_order(lens).entrance_pupil), 1500.0 * step
    for field in [*fields, _NEAR_AXIS]:
        line_up = np.column_stack([np.zeros(_LINE), reach * np.linspace(-1.0, 1.0, _LINE)])
        start, way = rays_from(lens, float(field), np.inf, line_up, pupil)
        passed = line_up[np.asarray(_through(lens, line(), start, way)[2]) >= 0, 1]
        middle = np.array([0.0, 0.5 * (passed.max() + passed.min()) if len(passed) else 0.0])
        near = middle + step * np.array([(0, 0), (0, 1), (0, -1), (1, 0), (-1, 0)])
        start, way = rays_from(lens, float(field), np.inf, near, pupil)
        position, direction, _ = (np.asarray(part) for part in _through(lens, line(), start, way))
        rays = Beam(near, position, direction[:, :2] / direction[:, 2:])
        landed = rays.at(film)

        def meet(one: int, other: int, axis: int, rays: Beam = rays, landed: np.ndarray = landed) -> float:
            apart = landed[one, axis] - landed[other, axis]
            return -float(apart / (rays.slope[one, axis] - rays.slope[other, axis]))

        tangential.append(meet(1, 2, 1))
        sagittal.append(meet(3, 4, 0))
        scales.append(landed[0, 1] / np.tan(field) if field else np.nan)
    distortion = 100.0 * (np.array(scales[:-1]) / scales[-1] - 1.0)
    return FieldCurves(fields, np.array(tangential[:-1]), np.array(sagittal[:-1]), np.nan_to_num(distortion))
