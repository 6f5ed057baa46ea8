"""Focus wishes that are hard to meet, in both precisions, against closed forms.

Blur is linear in the focal disparity w_f: a point at disparity w has the signed diameter k (w_f - w),
positive behind the focus, with k = 2 f E. Least squares over wishes c_i of weights m_i is solved by

    w_f = sum(m_i (w_i + c_i / k)) / sum(m_i),

and d w_f / d w_i = m_i / sum(m).
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from focusjax.focus import (
    AtInfinity,
    AtLeast,
    AtPoint,
    Blur,
    FocusPoint,
    Result,
    Sharp,
    Solution,
    locate,
    solve,
)
from focusjax.geometry import Camera, make_camera
from focusjax.hard_cases._check import Check
from focusjax.lens import AbstractLens, thin_lens

_FOCAL_LENGTH, _F_NUMBER = 0.05, 4.0
_NEAREST = 0.3
"""The nearest distance in metres that focus may have."""
_MANY = 1000
_CONTRADICTORY = ((2.0, 20.0, 1.0), (2.0, -10.0, 2.0), (2.0, 3.0, 0.5), (4.0, 0.0, 1.0))
_WEIGHED = ((1.0, 0.0, 1e6), (4.0, 0.0, 1.0), (3.0, 5.0, 0.0))


@dataclasses.dataclass(frozen=True)
class WishCase:
    """Wishes, what may be changed for them, and what must come of it.

    Attributes:
        name: what is hard about them.
        wishes: makes them.
        free: settings that may change.
        found: number that is looked at in a solution.
        expected: what it must be.
        unit: size that its errors are shares of.
        double: bound in float64.
        single: bound in float32.
        verdicts: results that are right.
    """

    name: str
    wishes: Callable[[], Sequence[FocusPoint]]
    free: tuple[str, ...]
    found: Callable[[Solution], jax.Array]
    expected: float
    unit: float = 1.0
    double: float = 1e-8
    single: float = 1e-4
    verdicts: tuple[Result, ...] = (Result.solved,)


def wish_checks(case: WishCase) -> Iterator[Check]:
    """All that is looked at in one case."""
    for name, double, bound in (("float64", True, case.double), ("float32", False, case.single)):
        with jax.enable_x64(double):
            solution = solved(case.wishes(), case.free)
            values = [leaf for leaf in jax.tree.leaves((solution.lens, solution.blur)) if leaf is not None]
            finite = all(np.isfinite(np.asarray(leaf)).all() for leaf in values)
            error = abs(float(case.found(solution)) - case.expected) / case.unit if finite else float("nan")
        yield Check("wishes", case.name, f"solution, {name}", "closed form", error, bound)
        wrong = float(not any(solution.result == each for each in case.verdicts))
        expected = "solved" if len(case.verdicts) == 1 else "solved or undetermined"
        yield Check("wishes", case.name, f"verdict, {name}", expected, wrong, 0.0)


def slope_checks() -> Iterator[Check]:
    """Derivatives of the focus by the depths of contradictory wishes, forward and reverse."""
    depths, blurs, weights = (np.array(column) for column in zip(*_CONTRADICTORY, strict=True))
    expected = weights / np.sum(weights)

    def focus(disparities: jax.Array) -> jax.Array:
        wishes = [
            _at(0.0, 0.0, 1.0 / disparities[k], Blur(blurs[k], signed=True), weight=weights[k])
            for k in range(len(blurs))
        ]
        return _focus(solved(wishes, ("focus",)))

    for name, double, bound in (("float64", True, 1e-8), ("float32", False, 1e-4)):
        with jax.enable_x64(double):
            at = jnp.asarray(1.0 / depths)
            for mode, by in (("forward", jax.jacfwd), ("reverse", jax.jacrev)):
                error = float(np.abs(np.asarray(by(focus)(at)) - expected).max())
                quantity = f"slope {mode}, {name}"
                yield Check("wishes", "contradictory wishes", quantity, "closed form", error, bound)


def camera() -> Camera:
    """640x480 pixels, 36 mm wide, 50 mm of focal length, at the origin."""
    return make_camera(jnp.eye(4), width=640, height=480, focal_length=_FOCAL_LENGTH)


def solved(wishes: Sequence[FocusPoint], free: Sequence[str]) -> Solution:
    """The wishes' solution, from a lens focused at 2 m."""
    seen_by = camera()
    lens = thin_lens(focus_distance=2.0, f_number=_F_NUMBER, focal_length=_FOCAL_LENGTH)
    return solve(locate(wishes, seen_by), seen_by, lens, free=free, min_focus_distance=_NEAREST)


def _at(x: float, y: float, depth: Any, wish: Any = None, **more: Any) -> FocusPoint:
    """A wish for the point at a depth in metres along the view axis that is seen at tangents (x, y)."""
    if isinstance(depth, float) and np.isinf(depth):
        where = AtInfinity((x, y, -1.0))
    else:
        where = AtPoint((x * depth, y * depth, -1.0 * depth))
    return FocusPoint(where, Sharp() if wish is None else wish, even_outside=True, even_hidden=True, **more)


def _focus(solution: Solution) -> jax.Array:
    return solution.lens.focus_disparity


def _blur_at(disparity: float) -> Callable[[Solution], jax.Array]:
    """The unsigned blur in pixels of a point on the axis."""

    def found(solution: Solution) -> jax.Array:
        lens: AbstractLens = solution.lens
        return jnp.abs(lens.blur(camera(), jnp.array([320.0, 240.0]), jnp.asarray(disparity)))

    return found


def _largest_error(solution: Solution) -> jax.Array:
    return jnp.abs(solution.error).max()


def _least_squares(wishes: Sequence[tuple[float, float, float]]) -> float:
    depths, blurs, weights = (np.array(column) for column in zip(*wishes, strict=True))
    focal_px = 640.0 * _FOCAL_LENGTH / 0.036
    diameter = 2.0 * focal_px * _FOCAL_LENGTH / (2.0 * _F_NUMBER)
    return float(np.sum(weights * (1.0 / depths + blurs / diameter)) / np.sum(weights))


def _signed(wishes: Sequence[tuple[float, float, float]]) -> list[FocusPoint]:
    return [_at(0.0, 0.0, depth, Blur(blur, signed=True), weight=weight) for depth, blur, weight in wishes]


def _spread(count: int) -> list[tuple[float, float, float]]:
    rng = np.random.default_rng(3)
    return [(float(depth), 0.0, 1.0) for depth in 1.0 / rng.uniform(0.1, 1.0, count)]


def _on_plane(tilt: float) -> list[FocusPoint]:
    """Sharp wishes on the plane that a lens turned forwards by `tilt` focuses on, with 0.5/m on the axis."""
    slope = np.sin(tilt) / _FOCAL_LENGTH
    places = ((-0.2, -0.1), (0.2, -0.1), (0.0, 0.01), (0.1, -0.05))
    return [_at(x, y, float(1.0 / (0.5 - slope * y))) for x, y in places]


_TILT = np.radians(44.9)
_SETTLED = (Result.solved, Result.undetermined)
_TILTING = ("focus", "tilt", "swing")

CASES = (
    WishCase("one wish at infinity", lambda: [_at(0, 0, np.inf)], ("focus",), _focus, 0.0),
    WishCase("a wish nearer than focus goes", lambda: [_at(0, 0, 0.2)], ("focus",), _focus, 1 / _NEAREST),
    WishCase("a point and infinity", lambda: [_at(0, 0, 1.0), _at(0.1, 0, np.inf)], ("focus",), _focus, 0.5),
    WishCase(
        "contradictory wishes",
        lambda: _signed(_CONTRADICTORY),
        ("focus",),
        _focus,
        _least_squares(_CONTRADICTORY),
    ),
    WishCase("weights of 0 to 1e6", lambda: _signed(_WEIGHED), ("focus",), _focus, _least_squares(_WEIGHED)),
    WishCase("one wish a thousand times", lambda: [_at(0, 0, 3.0)] * _MANY, ("focus",), _focus, 1 / 3),
    WishCase(
        "a thousand wishes",
        lambda: _signed(_spread(_MANY)),
        ("focus",),
        _focus,
        _least_squares(_spread(_MANY)),
    ),
    WishCase(
        "collinear wishes",
        lambda: [_at(0.02 * k, 0.01 * k, 1.0 / (0.5 + 0.05 * k)) for k in range(-5, 6)],
        _TILTING,
        _largest_error,
        0.0,
        verdicts=_SETTLED,
        double=1e-6,
        single=1e-2,
    ),
    WishCase(
        "tilt of 44.9 degrees",
        lambda: _on_plane(_TILT),
        _TILTING,
        _largest_error,
        0.0,
        verdicts=_SETTLED,
        double=1e-6,
        single=1e-2,
    ),
    WishCase(
        "a plane through the lens",
        lambda: [_at(x, 0.0, d) for x, d in ((-0.2, 1.0), (0.1, 2.0), (0.2, 0.7), (-0.1, 3.0))],
        ("focus", "tilt"),
        _focus,
        float(np.mean([1.0, 0.5, 1 / 0.7, 1 / 3.0])),
        verdicts=_SETTLED,
    ),
    WishCase(
        "a wish for 400 px",
        lambda: [_at(0, 0, 2.0), _at(0, 0, 0.1, Blur(400.0))],
        ("focus", "f_number"),
        _blur_at(10.0),
        400.0,
        400.0,
        double=1e-7,
        verdicts=_SETTLED,
    ),
    WishCase(
        "at least 30 px, at infinity only",
        lambda: [_at(0, 0, np.inf, AtLeast(30.0)), _at(0.1, 0.0, np.inf, AtLeast(10.0))],
        ("focus", "f_number"),
        lambda solution: jnp.maximum(30.0 - _blur_at(0.0)(solution), 0.0),
        0.0,
        verdicts=_SETTLED,
        double=1e-6,
        single=1e-3,
    ),
)
