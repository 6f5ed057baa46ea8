"""The plane in focus that fits any number of points best: weighted linear least squares.

A film point that looks along d = (x, y, 1) is sharp at the disparity d.n, so point i, at disparity w_i, is
blurred by 2 f E (d_i.n - w_i) pixels: linear in the plane n. The fit minimises

    sum over i of weight_i (2 f E (d_i.n - w_i) - blur_i)^2      with  F |(n_x, n_y)| <= sin(max_tilt),
                                                                       n_z <= 1 / min_focus_distance,

which is convex: without its bounds it is one QR factorisation, on the tilt limit a trust-region problem in
two unknowns, and on the focus limit the same with n_z given.

Points on a line in the picture leave a turn of the plane open, and a single one leaves two. Then, of all
planes that are equally good, the fit is the one nearest to the plane it starts from, in the root mean square
of the change of focal disparity over the frame.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._programs import jit
from focusjax.focus._bounds import LIFE_SIZE
from focusjax.focus._checks import require, require_number
from focusjax.focus._disk import least_in_disk
from focusjax.focus._image_points import filled_up, repeated, room_for, root_weight
from focusjax.focus._refuse import opened, require_lens
from focusjax.focus._solution import first_rows
from focusjax.geometry import Camera
from focusjax.lens import MAX_TILT, ThinLens, TiltShiftLens, as_tilt_shift, view_tangents

OPEN_BELOW = 3e-5
"""Spread of the points, against that of the frame, below which they count as on a line, or as one."""

_OPEN_STIFFNESS = {4: 1e-5, 8: 1e-7}
"""How much less an open turn resists than the best determined one, once the tilt limit is met."""


class PlaneFit(eqx.Module):
    """A fitted plane and what stood in its way. A pytree; plane and residuals carry gradients.

    Attributes:
        lens: focused on the plane; the opening is that of the lens given.
        residual: blur minus wanted blur of every point in pixels, signed, without weights.
        cost: half the sum of weight x residual^2, in px^2.
        open_turns: how many turns of the plane the points leave open, 0 to 2 (3 without any point that
            counts); those are as near as can be to the plane given.
        tilt_limited: whether the tilt limit keeps the plane from a better place.
        focus_limited: whether the closest focus distance does.
    """

    lens: TiltShiftLens
    residual: Float[Array, "n"]
    cost: Float[Array, ""]
    open_turns: Float[Array, ""]
    tilt_limited: Bool[Array, ""]
    focus_limited: Bool[Array, ""]

    @property
    def plane(self) -> Float[Array, "3"]:
        """The plane n [3] in 1/m, in camera axes (X right, Y up, Z forward)."""
        return self.lens.plane

    @property
    def undetermined(self) -> str:
        """What the points leave open, in words; empty when they determine the plane."""
        return (
            "",
            "tilt about the line through the points is undetermined",
            "tilt and swing are undetermined: all points are seen at one place",
            "the plane is undetermined: no point has weight",
        )[round(float(self.open_turns))]

    @property
    def active_bounds(self) -> tuple[str, ...]:
        """Bounds that keep the plane from a better place: "max_tilt", "min_focus_distance"."""
        flags = {"max_tilt": self.tilt_limited, "min_focus_distance": self.focus_limited}
        return tuple(name for name, active in flags.items() if active)


def fit_focal_plane(
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    *,
    weight: Float[Array, "n"] | None = None,
    blur: Float[Array, "n"] | None = None,
    max_tilt: ArrayLike = MAX_TILT,
    min_focus_distance: ArrayLike | None = None,
) -> PlaneFit:
    """Tilt and focus the lens so that its plane passes the points as well as can be.

    Three points that are not on a line in the picture are met exactly, unless a bound forbids it. The result
    is differentiable in the points, the weights, the blur, the bounds, the camera and the lens.

    Args:
        xy: image positions in pixels, as `camera.project` gives them.
        disparity: 1 / depth along the view axis in 1/m; 0 at infinity.
        camera: whose focal length is the lens's, and whose frame measures change.
        lens: its opening, and the plane that what the points leave open stays near to.
        weight: factors of the squared errors; 1 each when not given. 0 reports a point only.
        blur: wanted signed blur diameters in pixels, positive behind the focus; 0 each when not given.
        max_tilt: radians; how far the lens's axis may turn from the sensor's normal.
        min_focus_distance: metres along the view axis; twice the focal length when not given.

    Raises:
        ValueError: no points, a pinhole (which is sharp everywhere), or an argument out of range.

    Example:
        >>> from focusjax import look_at, thin_lens
        >>> camera = look_at((0, 1.5, 0), (0, 1.5, -1), width=60, height=40, focal_length=0.09)
        >>> floor = jnp.array([(-1.0, 0.0, -4.0), (1.0, 0.0, -4.0), (0.0, 0.0, -30.0)])
        >>> start = thin_lens(focus_distance=4, focal_length=0.09, f_number=4)
        >>> fit = fit_focal_plane(*jax.vmap(camera.project)(floor), camera, start)
        >>> round(float(fit.lens.movements(camera).tilt), 4)
        0.06
        >>> fit.undetermined, fit.active_bounds
        ('', ())
    """
    require_lens(camera, lens, "fit_focal_plane(xy, disparity, camera, lens)")
    count = disparity.shape[0]
    if count == 0:
        raise ValueError("there are no points to fit a plane to; give at least one")
    xy, disparity, weight, blur = _checked_points(xy, disparity, weight, blur)
    limits = _checked_limits(camera, max_tilt, min_focus_distance, disparity.dtype)
    room = room_for(count)
    points = repeated(xy, room), repeated(disparity, room), filled_up(weight, room), repeated(blur, room)
    found = _fit(*points, camera, opened(as_tilt_shift(lens)), *limits)
    return eqx.tree_at(lambda fit: fit.residual, found, first_rows(found.residual, count))


def _checked_points(
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    weight: Float[Array, "n"] | None,
    blur: Float[Array, "n"] | None,
) -> tuple[Float[Array, "n 2"], Float[Array, "n"], Float[Array, "n"], Float[Array, "n"]]:
    """Positions, disparities, weights and wanted blurs in range, with what is not given filled in."""

    def finite(v: Any) -> Any:
        return abs(v) < np.inf

    def not_negative(v: Any) -> Any:
        return (v >= 0) & (v < np.inf)

    weight = jnp.ones_like(disparity) if weight is None else weight
    blur = jnp.zeros_like(disparity) if blur is None else blur
    return (
        require(xy, finite, "a point's image position", "finite pixels", "xy"),
        require(disparity, not_negative, "a point's disparity", "0 (infinity) or more dioptres", "disparity"),
        require(weight, not_negative, "a point's weight", "zero or a positive number", "weight"),
        require(blur, finite, "a wanted blur", "a finite number of pixels", "blur"),
    )


def _checked_limits(
    camera: Camera, max_tilt: ArrayLike, min_focus_distance: ArrayLike | None, dtype: np.dtype
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The tilt limit in radians and the closest focus distance in metres, in range."""
    if min_focus_distance is None:
        min_focus_distance = LIFE_SIZE * camera.focal_length
    turn = require_number(
        max_tilt,
        lambda v: (v >= 0) & (v < np.pi / 2),
        "the tilt limit in radians",
        "0 up to less than pi/2",
        "max_tilt",
    )
    near = require_number(
        min_focus_distance,
        lambda v: (v * jnp.cos(jnp.asarray(max_tilt)) > camera.focal_length) & (v < np.inf),
        "minimum focus distance in metres",
        "a finite distance beyond the focal length over the cosine of the tilt limit; raise it",
        "min_focus_distance",
    )
    return turn.astype(dtype), near.astype(dtype)


@jit
def _fit(
    xy: Float[Array, "n 2"],
    disparity: Float[Array, "n"],
    weight: Float[Array, "n"],
    blur: Float[Array, "n"],
    camera: Camera,
    lens: TiltShiftLens,
    max_tilt: Float[Array, ""],
    nearest: Float[Array, ""],
) -> PlaneFit:
    """The compiled part."""
    span = 2.0 * camera.focal_px * lens.aperture_radius
    tangents = jax.vmap(lambda p: view_tangents(camera, p))(xy)
    view = jnp.concatenate([tangents, jnp.ones_like(disparity)[:, None]], axis=1)
    target = disparity + blur / span
    scale = _frame_scale(camera)
    miss = target - view @ lens.plane
    change, open_ = _nearest_solution(view @ scale, miss, weight)
    best = lens.plane + scale @ change
    inside, tilted, close = _within(best, view, scale, open_, weight, camera.focal_length, max_tilt, nearest)
    fitted = eqx.tree_at(lambda lens: lens.plane, lens, inside)
    residual = span * (view @ inside - target)
    return PlaneFit(
        lens=fitted,
        residual=residual,
        cost=0.5 * jnp.sum(weight * residual**2),
        open_turns=jnp.sum(jnp.abs(open_) ** 2),
        tilt_limited=tilted,
        focus_limited=close,
    )


def _frame_scale(camera: Camera) -> Float[Array, "3 3"]:
    """Changes of the plane [3], each of 1 dioptre root mean square over the frame, as columns.

    Slopes across the frame about its middle, and the whole; they are uncorrelated over the frame.
    """
    size = jnp.array([camera.width, camera.height], dtype=camera.principal_point.dtype)
    middle = view_tangents(camera, size / 2)
    slope = camera.focal_px * math.sqrt(12.0) / size
    zero = jnp.zeros_like(slope[0])
    across = jnp.stack([slope[0], zero, -slope[0] * middle[0]])
    up = jnp.stack([zero, slope[1], -slope[1] * middle[1]])
    return jnp.stack([across, up, jnp.stack([zero, zero, zero + 1.0])], axis=1)


def _nearest_solution(
    rows: Float[Array, "n 3"], miss: Float[Array, "n"], weight: Float[Array, "n"]
) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Least squares of `rows` @ m = `miss`, of least norm where several are as good; and what is open.

    The open directions are rows [3, 3], 0 where a direction is determined. They are found without weights,
    so that a point of little weight still determines what others do not. Each is kept at right angles to
    the solution by an equation of its own. Their derivative turns them as the points move:
    d v = -pinv(rows) d(rows) v.
    """
    counts = weight > 0
    counted = jnp.where(counts[:, None], rows, 0.0)
    padded = jnp.concatenate([counted, jnp.zeros((3, 3), dtype=rows.dtype)])
    _, spread, directions = jnp.linalg.svd(jax.lax.stop_gradient(padded), full_matrices=False)
    # The rows of a frame's points are about 1 long.
    closed = spread > OPEN_BELOW * jnp.maximum(spread[0], 1e-30)
    shrunk = jnp.where(closed[:, None], directions / jnp.where(closed, spread, 1.0)[:, None], 0.0)
    inverse = shrunk.T @ shrunk
    open_ = jnp.where(closed[:, None], 0.0, directions)
    still = jax.lax.stop_gradient(counted)
    turned = open_ - ((counted - still) @ open_.T).T @ still @ inverse
    share = weight / jnp.max(jnp.where(counts, weight, 1e-30))
    root = root_weight(share)
    # Heavy rows first: Householder's QR is then accurate for each row by itself.
    order = jnp.argsort(-jax.lax.stop_gradient(root))
    weighted = (root[:, None] * (counted - (counted @ open_.T) @ open_))[order]
    matrix = jnp.concatenate([weighted, turned])
    q, r = jnp.linalg.qr(matrix)
    right = jnp.concatenate([(root * jnp.where(counts, miss, 0.0))[order], jnp.zeros(3, dtype=miss.dtype)])
    return jax.scipy.linalg.solve_triangular(r, q.T @ right), turned


def _within(
    best: Float[Array, "3"],
    view: Float[Array, "n 3"],
    scale: Float[Array, "3 3"],
    open_: Float[Array, "3 3"],
    weight: Float[Array, "n"],
    focal_length: Float[Array, ""],
    max_tilt: Float[Array, ""],
    nearest: Float[Array, ""],
) -> tuple[Float[Array, "3"], Bool[Array, ""], Bool[Array, ""]]:
    """The best plane inside the bounds, and whether tilt and focus are on theirs.

    Around the best plane the cost is (n - best)' K (n - best). Open directions, along which it is flat, are
    given a little of the stiffness of the others, so that of all equally good planes inside the bounds the
    nearest to the given one is found.
    """
    share = weight / jnp.maximum(jnp.max(weight), 1e-30)
    unscale = jnp.linalg.inv(scale)
    closed = jnp.eye(3, dtype=best.dtype) - open_.T @ open_
    rows = view @ scale
    inner = closed @ (rows.T @ (share[:, None] * rows)) @ closed
    stiffness = _OPEN_STIFFNESS[best.dtype.itemsize] * jnp.maximum(jnp.trace(inner), 1e-30)
    k = unscale.T @ (inner + stiffness * open_.T @ open_) @ unscale
    reach = jnp.sin(max_tilt) / focal_length
    most = 1.0 / nearest

    across, limited = least_in_disk(k[:2, :2] - jnp.outer(k[:2, 2], k[2, :2]) / k[2, 2], best[:2], reach)
    ahead = best[2] - k[2, :2] @ (across - best[:2]) / k[2, 2]
    # Convex: if the best plane within the tilt limit is too close, the best of all is just close enough.
    close = ahead > most
    sliding = best[:2] - jnp.linalg.solve(k[:2, :2], k[:2, 2] * (most - best[2]))
    across_close, limited_close = least_in_disk(k[:2, :2], sliding, reach)
    plane = jnp.where(
        close, jnp.append(across_close, most), jnp.where(limited, jnp.append(across, ahead), best)
    )
    return plane, jnp.where(close, limited_close, limited), close
