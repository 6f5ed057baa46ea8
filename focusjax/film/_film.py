"""What receives the light: film that is developed, and perhaps printed, and sensors."""

import abc
import math
from collections.abc import Sequence
from typing import SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from focusjax._programs import jit
from focusjax.film._curve import ResponseCurve
from focusjax.film._photometry import GREY, SATURATION
from focusjax.film._photons import FEW, few_photons
from focusjax.film._settings import require_iso

_APERTURE_AREA = math.pi * 24e-6**2
"""In m^2, of the spot of 48 micrometres over which RMS granularity is measured."""

_CLEAR = 1e-6
"""A density too low to have grain."""


class AbstractFilm(eqx.Module):
    """What turns a signal into a picture. A signal of 0.18 is a metered grey, and one of 1 white."""

    @abc.abstractmethod
    def develop(
        self,
        signal: Float[Array, "h w 3"],
        *,
        iso: Float[Array, ""] | float,
        pixel_size: Float[Array, ""] | float,
        key: PRNGKeyArray | None = None,
    ) -> Float[Array, "h w 3"]:
        """The linear light of the picture; 0 is black and 1 display white.

        Args:
            signal: exposure times speed.
            iso: arithmetic speed at which it was exposed.
            pixel_size: metres on the film that a pixel's side takes.
            key: of grain and noise; without it there is none.
        """


class Film(AbstractFilm):
    """An emulsion with a characteristic curve, and perhaps the paper that it is printed on. See `film`.

    A display curve is one, too: that of a slide which is as dense as the display is dark.

    The picture is 10^-(D - D_0) with D_0 the least density: what a slide lets through, or a print reflects.
    The paper is exposed through the negative, by as much light as makes a metered grey grey.

    Grain is white noise of the emulsion's density D, normal, with the standard deviation of Selwyn's and
    Nutting's laws,

        sigma = G / 1000 sqrt(A_48 / A) sqrt(D / (1 + D_0)),

    with G the RMS granularity (at a net density of 1, over a spot of 48 micrometres and area A_48) and A the
    area of a pixel, which has to be larger than the grain. Derivatives are those at fixed random numbers.

    Attributes:
        curve: of the emulsion.
        paper: of the print's paper; None for a slide, or a negative that is looked at.
        print_light: [3] log10 of the light that the paper gets through no density, over that for a grey.
        granularity: G; None for no grain.
        sensitivity: [3] shares of red, green and blue in what a black and white film sees; None for colour.
    """

    curve: ResponseCurve
    paper: ResponseCurve | None
    print_light: Float[Array, "3"] | None
    granularity: Float[Array, ""] | None
    sensitivity: Float[Array, "3"] | None

    def density(self, signal: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
        """Of the emulsion, without grain."""
        if self.sensitivity is not None:
            signal = jnp.broadcast_to((signal @ self.sensitivity)[..., None], signal.shape)
        return self.curve.of_signal(signal)

    def light(self, density: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
        """The picture's linear light for a density of the emulsion."""
        shown = self.curve
        if self.paper is not None:
            assert self.print_light is not None
            lead = (1,) * (density.ndim - 1)
            density, shown = self.paper(self.print_light.reshape(*lead, 3) - density), self.paper
        return 10.0 ** (shown.least().reshape(*(1,) * (density.ndim - 1), 3) - density)

    def develop(
        self,
        signal: Float[Array, "h w 3"],
        *,
        iso: Float[Array, ""] | float,
        pixel_size: Float[Array, ""] | float,
        key: PRNGKeyArray | None = None,
    ) -> Float[Array, "h w 3"]:
        del iso
        density = self.density(signal)
        if key is not None and self.granularity is not None:
            least = self.curve.least().reshape(1, 1, 3)
            share = jnp.maximum(density, _CLEAR) / (1.0 + least)
            sigma = self.granularity / 1000.0 * jnp.sqrt(share) * (math.sqrt(_APERTURE_AREA) / pixel_size)
            # One layer of silver makes one pattern; three layers of dye make three.
            shape = density.shape if self.sensitivity is None else (*density.shape[:-1], 1)
            density = density + sigma * jax.random.normal(key, shape, density.dtype)
        return self.light(density)


class Sensor(AbstractFilm):
    """Pixels that count electrons until they are full, at a signal of 1.404 (ISO 12232).

    At the base speed a full pixel holds `full_well` electrons; at speed S, where the same signal takes less
    light, `base_iso` / S times as many. Where n photons are expected, n = full_well base_iso / S x signal /
    1.404, noise is normal with the variance n + read_noise^2; where they are fewer than 32, their number is
    Poisson's, and only the reading is normal. Nothing else is modelled: no dark current, no pattern, no
    steps of a converter. Derivatives are those at fixed random numbers, and 0 where pixels are full.

    The picture is the signal, up to 1.404: what is above 1 is for those who darken it.

    Attributes:
        full_well: electrons; None for no noise.
        read_noise: electrons, standard deviation; None for no noise.
        base_iso: the speed without gain; None for no noise.
    """

    full_well: Float[Array, ""] | None = None
    read_noise: Float[Array, ""] | None = None
    base_iso: Float[Array, ""] | None = None

    def develop(
        self,
        signal: Float[Array, "h w 3"],
        *,
        iso: Float[Array, ""] | float,
        pixel_size: Float[Array, ""] | float,
        key: PRNGKeyArray | None = None,
    ) -> Float[Array, "h w 3"]:
        del pixel_size
        if key is not None and self.full_well is not None:
            assert self.read_noise is not None
            assert self.base_iso is not None
            electrons = self.full_well * self.base_iso / (iso * SATURATION)
            read_noise = self.read_noise
            expected = jnp.clip(signal, 0.0, SATURATION) * electrons
            variance = expected + read_noise**2
            # Where nothing varies the root has no slope, and nothing to give.
            varies = variance > 0.0
            spread = jnp.where(varies, jnp.sqrt(jnp.where(varies, variance, 1.0)), 0.0)
            drawn = jax.random.normal(key, signal.shape, signal.dtype)
            noise = spread * drawn

            def with_few(noise: Float[Array, "h w 3"]) -> Float[Array, "h w 3"]:
                photons = few_photons(jax.random.fold_in(key, 1), expected)
                read = read_noise * drawn
                return jnp.where(expected < FEW, photons - expected + read, noise)

            noise = jax.lax.cond(jnp.any(expected < FEW), with_few, lambda noise: noise, noise)
            signal = jnp.maximum(signal + noise / electrons, 0.0)
        return jnp.minimum(signal, SATURATION)


def film(
    curve: ResponseCurve,
    *,
    paper: ResponseCurve | None = None,
    rms_granularity: SupportsFloat | None = None,
    sensitivity: ArrayLike | Sequence[float] | None = None,
) -> Film:
    """A `Film` with checked values.

    Args:
        curve: of the emulsion; log exposure 0 is a metered grey.
        paper: what it is printed on; its own log exposure 0 is arbitrary.
        rms_granularity: a number such as 8 from a data sheet, for grain.
        sensitivity: red, green and blue shares, of a black and white film; they are made to sum to 1.

    Raises:
        ValueError: a paper that cannot show a grey of 18 %, a granularity below 0, or a sensitivity that is
            no share.
    """
    if rms_granularity is not None and not 0.0 <= float(rms_granularity) < math.inf:
        raise ValueError(f"the RMS granularity is {float(rms_granularity):g}; expected 0 or more, such as 8")
    shares = None
    if sensitivity is not None:
        shares = np.asarray(sensitivity, dtype=float)
        if shares.shape != (3,) or not np.isfinite(shares).all() or (shares < 0).any() or not shares.any():
            raise ValueError(f"the sensitivity is {shares.tolist()}; expected shares of red, green and blue")
        shares = jnp.asarray(shares / shares.sum(), dtype=float)
    grain = None if rms_granularity is None else jnp.asarray(float(rms_granularity), dtype=float)
    light = None if paper is None else _print_light(curve, paper)
    return Film(curve, paper, light, grain, shares)


def sensor(
    *,
    full_well: SupportsFloat | None = None,
    read_noise: SupportsFloat = 0.0,
    base_iso: SupportsFloat = 100.0,
) -> Sensor:
    """A `Sensor` with checked values.

    Args:
        full_well: electrons that a pixel holds at the base speed, for noise; none without.
        read_noise: electrons, for noise.
        base_iso: the speed at which the pixel is filled.

    Raises:
        ValueError: a full well that is not positive, a read noise below 0 or without a full well, no speed.
    """
    require_iso(float(base_iso))
    if not 0.0 <= float(read_noise) < math.inf:
        raise ValueError(f"the read noise is {float(read_noise):g} electrons; expected 0 or more")
    if full_well is None:
        if float(read_noise) > 0:
            raise ValueError(
                "a read noise is given without the full well that says how much it is; give both"
            )
        return Sensor()
    if not 0.0 < float(full_well) < math.inf:
        raise ValueError(f"the full well is {float(full_well):g} electrons; expected above 0, such as 40000")
    numbers = (jnp.asarray(float(each), dtype=float) for each in (full_well, read_noise, base_iso))
    return Sensor(*numbers)


def _print_light(curve: ResponseCurve, paper: ResponseCurve) -> Float[Array, "3"]:
    """Log10 of the printing light that shows a metered grey as `GREY`, by bisection of the paper's curve."""
    grey = np.asarray(_densities(curve, jnp.zeros(3)))
    least = np.asarray(paper.least())
    places, densities = np.asarray(paper.log_exposure), np.asarray(paper.density)
    wanted = least - math.log10(GREY)
    if (wanted > densities.max(axis=0)).any():
        raise ValueError(
            f"the paper's densities reach {densities.max(axis=0).min() - least.max():.2f} above its white,"
            f" which is no grey of 18 %, for which it takes {-math.log10(GREY):.2f}"
        )
    if (densities[-1] < densities[0]).any():
        raise ValueError("the paper gets lighter with exposure; expected one that gets darker")
    low, high = np.full(3, places[0]), np.full(3, places[-1])
    for _ in range(60):
        middle = 0.5 * (low + high)
        darker = np.asarray(_densities(paper, jnp.asarray(middle, dtype=float))) > wanted
        low, high = np.where(darker, low, middle), np.where(darker, middle, high)
    return jnp.asarray(0.5 * (low + high) + grey, dtype=float)


@jit
def _densities(curve: ResponseCurve, log_exposure: Float[Array, "3"]) -> Float[Array, "3"]:
    """Those at a log exposure of each colour, compiled once for the steps of a search."""
    return curve(log_exposure)
