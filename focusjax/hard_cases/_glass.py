"""Rays through glass near and beyond total reflection, against Snell's law.

Parallel to the axis, a ray meets the round back of a plano-convex lens of index n and radius R at height h
under sin i = h / R, and leaves by sin r = n h / R, turned by r - i towards the axis. Beyond h = R / n nothing
leaves.
"""

import math
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from focusjax._programs import jit
from focusjax.hard_cases._check import Check
from focusjax.optics import BLOCKED, Prescription, RealRay, index_glass, make_prescription, sphere, trace

_INDEX, _RADIUS = 1.5, 10.0
HEIGHTS = {
    "on the axis": 0.0,
    "grazing out of glass": _RADIUS / _INDEX * (1.0 - 1e-6),
    "total reflection": _RADIUS / _INDEX * (1.0 + 1e-6),
    "at the edge of the glass": _RADIUS,
    "past the glass": 1.5 * _RADIUS,
}
"""Millimetres from the axis at which rays come."""


def glass_checks(name: str) -> Iterator[Check]:
    """All that is looked at along one ray."""
    height = HEIGHTS[name]
    passes = height < _RADIUS / _INDEX
    for precision, double, bound in (("float64", True, 1e-9), ("float32", False, 0.05)):
        with jax.enable_x64(double):
            at = jnp.asarray(height)
            ray, slope, back = _traced(_plano_convex(), at)
            values = [np.asarray(leaf, dtype=np.float64) for leaf in jax.tree.leaves(ray)]
            slope, back = float(slope), float(back)
        finite = all(np.isfinite(each).all() for each in (*values, slope, back))
        expected, by_height = _snell(height) if passes else (0.0, 0.0)
        turned = float(math.asin(-values[1][0])) if finite else math.nan
        yield Check("glass", name, f"angle, {precision}", "Snell's law", abs(turned - expected), bound)
        for mode, value in (("forward", slope), ("reverse", back)):
            error = abs(value - by_height) / (1.0 + abs(by_height))
            yield Check("glass", name, f"slope {mode}, {precision}", "Snell's law", error, bound)
        wrong = float((float(values[2]) > BLOCKED) != passes)
        yield Check("glass", name, f"verdict, {precision}", "passes" if passes else "blocked", wrong, 0.0)


def _snell(height: float) -> tuple[float, float]:
    """The angle that a ray is turned by, and its derivative by the height."""
    inside, outside = math.asin(height / _RADIUS), math.asin(_INDEX * height / _RADIUS)
    slope = _INDEX / math.cos(outside) - 1.0 / math.cos(inside)
    return outside - inside, slope / _RADIUS


@jit
def _traced(lens: Prescription, height: jax.Array) -> tuple[RealRay, jax.Array, jax.Array]:
    """A ray, and the slope of the angle that it is turned by, forwards and in reverse."""

    def ray(height: jax.Array) -> RealRay:
        start = jnp.stack([height, jnp.zeros_like(height), jnp.full_like(height, -5.0)])
        along = jnp.array([0.0, 0.0, 1.0], dtype=height.dtype)
        return trace(lens, lens.indices(jnp.asarray(587.0, dtype=height.dtype)), start, along)

    def turned(height: jax.Array) -> jax.Array:
        return jnp.arcsin(-ray(height).direction[0])

    return ray(height), jax.jacfwd(turned)(height), jax.grad(turned)(height)


def _plano_convex() -> Prescription:
    return make_prescription(
        surfaces=[sphere(0.0), sphere(-1.0 / _RADIUS)],
        thicknesses=[_RADIUS, 0.0],
        semi_diameters=[0.999 * _RADIUS, 0.999 * _RADIUS],
        glasses=[index_glass(_INDEX), index_glass(1.0)],
        stop=0,
    )
