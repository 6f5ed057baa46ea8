"""The ray from a film point to a given place in the scene.

The aperture point v and the place q where its ray passes a disparity are an affine map of each other for thin
lenses, and nearly one for glass. Newton's method from the middle of the aperture finds v for q:

    v <- v + J^-1 (q - q(v)),        J = dq/dv.

It is exact after one step for a thin lens, and after a few is off by little for glass, unless several v have
the same q, as where the lens forms a caustic. There J changes sign, or nearly.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from focusjax._few import largest_of_few
from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens

_STEPS = 6
_STAYS = 1e-5
"""Aperture radii below which a step changes nothing."""
_FARTHEST = 1.02
"""Aperture radii from the middle that the search stays within: beside any aperture, but little."""
_TURNS = 16
_RINGS = (0.5, 0.7, 0.85, 1.0)
"""The outer ones close together: there spherical aberration turns rays over, and vignetting hides the rim."""
_LEAST_RATIO = 0.05
"""Of the smallest to the largest |det J| over the aperture, for the map to count as one to one.

Areas also count as no less than this share of the largest on the way: one ray with more than 20 times the
light of others would be a visible spike.
"""


class Aim(eqx.Module):
    """The ray from a film point to a place.

    Attributes:
        pupil: aperture point v [*n 2] in aperture radii; it may lie beside the aperture.
        ray: the ray through it, in output pixels.
        area: |det dq/dv| [*n] in square pixels, and at least `_LEAST_RATIO` of that at the points on the way.
        off: largest distance [*n] in pixels, along x or y, between the place and the ray.
    """

    pupil: Float[Array, "*n 2"]
    ray: LensRay
    area: Float[Array, "*n"]
    off: Float[Array, "*n"]


_State = tuple[Array, Array, Array, Array, Aim, Array]
"""Number of the step, the aperture point, the last one whose ray passes, the largest |det J| on the way, what
was found, and whether it moves."""


def aim_at(
    camera: Camera,
    lens: AbstractLens,
    film_point: Float[Array, "2"],
    place: Float[Array, "2"],
    disparity: Float[Array, ""],
) -> Aim:
    """The ray of `film_point` that passes `place`, in output pixels, at `disparity` in 1/m."""
    nothing = jnp.zeros_like(film_point)

    def unfinished(state: _State) -> Array:
        step, *_, moves = state
        return moves & (step <= _STEPS)

    def advance(state: _State) -> _State:
        """The next aperture point, what is found at this one, and whether they differ."""
        step, pupil, passing, most, *_ = state
        ray, slope = _ray_and_slope(camera, lens, film_point, pupil, disparity)
        off = place - ray.at(disparity)
        after = pupil + _solved(slope, off)
        area = jnp.abs(_determinant(slope))
        # Where a ray goes that glass stops says little: halfway back to one that passes.
        lit = ray.weight > 0
        after = jnp.where(lit, after, 0.5 * (pupil + passing))
        square = after[0] ** 2 + after[1] ** 2
        after = after * (_FARTHEST / jnp.sqrt(jnp.maximum(square, _FARTHEST**2)))
        most = jnp.maximum(most, jnp.where(lit, area, 0.0))
        found = Aim(pupil, ray, jnp.maximum(area, _LEAST_RATIO * most), largest_of_few(jnp.abs(off)))
        moves = largest_of_few(jnp.abs(after - pupil)) > _STAYS
        return step + 1, after, jnp.where(lit, pupil, passing), most, found, moves

    # In a loop, so that the lens is compiled once.
    zero = nothing[0]
    start = Aim(nothing, LensRay(nothing, nothing, zero), zero, zero)
    state = jnp.int32(0), nothing, nothing, zero, start, jnp.bool_(True)
    return jax.lax.while_loop(unfinished, advance, state)[4]


def one_to_one(
    camera: Camera, lens: AbstractLens, film_point: Float[Array, "2"], disparity: Float[Array, ""]
) -> Bool[Array, ""]:
    """Whether at `disparity` no two points of the aperture see the same place; a few of them are tested.

    Rays that carry no light do not count, and where none does nothing is seen twice. Of a lens with
    colours, that of the colour between is looked at.
    """
    turns = jnp.arange(_TURNS, dtype=film_point.dtype) / _TURNS
    rim = jax.vmap(lens.opening().rim)(turns)
    points = jnp.concatenate([jnp.zeros_like(rim[:1]), *(size * rim for size in _RINGS)])

    def at(pupil: Float[Array, "2"]) -> tuple[Array, Array]:
        ray, slope = _ray_and_slope(camera, lens, film_point, pupil, disparity)
        return _determinant(slope), ray.weight > 0

    area, lit = jax.vmap(at)(points)
    least, most = jnp.where(lit, area, jnp.inf).min(), jnp.where(lit, area, -jnp.inf).max()
    small, large = jnp.minimum(jnp.abs(least), jnp.abs(most)), jnp.maximum(jnp.abs(least), jnp.abs(most))
    return ~lit.any() | ((least * most > 0) & (small > _LEAST_RATIO * large))


def _ray_and_slope(
    camera: Camera,
    lens: AbstractLens,
    film_point: Float[Array, "2"],
    pupil: Float[Array, "2"],
    disparity: Float[Array, ""],
) -> tuple[LensRay, Float[Array, "2 2"]]:
    """The ray through an aperture point, and dq/dv at it."""

    def at(pupil: Float[Array, "2"]) -> tuple[Float[Array, "2"], LensRay]:
        ray = lens.ray(camera, film_point, pupil)
        return ray.at(disparity), ray

    slope, ray = jax.jacfwd(at, has_aux=True)(pupil)
    return ray, slope


def _determinant(slope: Float[Array, "2 2"]) -> Float[Array, ""]:
    return slope[0, 0] * slope[1, 1] - slope[0, 1] * slope[1, 0]


def _solved(slope: Float[Array, "2 2"], off: Float[Array, "2"]) -> Float[Array, "2"]:
    """slope^-1 off; 0 where there is no inverse."""
    determinant = _determinant(slope)
    safe = jnp.where(determinant == 0, 1.0, determinant)
    step = jnp.stack(
        [slope[1, 1] * off[0] - slope[0, 1] * off[1], slope[0, 0] * off[1] - slope[1, 0] * off[0]]
    )
    return jnp.where(determinant == 0, 0.0, step / safe)
