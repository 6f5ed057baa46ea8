"""Settings from a picture: the exposure, and the white balance, that developed into it."""

import dataclasses
from collections.abc import Sequence
from typing import Any, SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax._programs import jit
from focusjax.film._display import encode_srgb
from focusjax.film._film import AbstractFilm, Sensor
from focusjax.film._photograph import photograph
from focusjax.film._photometry import LUMINANCE
from focusjax.film._settings import CameraSettings

EXPOSING = ("f_number", "time", "iso")
"""Settings of which a picture shows the product only."""

_POWERS = {"f_number": -0.5, "time": 1.0, "iso": 1.0}
"""Of the factor that a stop more of light is for each."""

_STOPS = np.arange(-12.0, 12.5, 0.5)
"""Steps of the exposure that are tried before the fit, against the start's."""


class SettingsFit(eqx.Module):
    """What `fit_settings` found.

    Attributes:
        settings: the start, with what was free as the picture has it.
        balance: gains of red, green and blue.
        rms: root of the mean square of what is left, in signals of the display (sRGB, 0 to 1).
        stops_error: standard error of the exposure in stops, if what is left is noise.
        converged: whether the fit ended.
    """

    settings: CameraSettings
    balance: Float[Array, "3"]
    rms: Float[Array, ""]
    stops_error: Float[Array, ""]
    converged: Bool[Array, ""]


def fit_settings(
    target: Float[Array, "h w 3"],
    image: Float[Array, "*size 3"],
    start: CameraSettings,
    film: AbstractFilm | None = None,
    *,
    luminance: SupportsFloat,
    free: Sequence[str] = ("time",),
    max_steps: int = 64,
) -> SettingsFit:
    """The settings that `photograph` made `target` with, by least squares over display signals.

    A picture of known radiance shows how much light there was: one of f-number, time and speed, the others
    being known. (What an f-number does to blur `fit_image` takes.) White balance is found beside it. The
    exposure is looked for over 12 stops to both sides of the start, by steps, and then by Levenberg and
    Marquardt's method.

    Args:
        target: a developed picture, in linear display light.
        image: linear radiance of the same view.
        start: where to start, and the values of what is known.
        film: what developed it; a plain sensor if None.
        luminance: cd/m^2 of radiance 1.
        free: one of "f_number", "time" and "iso"; and "white_balance".
        max_steps: pictures that the fit may try.

    Raises:
        ValueError: other names, more than one or none of the three, pictures of two sizes, or a target that
            is black or full everywhere, so that the exposure cannot be estimated from it.

    Example:
        >>> settings = fj.camera_settings(f_number=8, time=1 / 60, iso=100)
        >>> ramp = jnp.broadcast_to(jnp.linspace(0.05, 0.4, 8)[:, None], (6, 8, 3))
        >>> taken = fj.photograph(ramp, settings, fj.film_preset("reversal"), luminance=2000)
        >>> start = fj.camera_settings(f_number=8, time=1 / 15, iso=100)
        >>> fit = fj.fit_settings(taken, ramp, start, fj.film_preset("reversal"), luminance=2000)
        >>> round(1 / float(fit.settings.time), 2)
        60.0
    """
    names = tuple(free)
    exposing = [name for name in names if name in EXPOSING]
    unknown = [name for name in names if name not in (*EXPOSING, "white_balance")]
    if isinstance(free, str) or unknown:
        raise ValueError(f"free is {free!r}; expected one of {list(EXPOSING)}, and 'white_balance'")
    if len(exposing) != 1:
        raise ValueError(
            f"free has {len(exposing)} of {', '.join(EXPOSING)}; expected one, since a picture shows only"
            " what they make together"
        )
    if target.shape != image.shape:
        raise ValueError(f"the target is {target.shape} and the image {image.shape}; expected one size")
    balanced = "white_balance" in names
    medium = Sensor() if film is None else film
    wanted = encode_srgb(target)
    powers = jnp.asarray([_POWERS[name] * (name == exposing[0]) for name in EXPOSING], dtype=image.dtype)
    known = (image, wanted, start, medium, jnp.asarray(float(luminance), dtype=image.dtype), powers)
    stops = jnp.asarray(_STOPS, dtype=image.dtype)
    errors = _scan(stops, known)
    if not float(errors.max() - errors.min()) > 0.0:
        raise ValueError("the exposure cannot be estimated: a picture is black, or full, everywhere")
    first = jnp.zeros(3 if balanced else 1, dtype=image.dtype).at[0].set(stops[jnp.argmin(errors)])
    found = _refined(first, known, max_steps)
    value = jnp.asarray(found.x, dtype=image.dtype)
    # What is left varies by so much, if it is noise.
    variance = 2.0 * found.cost / max(found.fun.size - found.x.size, 1)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * variance
    return SettingsFit(
        settings=_exposed(start, powers, value[0]),
        balance=_gains(value),
        rms=jnp.asarray(np.sqrt(np.mean(found.fun**2)), dtype=image.dtype),
        stops_error=jnp.asarray(np.sqrt(covariance[0, 0]), dtype=image.dtype),
        converged=jnp.asarray(found.success),
    )


def _exposed(start: CameraSettings, powers: Float[Array, "3"], stops: Float[Array, ""]) -> CameraSettings:
    """The start, exposed by so many stops more through one of its settings."""
    factors = 2.0 ** (powers * stops)
    values = {name: getattr(start, name) * factors[number] for number, name in enumerate(EXPOSING)}
    return dataclasses.replace(start, **values)


def _gains(value: Float[Array, " k"]) -> Float[Array, "3"]:
    """Gains that leave the luminance of white: stops of red and blue over green are free, or none is."""
    over_green = jnp.stack([value[1], jnp.zeros_like(value[0]), value[2]]) if len(value) > 1 else jnp.zeros(3)
    gains = 2.0 ** over_green.astype(value.dtype)
    return gains / (gains @ jnp.asarray(LUMINANCE, dtype=value.dtype))


def _residuals(value: Float[Array, " k"], known: tuple) -> Float[Array, "n"]:
    image, wanted, start, film, luminance, powers = known
    settings = _exposed(start, powers, value[0])
    shown = photograph(image, settings, film, luminance=luminance, balance=_gains(value))
    return (encode_srgb(shown) - wanted).reshape(-1)


@jit
def _scan(stops: Float[Array, "n"], known: tuple) -> Float[Array, "n"]:
    return jax.lax.map(lambda one: jnp.mean(_residuals(one[None], known) ** 2), stops)


@jit
def _left_and_slopes(
    value: Float[Array, " k"], known: tuple
) -> tuple[Float[Array, "n"], Float[Array, "n k"]]:
    """What is left at a value, and how it changes."""

    def left(value: Array) -> tuple[Array, Array]:
        each = _residuals(value, known)
        return each, each

    slopes, now = jax.jacfwd(left, has_aux=True)(value)
    return now, slopes


def _refined(first: Float[Array, " k"], known: tuple, max_steps: int) -> Any:
    """SciPy's result: the best value from a first one, by Levenberg and Marquardt's method on the host."""
    from scipy.optimize import least_squares

    def at(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        left, slopes = _left_and_slopes(jnp.asarray(value, dtype=first.dtype), known)
        return np.asarray(left, dtype=float), np.asarray(slopes, dtype=float)

    tolerance = 1e-10 if first.dtype == jnp.float64 else 1e-6
    return least_squares(
        lambda value: at(value)[0],
        np.asarray(first, dtype=float),
        jac=lambda value: at(value)[1],  # type: ignore[arg-type]
        method="lm",
        xtol=tolerance,
        ftol=tolerance,
        gtol=tolerance,
        max_nfev=max_steps,
    )
