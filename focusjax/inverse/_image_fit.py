"""What a fit to a picture found, and how well it is known."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax.geometry import Camera
from focusjax.inverse._polish import Polished, inverse_of
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
        picture: that picture [h, w, 3], times the gain; by the exact renderer if there is one.
        rms_error: root mean square of picture less target, over the values that count, by their weight.
        standard_errors: of each free parameter by name, from the residual and the slopes of the picture at
            the solution, whatever part of it is noisier: "focus" in 1/m (of the disparity), "f_number",
            "tilt" and "swing" in radians, and "gain". Infinite for a parameter that the picture does not
            depend on. They count what differs from pixel to pixel only: errors of the geometry are not in
            them, nor is the bias of a picture traced through layers, by which a fit without `exact` may be
            off by several of them. With `exact` those of the f-number may still be too small.
        at_limits: parameters that ended at a limit of what they may be: of the focus range, of the opening
            that the layers serve (peel for a wider lens), or of 45 degrees of tilt.
        levels: how each level went, the last that of single pixels.
        steps: lenses tried in all, those of a search apart.
        converged: whether the last level ended because steps became small.

    Example:
        >>> fit = fj.fit_image(photograph, layers, lens, free=("focus", "gain"))  # doctest: +SKIP
        >>> distance = float(fit.lens.focus_distance())  # doctest: +SKIP
        >>> fit.standard_errors["focus"], fit.at_limits  # doctest: +SKIP
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
    variables: Variables, found: Polished, camera: Camera, weight: np.ndarray
) -> dict[str, float]:
    """The standard error of each free parameter; see `covariance`.

    Args:
        variables: what was free.
        found: the solution.
        camera: that takes the picture.
        weight: of each value [h, w, 3].
    """
    columns = np.array(variables.columns)
    spread, known = covariance(found, weight)
    turned = np.asarray(
        jax.jacfwd(lambda s: _reported(s, camera))(
            jnp.asarray(found.settings, dtype=camera.focal_length.dtype)
        ),
        dtype=np.float64,
    )
    turned = turned[np.ix_(columns, columns)]
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", turned, spread, turned), 0.0))
    return {
        name: float(error) if there else math.inf
        for name, error, there in zip(variables.free, errors, known, strict=True)
    }


def covariance(found: Polished, weight: np.ndarray) -> tuple[Float[np.ndarray, "k k"], np.ndarray]:
    """The covariance of the settings that were fitted, and which the picture depends on [k].

    (J' W K)^-1 J' W diag(r^2) W J (J' W K)^-1 n / (n - k), where noise may differ from value to value
    (White 1980): pictures of few rays are noisiest along blurred silhouettes, which is also where they
    depend most on the lens. J and K are slopes by different rays.
    """
    inverse = inverse_of(found.square)
    noisy = np.einsum("hwck,hwc->hwck", found.slopes, weight * found.residual).reshape(-1, len(inverse))
    count = int((weight > 0).sum())
    spread = inverse @ (noisy.T @ noisy) @ inverse * count / max(count - len(inverse), 1)
    return spread, np.diag(found.square) > 0


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
