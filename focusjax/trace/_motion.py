"""How the parameters of a lens move its rays, told as a flow over film and opening.

A pixel is a mean over its square of film points p and the opening's points u,

    I = (integral over p and u of W L(r)) / A,        r(p, u) = (a, b) of the ray q(w) = a + b w,

with L the radiance along a ray. At silhouettes L jumps, so the mean of the derivatives of what rays bring
back is not the derivative of the mean. But rays are a family of four dimensions with four coordinates:
wherever a parameter t moves r, some other film point and opening point had that ray before. With J the
Jacobian of r by (p, u),

    v = J^-1 dr/dt        gives        dL/dt = v . grad L,

and integration by parts takes every derivative off L:

    A dI/dt = sum over the pixel's borders of W L v_p.n  +  sum over the opening's rim of W L v_u.n
              + integral of L (dW/dt - div (W v)).

Of a constant radiance the sum is the mean of dW/dt, so a constant c may be taken off L and c dW/dt added.
Nothing is left that a silhouette, a texture or a highlight could break: what remains are means of
radiances as they are. For a thin lens q(w) = p + f E u (w - w_f) the focal disparity moves the
film, v = (-f E u, 0), so the picture changes by what enters and leaves its pixels; the aperture radius
widens the opening, v = (0, u / E), and dI/dE = 2 / E (mean over the rim - mean over the opening).

The divergence is how fast the density of rays changes along the flow, which takes derivatives in one
direction instead of four:

    div v = (d/dt - v . grad) log |det J|.

Opening points are given by their place (s, t) in the unit square, u = sqrt(s) c(t) with c the rim, which is
uniform by area. A parameter that changes the shape of the opening moves u where (s, t) stays.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

LEAST_PLACE = 1e-6
"""Smallest s of a place that the flow is asked for: at the centre of the opening the map has no inverse."""


def opening_point(lens: AbstractLens, place: Float[Array, "2"]) -> Float[Array, "2"]:
    """The opening's point at a place (s, t) of the unit square, uniform by area; the rim is s = 1."""
    return jnp.sqrt(place[0]) * lens.rim_point(place[1])


def film_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, "2"]:
    """W v_p [2] for the difference between two lenses, to first order in it."""
    v_film, _, weight = _flow(lens, moved, camera, film, place)
    return weight * v_film


def rim_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], turn: Float[Array, ""]
) -> Float[Array, ""]:
    """W v_u.n / A along the rim, per unit of its parameter `turn`, to first order in the difference.

    With u = sqrt(s) c(t), the rim's outward element is n dl = (c'_y, -c'_x) dt and A = (c x c') / 2.
    """
    rim, along = jax.jvp(lens.rim_point, (turn,), (jnp.ones_like(turn),))
    _, v_point, weight = _flow(lens, moved, camera, film, jnp.stack([jnp.ones_like(turn), turn]))
    return 2.0 * weight * _cross(v_point, along) / _cross(rim, along)


def gain(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """dW/dt, the difference between two lenses in the share of light along a ray."""
    after, before = (one.ray(camera, film, opening_point(one, place)).weight for one in (moved, lens))
    return after - before


def divergence(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """Div (W v), to first order in the difference between two lenses."""
    v_film, v_point, weight = _flow(lens, moved, camera, film, place)
    point = opening_point(lens, place)
    before = lens.ray(camera, film, point).weight, _density(lens, camera, film, point)
    upstream = film - v_film, opening_point(moved, place) - v_point
    after = moved.ray(camera, *upstream).weight, _density(moved, camera, *upstream)
    # A pinhole has no density, and moves no ray within its opening.
    dense = before[1] > 0
    ratio = jnp.where(dense, after[1] / jnp.where(dense, before[1], 1.0), 1.0)
    spread = ratio * _area(moved, place[1]) / _area(lens, place[1]) - 1.0
    return gain(lens, moved, camera, film, place) - (after[0] - before[0]) + weight * spread


def _flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, "2"], Float[Array, ""]]:
    """v_p, v_u and W, by eliminating v_u from J v = dr.

    A pinhole has rays of one b only. Their v_u is then 0: what the opening gains on one side as it opens, it
    gains on the other, too.
    """
    point = opening_point(lens, place)
    still = lens.ray(camera, film, point)
    other = moved.ray(camera, film, opening_point(moved, place))
    (a_film, a_point), (b_film, b_point) = _jacobian(lens, camera, film, point)
    back = _inverse(b_point)
    by_b = a_point @ back
    v_film = _inverse(a_film - by_b @ b_film) @ (other.a - still.a - by_b @ (other.b - still.b))
    v_point = back @ (other.b - still.b - b_film @ v_film)
    return v_film, v_point, still.weight


def _density(
    lens: AbstractLens, camera: Camera, film: Float[Array, "2"], point: Float[Array, "2"]
) -> Float[Array, ""]:
    """|det J|."""
    (a_film, a_point), (b_film, b_point) = _jacobian(lens, camera, film, point)
    eliminated = a_film - a_point @ _inverse(b_point) @ b_film
    return jnp.abs(_cross(*eliminated) * _cross(*b_point))


def _area(lens: AbstractLens, turn: Float[Array, ""]) -> Float[Array, ""]:
    """Twice the opening's, which is alike for all turns."""
    rim, along = jax.jvp(lens.rim_point, (turn,), (jnp.ones_like(turn),))
    return _cross(rim, along)


def _jacobian(
    lens: AbstractLens, camera: Camera, film: Float[Array, "2"], point: Float[Array, "2"]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Of a and of b, by film point and by opening point, each [2, 2]."""

    def ray(film: Float[Array, "2"], point: Float[Array, "2"]) -> tuple[Array, Array]:
        ray = lens.ray(camera, film, point)
        return ray.a, ray.b

    return jax.jacfwd(ray, argnums=(0, 1))(film, point)


def _inverse(matrix: Float[Array, "2 2"]) -> Float[Array, "2 2"]:
    """The inverse, or 0 if there is none."""
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    regular = determinant != 0
    scale = jnp.where(regular, 1.0 / jnp.where(regular, determinant, 1.0), 0.0)
    return scale * jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])])


def _cross(one: Float[Array, "2"], other: Float[Array, "2"]) -> Float[Array, ""]:
    return one[0] * other[1] - one[1] * other[0]
