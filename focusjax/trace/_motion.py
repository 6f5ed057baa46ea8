"""How the parameters of a lens move its rays, told as a flow over film and opening.

A pixel is a mean over its square of film points p and the opening's points u,

    I = (integral over p and u of W L(r)) / A,        r(p, u) = (a, b) of the ray q(w) = a + b w,

with L the radiance along a ray and W the light that it stands for, its weight times the opening's density. At
silhouettes L jumps, so the mean of the derivatives of what rays bring back is not the derivative of the mean.
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

Opening points are given by their place (s, t) in the unit square, which is uniform by area: u = sqrt(s) c(t)
with c the rim, where there is no hole. A parameter that changes the shape of the opening moves u where (s, t)
stays. A hole has a rim, too, at s = 0.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens

LEAST_PLACE = 1e-6
"""Smallest s of a place that the flow is asked for: at the centre of the opening the map has no inverse."""


def film_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, "2"]:
    """W v_p [2] for the difference between two lenses, to first order in it."""
    return _weighted(lens, moved, camera, film, place)[0]


def rim_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], turn: Float[Array, ""]
) -> Float[Array, ""]:
    """W v_u.n / A along the outline, per unit of its parameter `turn`, to first order in the difference.

    With c(t) the outline, its outward element is n dl = (c'_y, -c'_x) dt and A = (c x c') / 2, less the
    hole's.
    """
    return _flow_over(lens, moved, camera, film, jnp.stack([jnp.ones_like(turn), turn]))


def hole_flow(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], turn: Float[Array, ""]
) -> Float[Array, ""]:
    """As `rim_flow`, along the edge of the hole, towards its middle."""
    return -_flow_over(lens, moved, camera, film, jnp.stack([jnp.zeros_like(turn), turn]))


def _flow_over(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    outline, along = jax.jvp(lens.opening().rim, (place[1],), (jnp.ones_like(place[1]),))
    hole = lens.opening().hole()
    open_ = 1.0 if hole is None else 1.0 - hole**2
    size = place[0] if hole is None else jnp.where(place[0] > 0.5, 1.0, hole)
    _, across = _weighted(lens, moved, camera, film, place)
    return 2.0 * size * _cross(across, along) / (open_ * _cross(outline, along))


def gain(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """dW/dt, the difference between two lenses in the light that a ray stands for."""
    after, before = (
        _light(one, one.ray(camera, film, one.opening().at(place)), place) for one in (moved, lens)
    )
    return after - before


def divergence(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> Float[Array, ""]:
    """Div (W v), to first order in the difference between two lenses."""

    def flow(film: Float[Array, "2"], place: Float[Array, "2"]) -> tuple[Array, Array]:
        return _weighted(lens, moved, camera, film, place)

    (by_film, _), (_, by_place) = jax.jacfwd(flow, argnums=(0, 1))(film, place)
    places = jax.jacfwd(lens.opening().at)(place)
    return jnp.trace(by_film) + jnp.trace(by_place @ _inverse(places))


def _weighted(
    lens: AbstractLens, moved: AbstractLens, camera: Camera, film: Float[Array, "2"], place: Float[Array, "2"]
) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """W v_p and W v_u, by eliminating v_u from J v = dr.

    A pinhole has rays of one b only. Their v_u is then 0: what the opening gains on one side as it opens, it
    gains on the other, too.
    """
    point = lens.opening().at(place)

    def ray(film: Float[Array, "2"], point: Float[Array, "2"]) -> tuple[Array, Array]:
        ray = lens.ray(camera, film, point)
        return ray.a, ray.b

    still = lens.ray(camera, film, point)
    other = moved.ray(camera, film, moved.opening().at(place))
    (a_film, a_point), (b_film, b_point) = jax.jacfwd(ray, argnums=(0, 1))(film, point)
    back = _inverse(b_point)
    by_b = a_point @ back
    v_film = _inverse(a_film - by_b @ b_film) @ (other.a - still.a - by_b @ (other.b - still.b))
    v_point = back @ (other.b - still.b - b_film @ v_film)
    light = _light(lens, still, place)
    return light * v_film, light * v_point


def _light(lens: AbstractLens, ray: LensRay, place: Float[Array, "2"]) -> Float[Array, ""]:
    """W of a ray through a place of the opening."""
    return ray.weight * lens.opening().density(lens.opening().at(place))


def _inverse(matrix: Float[Array, "2 2"]) -> Float[Array, "2 2"]:
    """The inverse, or 0 if there is none."""
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    regular = determinant != 0
    scale = jnp.where(regular, 1.0 / jnp.where(regular, determinant, 1.0), 0.0)
    return scale * jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])])


def _cross(one: Float[Array, "2"], other: Float[Array, "2"]) -> Float[Array, ""]:
    return one[0] * other[1] - one[1] * other[0]
