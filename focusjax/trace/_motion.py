"""How the parameters of a lens move its rays, as a flow over film and opening.

A pixel is a mean over its square of film points p and the opening's points u,

    I = (integral over p and u of W L(r)) / A,        r(p, u) = (a, b) of the ray q(w) = a + b w,

with L the radiance along a ray and W the light that it stands for, its weight times the opening's density. At
silhouettes L jumps, so the mean of its derivatives is not the derivative of the mean.
But rays are a family of four dimensions with four coordinates: wherever a parameter t moves r, some other
film point and opening point had that ray before. With J the Jacobian of r by (p, u),

    v = J^-1 dr/dt        gives        dL/dt = v . grad L,

and integration by parts takes every derivative off L:

    A dI/dt = sum over the pixel's borders of W L v_p.n  +  sum over the opening's rim of W L v_u.n
              + integral of L (dW/dt - div (W v)).

Of a constant radiance the sum is the mean of dW/dt, so a constant c may be taken off L and c dW/dt added.
Nothing is left that a silhouette, a texture or a highlight could break: what remains are means of
radiances as they are. For a thin lens q(w) = p + f E u (w - w_f) the focal disparity moves the
film, v = (-f E u, 0), so the picture changes by what enters and leaves its pixels; the aperture radius
widens the opening, v = (0, u / E), and dI/dE = 2 / E (mean over the rim - mean over the opening).

The divergence of v is how fast the density of rays changes along the flow, which takes derivatives in one
direction instead of four:

    div v = (d/dt - v . grad) log |det J|.

Opening points are given by their place (s, t) in the unit square, which is uniform by area: u = sqrt(s) c(t)
with c the rim, where there is no hole. A parameter that changes the shape of the opening moves u where (s, t)
stays. A hole has a rim, too, at s = 0.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.lens import AbstractLens

LEAST_PLACE = 1e-6
"""Smallest s of a place that the flow is asked for: at the centre of the opening the map has no inverse."""


def film_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, "2"]:
    """W v_p [2] for the difference between two lenses, to first order in it."""
    return light(lens, camera, film, lens.opening().at(place)) * _flow(lens, moved, camera, film, place)[0]


def rim_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], turn: Float[Array, ""]
) -> Float[Array, ""]:
    """W v_u.n / A along the outline, per unit of its parameter `turn`, to first order in the difference.

    With c(t) the outline, its outward element is n dl = (c'_y, -c'_x) dt and A = (c x c') / 2, less the
    hole's.
    """
    return _edge_flow(lens, moved, camera, film, jnp.stack([jnp.ones_like(turn), turn]))


def hole_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], turn: Float[Array, ""]
) -> Float[Array, ""]:
    """As `rim_flow`, along the edge of the hole, towards its middle."""
    return -_edge_flow(lens, moved, camera, film, jnp.stack([jnp.zeros_like(turn), turn]))


def gain(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """dW/dt, the difference between two lenses in the light that a ray stands for."""
    after, before = (light(one, camera, film, one.opening().at(place)) for one in (moved, lens))
    return after - before


def divergence(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """Div (W v), to first order in the difference between two lenses."""
    upstream = _upstream(lens, moved, camera, film, place)
    before = light(lens, camera, film, lens.opening().at(place))
    along = gain(lens, moved, camera, film, place) - (light(moved, camera, *upstream) - before)
    return along + before * spreading(lens, moved, camera, film, place)


def spreading(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """Div v, to first order in the difference between two lenses: how fast rays move apart."""
    before = _density(lens, camera, film, lens.opening().at(place))
    after = _density(moved, camera, *_upstream(lens, moved, camera, film, place))
    # A pinhole has no density, and moves no ray within its opening.
    dense = before > 0
    ratio = jnp.where(dense, after / jnp.where(dense, before, 1.0), 1.0)
    return ratio * _area(moved, place[1]) / _area(lens, place[1]) - 1.0


def _edge_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    outline, along = jax.jvp(lens.opening().rim, (place[1],), (jnp.ones_like(place[1]),))
    hole = lens.opening().hole()
    open_ = 1.0 if hole is None else 1.0 - hole**2
    size = place[0] if hole is None else jnp.where(place[0] > 0.5, 1.0, hole)
    across = _flow(lens, moved, camera, film, place)[1]
    carried = light(lens, camera, film, lens.opening().at(place))
    return 2.0 * size * carried * _cross(across, along) / (open_ * _cross(outline, along))


def _flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """v_p and v_u, by eliminating v_u from J v = dr.

    A pinhole has rays of one b only. Their v_u is then 0: what the opening gains on one side as it opens, it
    gains on the other, too.
    """
    point = lens.opening().at(place)
    still = lens.ray(camera, film, point)
    other = moved.ray(camera, film, moved.opening().at(place))
    (a_film, a_point), (b_film, b_point) = _jacobian(lens, camera, film, point)
    back = _inverse(b_point)
    by_b = a_point @ back
    v_film = _inverse(a_film - by_b @ b_film) @ (other.a - still.a - by_b @ (other.b - still.b))
    return v_film, back @ (other.b - still.b - b_film @ v_film)


def _upstream(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """Film point and opening point from where the flow comes, as the place of the opening moves."""
    v_film, v_point = _flow(lens, moved, camera, film, place)
    return film - v_film, moved.opening().at(place) - v_point


def light(
    lens: AbstractLens, camera: Camera, film: Float[Array, "2"], point: Float[Array, "2"]
) -> Float[Array, ""]:
    """W of the ray through a point of the opening."""
    return lens.ray(camera, film, point).weight * lens.opening().density(point)


def _density(
    lens: AbstractLens, camera: Camera, film: Float[Array, "2"], point: Float[Array, "2"]
) -> Float[Array, ""]:
    """|det J|."""
    (a_film, a_point), (b_film, b_point) = _jacobian(lens, camera, film, point)
    eliminated = a_film - a_point @ _inverse(b_point) @ b_film
    return jnp.abs(_cross(*eliminated) * _cross(*b_point))


def _area(lens: AbstractLens, turn: Float[Array, ""]) -> Float[Array, ""]:
    """Twice the opening's, which is alike for all turns."""
    outline, along = jax.jvp(lens.opening().rim, (turn,), (jnp.ones_like(turn),))
    hole = lens.opening().hole()
    return _cross(outline, along) * (1.0 if hole is None else 1.0 - hole**2)


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
