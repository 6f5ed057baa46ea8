"""Real rays through a prescription, surface by surface."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.optics._prescription import Prescription
from focusjax.optics._surfaces import AbstractSurface, Real

BLOCKED = -1e3
"""The clearance of a ray that missed a surface, was totally reflected, or turned back."""
_LEAST_ADVANCE = 1e-3
"""Smallest cosine to the axis of a ray that still goes on."""


class RealRay(eqx.Module):
    """A ray where it leaves a lens.

    Attributes:
        position: point of the last surface it met, in mm from the first vertex [3].
        direction: unit vector [3].
        clearance: least 1 - (distance from the axis) / (semi-diameter) over all surfaces: 1 along the axis, 0
            at a rim, negative where the ray is cut off, and `BLOCKED` where there is none. A blocked ray goes
            along the axis from the last vertex, so that it and its derivatives are finite.
    """

    position: Float[Array, "3"]
    direction: Float[Array, "3"]
    clearance: Float[Array, ""]


def trace(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    position: Float[Array, "3"],
    direction: Float[Array, "3"],
    *,
    backward: bool = False,
) -> RealRay:
    """One ray through all surfaces of `lens`; callers vmap. Differentiable in everything.

    Args:
        lens: what it passes.
        indices: refractive indices at the ray's wavelength (`lens.indices`).
        position: any point of the ray, in mm; the first vertex is the origin, z along the light's way.
        direction: unit vector of the ray's way.
        backward: from the film's side to the scene's; then the direction's z is negative.

    Returns:
        The ray as it leaves. Where surfaces cut it off it goes on as if they did not end.
    """
    return trace_path(lens, indices, position, direction, backward=backward)[0]


def trace_path(
    lens: Prescription,
    indices: Float[Array, " n_plus_1"],
    position: Float[Array, "3"],
    direction: Float[Array, "3"],
    *,
    backward: bool = False,
) -> tuple[RealRay, Float[Array, "n 3"]]:
    """As `trace`, with the points where the ray meets each surface, in the order of the surfaces."""
    (x, y, z, u, v, w, clearance, alive), points = _walk(lens, indices, position, direction, backward)
    ray = RealRay(
        position=jnp.stack([x, y, z]),
        direction=jnp.stack([u, v, w]),
        clearance=jnp.where(alive, clearance, BLOCKED),
    )
    return ray, points[::-1] if backward else points


@jit
def _walk(
    lens: Prescription, indices: Array, position: Array, direction: Array, backward: bool
) -> tuple[tuple, Float[Array, "n 3"]]:
    """The state of a ray after all surfaces, and its points on them in the order it meets them."""
    ahead = -1.0 if backward else 1.0
    u, v, w = direction
    alive = w * ahead > _LEAST_ADVANCE
    way = _or_axis(alive, u, v, w, ahead)
    before, after = (indices[1:], indices[:-1]) if backward else (indices[:-1], indices[1:])
    state = (*position, *way, jnp.ones_like(u), alive)
    data = (lens.vertices(), lens.semi_diameters, before / after)

    def step(state: tuple, surface_and_data: tuple) -> tuple[tuple, Array]:
        surface, vertex, semi_diameter, ratio = surface_and_data
        state = _pass(state, surface, vertex, semi_diameter, ratio, ahead)
        return state, jnp.stack(state[:3])

    points = []
    for run in runs(lens.surfaces, backward=backward):
        chosen = jax.tree.map(lambda leaf, run=run: leaf[jnp.array(run)], data)
        surfaces = [lens.surfaces[number] for number in run]
        stacked = jax.tree.map(lambda *one: jnp.stack(one), *surfaces)
        state, met = jax.lax.scan(step, state, (stacked, *chosen))
        points.append(met)
    return state, jnp.concatenate(points)


def runs(surfaces: Sequence[AbstractSurface], *, backward: bool = False) -> list[list[int]]:
    """Numbers of surfaces in the order of a ray, those that follow one another and are alike in one list.

    One compiled step serves such a run.
    """
    order = range(len(surfaces))
    found: list[list[int]] = []
    for number in reversed(order) if backward else order:
        if found and _kind(surfaces[found[-1][-1]]) == _kind(surfaces[number]):
            found[-1].append(number)
        else:
            found.append([number])
    return found


def _kind(surface: AbstractSurface) -> tuple:
    leaves, structure = jax.tree.flatten(surface)
    return structure, tuple(leaf.shape for leaf in leaves)


def _pass(
    state: tuple, surface: AbstractSurface, vertex: Real, semi_diameter: Real, ratio: Real, ahead: float
) -> tuple:
    """Through one surface, with `ratio` the index before it over that after it."""
    x, y, z, u, v, w, clearance, alive = state
    # From the vertex plane on, so that far starts cost no digits.
    plane = (vertex - z) / w
    x, y = x + plane * u, y + plane * v
    distance, met = surface.meet(x, y, u, v, w)
    alive &= met
    x, y, height = (
        jnp.where(alive, value, 0.0) for value in (x + distance * u, y + distance * v, distance * w)
    )
    clearance = jnp.minimum(clearance, 1.0 - _norm(x, y) / semi_diameter)
    u, v, w, passed = _refract(u, v, w, surface.normal(x, y, height), ratio)
    alive &= passed & (w * ahead > _LEAST_ADVANCE)
    x, y, height = (jnp.where(alive, value, 0.0) for value in (x, y, height))
    return x, y, vertex + height, *_or_axis(alive, u, v, w, ahead), clearance, alive


def _refract(
    u: Real, v: Real, w: Real, normal: tuple[Real, Real, Real], ratio: Real
) -> tuple[Real, Real, Real, Array]:
    """Snell's law in vectors, and whether the ray is not totally reflected; `ratio` is n / n'."""
    nx, ny, nz = normal
    scale = 1.0 / jnp.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx * scale, ny * scale, nz * scale
    cosine = nx * u + ny * v + nz * w
    square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    passed = square > 0.0
    root = jnp.sqrt(jnp.where(passed, square, 1.0))
    along = jnp.where(cosine < 0.0, -root, root) - ratio * cosine
    return ratio * u + along * nx, ratio * v + along * ny, ratio * w + along * nz, passed


def _or_axis(alive: Array, u: Real, v: Real, w: Real, ahead: float) -> tuple[Real, Real, Real]:
    return jnp.where(alive, u, 0.0), jnp.where(alive, v, 0.0), jnp.where(alive, w, ahead)


def _norm(x: Real, y: Real) -> Real:
    """Distance from the axis, with derivative 0 on it."""
    square = x * x + y * y
    off = square > 0.0
    return jnp.where(off, jnp.sqrt(jnp.where(off, square, 1.0)), 0.0)
