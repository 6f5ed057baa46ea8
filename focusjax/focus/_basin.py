"""A problem's box and basin, and what its solution is called in the end: for thin lenses and for glass."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from focusjax.focus._bounds import Box
from focusjax.focus._global import find_optimum
from focusjax.focus._image_points import ImagePoints
from focusjax.focus._objective import make_objective
from focusjax.focus._parameters import FOCUS, RADIUS, Start, blur_models, make_start, scales
from focusjax.focus._priors import PriorRows, prior_rows
from focusjax.focus._search import Basin, search
from focusjax.focus._solution import PARTLY_OPEN, Asked, Result, Solution, has_failed, result_of


def place_of(asked: Asked) -> tuple[Start, PriorRows, Box, Float[Array, "k"]]:
    """Where a problem starts, its expectations, bounds, and the free parameters at the start."""
    plan = asked.plan
    start = make_start(
        asked.camera, asked.lens, plan.free, keep_view=plan.keep_view, close_focus=plan.close_focus
    )
    priors = prior_rows(asked.numbers, plan.free, asked.camera)
    box = asked.box.columns(start.columns)
    first = jnp.clip(start.first(), box.lower, box.upper)
    return start, priors, box, first


def basin_of(asked: Asked) -> Basin:
    """Where the best solution is for an ideal lens, without derivatives."""
    asked = jax.lax.stop_gradient(asked)
    start, priors, box, first = place_of(asked)
    if asked.plan.exact:
        return _exact_basin(asked.points, start, asked.box)
    objective = make_objective(asked.points, start, priors)
    return search(objective, first, box, many=asked.plan.many, max_steps=asked.plan.max_steps)


def ended(
    points: ImagePoints,
    start: Start,
    basin: Basin,
    value: Float[Array, "k"],
    blur: Float[Array, "n"],
    error: Float[Array, "n"],
    priced: Float[Array, ""],
    steps: Int[Array, ""],
    result: Result,
) -> tuple[Solution, Bool[Array, ""]]:
    """The solution at `value`, and whether the solver failed; `priced` is what priors cost in px^2."""
    is_open = basin.held | (jnp.diag(basin.open) > PARTLY_OPEN)
    result = result_of(basin.settled, is_open, error, result)
    solution = Solution(
        lens=start.lens_at(value),
        camera=start.camera_at(value),
        points=points,
        blur=blur,
        error=error,
        cost=0.5 * (jnp.sum(points.weight * error**2) + priced),
        result=result,
        steps=basin.steps + steps,
        at_lower=basin.at_lower,
        at_upper=basin.at_upper,
        open=is_open,
        free=start.free,
    )
    return solution, has_failed(result)


def _exact_basin(points: ImagePoints, start: Start, whole_box: Box) -> Basin:
    """What `find_optimum` says of focus and aperture radius, for the parameters that are free."""
    count = len(start.free)
    box = whole_box.columns((FOCUS, RADIUS))
    parameters = start.parameters()
    focus, radius = parameters[FOCUS], parameters[RADIUS]
    if count == 1:
        box = box.at_radius(radius)
    own, _ = blur_models(points, start)
    if own.across is not None:
        # A tilted lens blurs a point as an upright one blurs it elsewhere in depth.
        points = dataclasses.replace(points, disparity=own.sharp_at(parameters))
    slope = own.gain
    if start.scale is not None:
        # Rows of different gains are rows of one gain with other targets and weights.
        slope, share = 2.0 * start.camera.focal_px, own.gain / (2.0 * start.camera.focal_px)
        points = dataclasses.replace(
            points,
            disparity=own.disparity,
            target=points.target / share,
            weight=points.weight * share**2,
        )
    first = jnp.stack([jnp.clip(focus, box.lower[0], box.upper[0]), radius])
    scale = scales(start)[FOCUS : RADIUS + 1]
    found = find_optimum(points, slope, first, scale, box, free_aperture=count == 2)
    return Basin(
        value=found.value[:count],
        side=found.side,
        on=jnp.ones_like(points.signed),
        at_lower=found.at_lower[:count],
        at_upper=found.at_upper[:count],
        held=found.held[:count],
        open=found.open[:count, :count],
        settled=jnp.array(True),
        steps=jnp.array(0),
    )
