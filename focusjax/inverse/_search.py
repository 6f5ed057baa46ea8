"""Where to start a fit: the lenses that a scan says come closest to the target."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.inverse._levels import Problem
from focusjax.inverse._scan import Compared, Scan
from focusjax.inverse._variables import FOCUS, GAIN, RADIUS, SWING, TILT, Variables, settings_of
from focusjax.lens import view_tangents

_TRIALS = {1: 7, 2: 10, 3: 12, 4: 13}
"""Lenses tried, as powers of two, by the number of settings that are free, gain apart."""
_AT_ONCE = 1 << 9
_REFINED = 12
_APART = 0.1
"""Of the box, by which starts differ in some setting."""


def best_starts(
    problem: Problem, variables: Variables, scan: Scan, count: int
) -> list[tuple[Float[Array, " k"], float]]:
    """Up to `count` lenses, not near one another, that come closest to the target.

    Their variables, and the sums of squares that their pictures differ by; the least first.

    Lenses are spread evenly (Sobol) over foci and openings of the scan and planes that lean as far as the
    scan's foci go within the frame; the best are refined by Nelder and Mead's method, and the best of these
    taken. None of it makes a picture.
    """
    from scipy.optimize import minimize
    from scipy.stats import qmc

    compared = Compared(scan, np.asarray(problem.target), np.asarray(problem.weight))
    camera = problem.layers.camera
    free = [column for column in variables.columns if column != GAIN]
    gain = None if GAIN in variables.columns else float(variables.gain)
    if not free:
        return [(variables.start(problem.layers), 0.0)]
    middles = jnp.asarray(compared.middles.reshape(-1, 2), dtype=problem.target.dtype)
    tangents = np.asarray(jax.vmap(lambda p: view_tangents(camera, p))(middles))
    right, up = tangents.T.reshape(2, *compared.middles.shape[:2])
    own = np.asarray(settings_of(variables.lens, variables.gain))
    depth = scan.focus[-1] - scan.focus[0]
    lean = [
        np.minimum(depth / (2.0 * np.abs(t).max()), np.asarray(variables.upper)[k])
        for t, k in ((up, TILT), (right, SWING))
    ]
    low = np.array([scan.focus[0], np.log(scan.radius[-1]), -lean[0], -lean[1]])
    high = np.array([scan.focus[-1], np.log(scan.radius[0]), *lean])
    high = np.where(high > low, high, low + 1e-9)

    def settings(unit: np.ndarray) -> np.ndarray:
        """Of points [n, k] of the unit cube of what is free."""
        out = np.tile(own[:4], (len(unit), 1)).astype(float)
        out[:, free] = low[free] + np.clip(unit, 0.0, 1.0) * (high - low)[free]
        if RADIUS in free:
            out[:, RADIUS] = np.exp(out[:, RADIUS])
        return out

    def costs(unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        tried = settings(unit)
        focus = (
            tried[:, FOCUS, None, None]
            + tried[:, TILT, None, None] * up
            + tried[:, SWING, None, None] * right
        )
        return compared.cost(focus, tried[:, RADIUS], gain=gain)

    cube = qmc.Sobol(len(free), scramble=True, rng=np.random.default_rng(0)).random_base2(_TRIALS[len(free)])
    tried = np.concatenate([costs(part)[0] for part in np.array_split(cube, -(-len(cube) // _AT_ONCE))])
    refined = []
    for start in cube[np.argsort(tried, kind="stable")[:_REFINED]]:
        found = minimize(
            lambda u: float(costs(u[None])[0][0]) + compared.tt * _outside(u),
            start,
            method="Nelder-Mead",
            options={"maxfev": 60 * len(free), "xatol": 1e-3, "fatol": 0.0},
        )
        refined.append((float(found.fun), np.clip(found.x, 0.0, 1.0)))
    chosen: list[np.ndarray] = []
    rest: list[float] = []
    for cost, unit in sorted(refined, key=lambda each: each[0]):
        if len(chosen) < count and all(np.abs(unit - other).max() > _APART for other in chosen):
            chosen.append(unit)
            rest.append(max(cost, 0.0))
    starts = []
    for unit in chosen:
        best = np.append(settings(unit[None])[0], costs(unit[None])[1][0])
        starts.append(variables.at(jnp.asarray(best, dtype=problem.target.dtype), problem.layers))
    return list(zip(starts, rest, strict=True))


def _outside(unit: np.ndarray) -> float:
    """How far a point is outside the unit cube."""
    return float(np.abs(unit - np.clip(unit, 0.0, 1.0)).sum())
