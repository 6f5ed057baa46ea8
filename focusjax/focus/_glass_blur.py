"""Blur of a real lens at the places of wishes, by its rays.

The light of a point that is seen at x passes the stop at v and lands on the film at p(v), where the ray from
p through v meets the point: p is found by p <- p + x - q, as q, where the ray is in the picture at that
depth, moves almost one to one with p. About their mean, weighted by the light along them, the p have a mean
square distance M. The blur is

    D = sqrt(8 M),    which of an ideal lens with a round opening is the circle of confusion's diameter,

with the sign of its part L that is defocus: with b, the pixels that a ray moves per dioptre, the regression
p = c + k (b - mean b) has L = k sqrt(8 var b), positive behind the focus, and D^2 = L^2 + S^2, where S is the
spot of aberrations that no focus takes away.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.focus._objective import with_slopes
from focusjax.geometry import Camera
from focusjax.lens import PrescriptionLens, SettableLens, TiltedPrescriptionLens

_RAYS = 256
_STEPS = 4
_EIGHT = 8.0


class GlassBlur(eqx.Module):
    """Of n points, in pixels; any number of axes may come before, of settings.

    Attributes:
        defocus: L, signed.
        spot: S, at least 0.
        light: mean weight of the rays: 0 where the lens gives no light.
    """

    defocus: Float[Array, "*v n"]
    spot: Float[Array, "*v n"]
    light: Float[Array, "*v n"]

    @property
    def size(self) -> Float[Array, "*v n"]:
        """D, without its sign."""
        return jnp.sqrt(self.defocus**2 + self.spot**2)

    @property
    def signed(self) -> Float[Array, "*v n"]:
        """D with the sign of L."""
        return jnp.where(self.defocus >= 0.0, self.size, -self.size)


def glass_blur(
    lens: SettableLens,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    opening: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
) -> GlassBlur:
    """The blur of points seen at `xy` with the lens focused on 1/m and its stop at a share of its radius.

    Differentiable in everything but where rays are aimed.
    """
    square = jnp.asarray(square_points(), dtype=disparity.dtype)
    pupil = jax.vmap(lambda sample: lens.pupil_point(sample, opening))(square)
    channels = lens.set_to(camera, focus_disparity, opening)

    def one(seen: Array, w: Array) -> tuple[Array, Array, Array]:
        landed = [_landed(each, camera, pupil, seen, w) for each in channels]
        place, motion = (jnp.concatenate([each[number] for each in landed]) for number in (0, 1))
        light = jnp.concatenate([share * each[2] for share, each in zip(lens.shares, landed, strict=True)])
        total = jnp.sum(light)
        share = jnp.where(total > 0.0, light / jnp.where(total > 0.0, total, 1.0), 0.0)
        place = place - (share @ place)[None]
        motion = motion - (share @ motion)[None]
        spread = jnp.sum(share @ motion**2)
        safe = jnp.where(spread > 0.0, spread, 1.0)
        slope = jnp.where(spread > 0.0, jnp.sum(share @ (place * motion)) / safe, 0.0)
        rest = jnp.sum(share @ (place - slope * motion) ** 2)
        # The tiniest spot has a slope.
        rest = rest + jnp.finfo(rest.dtype).eps
        return slope * jnp.sqrt(_EIGHT * safe), jnp.sqrt(_EIGHT * rest), total / square.shape[0]

    return GlassBlur(*jax.vmap(one)(xy, disparity))


def _landed(
    lens: PrescriptionLens | TiltedPrescriptionLens,
    camera: Camera,
    pupil: Float[Array, "s 2"],
    seen: Array,
    w: Array,
) -> tuple[Array, Array, Array]:
    """Where rays of a point land on the film, pixels per dioptre that they move, and their light."""

    def one(v: Array) -> tuple[Array, Array, Array]:
        def step(_: Array, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            ray = lens.ray(camera, state[0], v)
            return state[0] + seen - (ray.a + ray.b * w), ray.b, ray.weight

        return jax.lax.fori_loop(0, _STEPS, step, (seen, jnp.zeros_like(seen), jnp.zeros_like(w)))

    return jax.vmap(one)(pupil)


class Sensed(eqx.Module):
    """Blur of n points at v settings of a lens, with its change with them; references of points among them.

    Attributes:
        blur: with leading axis v.
        slope: the same per 1/m of focus and per metre of aperture radius, on a last axis.
    """

    blur: GlassBlur
    slope: GlassBlur


def blank_sensed(settings: int, disparity: Float[Array, "n"]) -> Sensed:
    """Zeros, of the shapes that `sensed` returns."""
    flat = jnp.zeros((settings, disparity.size), disparity.dtype)
    deep = jnp.zeros((settings, disparity.size, 2), disparity.dtype)
    return Sensed(GlassBlur(flat, flat, flat), GlassBlur(deep, deep, deep))


def sensed(
    lens: SettableLens,
    camera: Camera,
    widest: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    settings: Float[Array, "v 2"],
) -> Sensed:
    """The blur of points at several settings, and its change with them.

    Settings are focus disparity in 1/m and aperture radius in metres, `widest` when the lens is open.
    """

    def blur(setting: Float[Array, "2"]) -> GlassBlur:
        return glass_blur(lens, camera, setting[0], setting[1] / widest, xy, disparity)

    return Sensed(*jax.vmap(lambda setting: with_slopes(blur, setting))(settings))


def numbers_of(
    camera: Camera,
    widest: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    setting: Float[Array, "2"],
) -> Float[Array, "n i"]:
    """All that the blur of points at one setting follows, a row for each, in the order of `changes`."""
    shared = jax.tree.leaves((setting, widest, _of_camera(camera)))
    return jax.vmap(lambda *own: jnp.concatenate([jnp.atleast_1d(leaf) for leaf in (*shared, *own)]))(
        xy, disparity
    )


def changes(
    lens: SettableLens,
    camera: Camera,
    widest: Float[Array, ""],
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    setting: Float[Array, "2"],
) -> Float[Array, "n o i"]:
    """Derivatives of the o numbers of each point's `Sensed` by those of `numbers_of`, forwards alone.

    Second derivatives of rays, compiled once and without a way back, serve whatever is asked of a solution.
    """

    def one(setting: Array, widest: Array, of_camera: tuple, seen: Array, w: Array) -> Array:
        placed = dataclasses.replace(
            camera, focal_length=of_camera[0], sensor_width=of_camera[1], principal_point=of_camera[2]
        )
        return row_of(sensed(lens, placed, widest, seen[None], w[None], setting[None]))[0, 0]

    def of_point(seen: Array, w: Array) -> Array:
        found = jax.jacfwd(one, argnums=(0, 1, 2, 3, 4))(setting, widest, _of_camera(camera), seen, w)
        return jnp.concatenate([jnp.atleast_2d(leaf.T).T for leaf in jax.tree.leaves(found)], axis=1)

    return jax.vmap(of_point)(xy, disparity)


def row_of(found: Sensed) -> Float[Array, "*v n o"]:
    """All numbers of each point."""
    single = [leaf[..., None] for leaf in jax.tree.leaves(found.blur)]
    return jnp.concatenate([*single, *jax.tree.leaves(found.slope)], axis=-1)


def of_row(row: Float[Array, "*v n 9"]) -> Sensed:
    """What `row_of` made the numbers of."""
    return Sensed(
        GlassBlur(*(row[..., number] for number in range(3))),
        GlassBlur(*(row[..., number : number + 2] for number in (3, 5, 7))),
    )


def _of_camera(camera: Camera) -> tuple[Array, Array, Array]:
    """What the blur follows of a camera: points are in its picture already."""
    return camera.focal_length, camera.sensor_width, camera.principal_point


def square_points() -> Float[np.ndarray, "s 2"]:
    """Where rays go through the opening, spread over a unit square."""
    # Imported for real lenses alone, as it takes long.
    from scipy.stats import qmc

    return qmc.Sobol(2, rng=np.random.default_rng(0)).random(_RAYS)
