"""From linear radiance to a developed picture."""

from typing import SupportsFloat

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from focusjax._programs import jit
from focusjax.film._film import AbstractFilm, Sensor
from focusjax.film._settings import CameraSettings
from focusjax.geometry import FULL_FRAME_WIDTH


def film_exposure(
    image: Float[Array, "h w 3"], settings: CameraSettings, *, luminance: ArrayLike
) -> Float[Array, "h w 3"]:
    """Lux seconds that each pixel gets, H = E t (Kyaw 2013 eq. 4.1 and 4.9).

    Each channel has that of a neutral light of its value. What the lens takes from the corners, by vignetting
    or as cos^4, is in the picture already.

    Args:
        image: linear radiance, such as `render` makes.
        settings: what is set on the camera.
        luminance: cd/m^2 of radiance 1.
    """
    return image * settings.exposure(jnp.asarray(luminance, dtype=image.dtype)).astype(image.dtype)


def photograph(
    image: Float[Array, "h w 3"],
    settings: CameraSettings,
    film: AbstractFilm | None = None,
    *,
    luminance: ArrayLike,
    balance: Float[Array, "3"] | None = None,
    sensor_width: SupportsFloat = FULL_FRAME_WIDTH,
    seed: int | None = None,
) -> Float[Array, "h w 3"]:
    """The picture that a camera takes: exposed through its settings, developed, and in linear display light.

    A radiance whose exposure is 10 lux seconds over the ISO speed, a metered grey, gets 0.18 from a plain
    sensor, and what is 5.6 times as bright gets 1, display white (ISO 12232, standard output sensitivity).
    `save_png` writes it. Differentiable in the picture, the settings, the film and the balance.

    Args:
        image: linear radiance [h, w, 3].
        settings: what is set on the camera.
        film: a film or a sensor; a sensor without noise if None.
        luminance: cd/m^2 of radiance 1; `luminance_of_light_value` gives it for an exposure value.
        balance: gains of red, green and blue before the film, for white balance.
        sensor_width: metres that the picture is wide on the film, which grain depends on.
        seed: of grain and noise, which there are none of if None.

    Raises:
        ValueError: a luminance that is not positive, or gains that are not.

    Example:
        >>> from focusjax.film import camera_settings, film_preset
        >>> settings = camera_settings(f_number=8, time=1 / 125, iso=100)
        >>> grey = jnp.full((4, 6, 3), 0.18)
        >>> shown = photograph(grey, settings, film_preset("reversal"), luminance=4000)
        >>> shown.shape
        (4, 6, 3)
    """
    _refuse_unless_positive(luminance, "luminance of radiance 1", "cd/m^2 above 0, such as 4000")
    signal = film_exposure(image, settings, luminance=luminance) * signal_per_exposure(settings, image)
    return develop(
        signal,
        Sensor() if film is None else film,
        iso=settings.iso,
        balance=balance,
        sensor_width=sensor_width,
        seed=seed,
    )


def develop(
    signal: Float[Array, "h w 3"],
    film: AbstractFilm,
    *,
    iso: Float[Array, ""] | float = 100.0,
    balance: Float[Array, "3"] | None = None,
    sensor_width: SupportsFloat = FULL_FRAME_WIDTH,
    seed: int | None = None,
) -> Float[Array, "h w 3"]:
    """What a film or a sensor makes of a signal, of which 0.18 is a metered grey: linear display light.

    Arguments are as for `photograph`, which exposes and then develops.

    Raises:
        ValueError: gains that are not positive.

    Example:
        >>> grey = jnp.full((4, 6, 3), 0.18)
        >>> shown = fj.develop(grey, fj.film_preset("reversal"))
        >>> shown.shape
        (4, 6, 3)
    """
    if balance is not None:
        _refuse_unless_positive(balance, "white balance", "a gain above 0 for red, green and blue")
    key = None if seed is None else jax.random.key(seed)
    speed = jnp.asarray(iso, dtype=signal.dtype)
    pixel_size = jnp.asarray(float(sensor_width) / signal.shape[1], dtype=signal.dtype)
    return _developed(signal, film, balance, speed, pixel_size, key)


@jit
def _developed(
    signal: Float[Array, "h w 3"],
    film: AbstractFilm,
    balance: Float[Array, "3"] | None,
    iso: Float[Array, ""],
    pixel_size: Float[Array, ""],
    key: PRNGKeyArray | None,
) -> Float[Array, "h w 3"]:
    """The compiled part."""
    if balance is not None:
        signal = signal * balance.astype(signal.dtype).reshape(1, 1, 3)
    return film.develop(signal, iso=iso, pixel_size=pixel_size, key=key).astype(signal.dtype)


def signal_per_exposure(settings: CameraSettings, like: Float[Array, "..."]) -> Float[Array, ""]:
    """The signal that a lux second makes at the settings' speed."""
    one = jnp.ones((), dtype=like.dtype)
    return (settings.signal(one) / settings.exposure(one)).astype(like.dtype)


def _refuse_unless_positive(value: ArrayLike, what: str, expected: str) -> None:
    """Of a value that is known; what is traced by JAX is taken as it is."""
    if isinstance(value, Tracer):
        return
    numbers = np.asarray(value, dtype=float)
    if numbers.shape not in ((), (3,)) or not (np.isfinite(numbers).all() and (numbers > 0).all()):
        raise ValueError(f"the {what} is {numbers.tolist()}; expected {expected}")
