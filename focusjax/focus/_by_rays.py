"""Focusing any lens by its rays: where the spots of what is to be sharp are smallest.

The blur of a lens with aberrations is no circle, and its best focus is a matter of what is asked. Here it is
the focus at which the rays of the points have the least mean square distance, in pixels, from the middles of
their spots: the least RMS spot, over all of the opening and all colours, each ray by the light along it.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from focusjax._arguments import ArgumentError
from focusjax._programs import jit
from focusjax._words import kind_of
from focusjax.focus._glass_blur import square_points
from focusjax.focus._glass_rows import wished_sharp
from focusjax.focus._image_points import ImagePoints, root_weight
from focusjax.focus._refuse import require_points
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens, moved_film, refocused

_ROUNDINGS = 1e3


class RayFocus(eqx.Module):
    """A lens focused by its rays.

    Attributes:
        lens: focused.
        focus_disparity: 1/m of the plane on the axis that it is focused on; below 0 beyond infinity.
        spots: RMS diameter in pixels of every point's spot [n], twice the root of the mean square distance
            from its middle; of a thin lens 1 / sqrt(2) of its circle of confusion.
        steps: that the solver took.
    """

    lens: AbstractLens
    focus_disparity: Float[Array, ""]
    spots: Float[Array, "n"]
    steps: Int[Array, ""]


def focus_by_rays(
    points: ImagePoints, camera: Camera, lens: AbstractLens, *, max_steps: int = 64
) -> RayFocus:
    """`lens` focused so that points wished sharp have the smallest spots, by weighted least squares.

    What other wishes say does not count. Unlike `solve`, which takes blur to be that of an ideal lens, this
    looks at rays, so that spherical aberration, a curved field, astigmatism and colour have their say. It is
    differentiable in the points and in all that the lens is, by the implicit function theorem.

    Args:
        points: located wishes, some for sharpness and with positive weight.
        camera: the pinhole that frames the picture.
        lens: any that has one focus to set (`focusjax.lens.refocused`).
        max_steps: steps allowed.

    Raises:
        ArgumentError: (a `ValueError`) nothing is wished sharp, or the lens is closed.
        ValueError: a lens that has no one focus to set.
        RuntimeError: the solver failed.

    Example:
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=64, height=48, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> points = locate([FocusPoint(AtPoint((0, 0, -2)), Sharp())], camera)
        >>> round(float(focus_by_rays(points, camera, start).lens.focus_distance()), 4)
        2.0
    """
    require_points(points, "focus_by_rays(points, camera, lens)", axes=1)
    if not isinstance(lens, AbstractLens):
        raise ArgumentError(
            f"lens of focus_by_rays(points, camera, lens) is {kind_of(lens)}; expected a lens", "lens"
        )
    if not isinstance(parallax := lens.parallax(camera), Tracer) and not float(parallax) > 0:
        raise ArgumentError("the lens is a pinhole, to which all is sharp; open it", "lens")
    weight = jnp.where(wished_sharp(points), points.weight, 0.0)
    if not isinstance(weight, Tracer) and not bool(jnp.any(weight > 0)):
        raise ArgumentError("nothing is wished sharp; rays are focused on what is", "points")
    focus, sizes, steps, failed = _search(points.xy, points.disparity, weight, camera, lens, max_steps)
    if isinstance(failed, Tracer):
        focus = eqx.error_if(focus, failed, "focusing by rays failed")
    elif bool(failed):
        raise RuntimeError(f"focusing by rays failed after {int(steps)} steps")
    return RayFocus(refocused(lens, camera, focus), focus, sizes, steps)


@jit
def spots(
    xy: Float[Array, "n 2"], disparity: Float[Array, "n"], camera: Camera, lens: AbstractLens
) -> Float[Array, "n"]:
    """RMS diameters in pixels of the spots of points: that of `RayFocus`."""
    off = _scatter(xy, disparity, camera, lens)
    square = jnp.sum(off**2, axis=(1, 2))
    return 2.0 * jnp.sqrt(square)


def _scatter(
    xy: Float[Array, "n 2"], disparity: Float[Array, "n"], camera: Camera, lens: AbstractLens
) -> Float[Array, "n s 2"]:
    """Distances of rays from the middles of their spots times the roots of their shares of the light."""
    seen = [(one.lens, sum(one.colour) / 3.0) for one in lens.channels()] or [(lens, 1.0)]
    square = jnp.asarray(square_points(), dtype=disparity.dtype)
    pupil = jax.vmap(lens.pupil_point)(square)

    def one(film: Array, w: Array) -> Array:
        rays = [jax.vmap(lambda v, each=each: each.ray(camera, film, v))(pupil) for each, _ in seen]
        places = jnp.concatenate([ray.a + ray.b * w for ray in rays])
        light = jnp.concatenate([share * ray.weight for ray, (_, share) in zip(rays, seen, strict=True)])
        total = jnp.sum(light)
        share = jnp.where(total > 0.0, light / jnp.where(total > 0.0, total, 1.0), 0.0)
        off = places - (share @ places)[None]
        return root_weight(share)[:, None] * off

    return jax.vmap(one)(xy, disparity)


@jit
def _search(
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    weight: Float[Array, "n"],
    camera: Camera,
    lens: AbstractLens,
    max_steps: int,
) -> tuple[Array, Array, Array, Array]:
    import optimistix as optx

    from focusjax.solvers import BoundedLevenbergMarquardt

    share = weight / jnp.sum(weight)
    roots = root_weight(share)
    dynamic, static = eqx.partition(lens, eqx.is_array)
    unit = jax.lax.stop_gradient(1.0 / lens.parallax(camera))

    def residuals(variable: Array, args: Any) -> Array:
        xy, disparity, roots, unit, camera, dynamic = args
        lens = moved_film(eqx.combine(dynamic, static), camera, variable * unit)
        return roots[:, None, None] * _scatter(xy, disparity, camera, lens)

    tolerance = _ROUNDINGS * float(jnp.finfo(disparity.dtype).eps)
    found = optx.least_squares(
        residuals,
        BoundedLevenbergMarquardt(rtol=tolerance, atol=tolerance),
        jax.lax.stop_gradient(share @ disparity) / unit,
        args=(xy, disparity, roots, unit, camera, dynamic),
        max_steps=max_steps,
        throw=False,
    )
    focus = found.value * unit
    sizes = spots(xy, disparity, camera, moved_film(lens, camera, focus))
    failed = found.result != optx.RESULTS.successful
    return focus, sizes, jnp.asarray(found.stats["num_steps"]), failed
