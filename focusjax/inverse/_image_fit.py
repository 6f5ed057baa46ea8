"""What a fit to a picture found, and how well it is known."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.inverse._variables import FOCUS, GAIN, PARAMETERS, RADIUS, SWING, TILT, Variables
from focusjax.lens import ThinLens, TiltShiftLens, movements_of


@dataclasses.dataclass(frozen=True)
class Level:
    """One level of a fit.

    Attributes:
        block: edge in pixels of the blocks whose means were fitted.
        steps: lenses tried.
        rms_error: of the picture, pixel by pixel, as `ImageFit.rms_error`.
        converged: whether it ended because steps became small.
    """

    block: int
    steps: int
    rms_error: float
    converged: bool


@dataclasses.dataclass(frozen=True)
class ImageFit:
    """A lens that makes a picture like the target.

    Attributes:
        lens: the lens; a tilt-shift lens if tilt or swing was free.
        gain: what its picture is to be multiplied by.
        picture: that picture [h, w, 3], times the gain.
        rms_error: root mean square of picture less target, over the values that count, by their weight.
        standard_errors: of each free parameter by name, from the residual and the slopes of the picture at
            the solution, whatever part of it is noisier: "focus" in 1/m (of the disparity), "f_number",
            "tilt" and "swing" in radians, and "gain". Infinite where nothing tells. Errors of the geometry
            are not in them.
        at_limits: parameters that ended at a limit of what they may be: of the focus range, of the opening
            that the layers serve (peel for a wider lens), or of 45 degrees of tilt.
        levels: how each level went, the last that of single pixels.
        steps: lenses tried in all, those of a search apart.
        converged: whether the last level ended because steps became small.
    """

    lens: ThinLens | TiltShiftLens
    gain: float
    picture: Float[Array, "h w 3"]
    rms_error: float
    standard_errors: dict[str, float]
    at_limits: tuple[str, ...]
    levels: tuple[Level, ...]
    steps: int
    converged: bool


def standard_errors(
    variables: Variables,
    settings: Float[Array, "5"],
    camera: Camera,
    residual: np.ndarray,
    slopes: np.ndarray,
    weight: np.ndarray,
) -> dict[str, float]:
    """The standard error of each free parameter, where noise may differ from value to value.

    The covariance is (J' W J)^-1 J' W diag(r^2) W J (J' W J)^-1 n / (n - k) (White 1980): pictures of
    few rays are noisiest along blurred silhouettes, which is also where they tell most of the lens.

    Args:
        variables: what was free.
        settings: the solution.
        camera: that takes the picture.
        residual: picture less target [h, w, 3].
        slopes: of the picture by the free settings [h, w, 3, k].
        weight: of each value [h, w, 3].
    """
    columns = np.array(variables.columns)
    spread, known = covariance(residual, slopes, weight)
    turned = np.asarray(jax.jacfwd(lambda s: _reported(s, camera))(settings), dtype=np.float64)
    turned = turned[np.ix_(columns, columns)]
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", turned, spread, turned), 0.0))
    return {
        name: float(error) if there else math.inf
        for name, error, there in zip(variables.free, errors, known, strict=True)
    }


def covariance(
    residual: Float[np.ndarray, "h w c"], slopes: Float[np.ndarray, "h w c k"], weight: np.ndarray
) -> tuple[Float[np.ndarray, "k k"], np.ndarray]:
    """The covariance of the settings that were fitted, and which the picture depends on [k]."""
    size = slopes.shape[-1]
    rows = (np.sqrt(weight)[..., None] * slopes).reshape(-1, size).astype(np.float64)
    units = np.linalg.norm(rows, axis=0)
    safe = np.where(units > 0, units, 1.0)
    rows = rows / safe
    inverse = np.linalg.pinv(rows.T @ rows, hermitian=True)
    noisy = rows * (np.sqrt(weight) * residual).reshape(-1, 1)
    count = int((weight > 0).sum())
    spread = inverse @ (noisy.T @ noisy) @ inverse * count / max(count - size, 1)
    return spread / np.outer(safe, safe), units > 0


def _reported(settings: Float[Array, "5"], camera: Camera) -> Float[Array, "5"]:
    """The parameters that people know, in the order of `PARAMETERS`."""
    moved = movements_of(settings[jnp.array([SWING, TILT, FOCUS])], camera.focal_length)
    out = {
        "focus": settings[FOCUS],
        "f_number": camera.focal_length / (2.0 * settings[RADIUS]),
        "tilt": moved.tilt,
        "swing": moved.swing,
        "gain": settings[GAIN],
    }
    return jnp.stack([out[name].astype(settings.dtype) for name in PARAMETERS])
