"""Characteristic curves: density against log exposure, read from tables (Kyaw 2013 section 4.5)."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._monotone_cubic import monotone_cubic
from focusjax.film._photometry import GREY

_DARK = 1e-12
"""A signal that is black on any film; its logarithm is finite."""


class ResponseCurve(eqx.Module):
    """Density of a developed emulsion, or of a print, against the common logarithm of its exposure.

    The curve passes through its table by cubic pieces that rise and fall only where the table does (Fritsch
    and Carlson 1980), and is straight where the table is. Beyond its ends, in toe and shoulder, density stays
    as it is there. Differentiable in exposure and densities; the slope is 0 beyond the ends.

    Attributes:
        log_exposure: [k] log10 of exposure over that of a metered grey; rising.
        density: [k, 3] of red, green and blue; density 1 lets a tenth of the light through.
    """

    log_exposure: Float[Array, " k"]
    density: Float[Array, "k 3"]

    def __call__(self, log_exposure: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
        """Density at a log exposure, colour by colour."""
        layers = [
            monotone_cubic(self.log_exposure, self.density[:, each], log_exposure[..., each])
            for each in range(3)
        ]
        return jnp.stack(layers, axis=-1)

    def of_signal(self, signal: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
        """Density at a signal, of which 0.18 is a metered grey; no light, and less, is black."""
        lit = signal > _DARK
        safe = jnp.where(lit, signal, _DARK)
        return self(jnp.where(lit, jnp.log10(safe / GREY), jnp.log10(_DARK / GREY)))

    def least(self) -> Float[Array, "3"]:
        """The least density: the base with its fog, or paper white."""
        return jnp.min(self.density, axis=0)


def response_curve(
    log_exposure: ArrayLike | Sequence[float],
    density: ArrayLike | Sequence[Any],
    *,
    name: str = "the response curve",
) -> ResponseCurve:
    """A `ResponseCurve` with checked values.

    Args:
        log_exposure: [k] log10 of exposure over that of a metered grey.
        density: [k], or [k, 3] for red, green and blue.
        name: what to call it in messages.

    Raises:
        ValueError: fewer than two points, values that are not finite, exposures that do not rise, or a
            density that rises here and falls there, with the point where it turns.

    Example:
        >>> curve = response_curve([-1.0, 0.0, 1.0], [0.1, 0.7, 1.3])
        >>> round(float(curve(jnp.full(3, 0.5))[0]), 6)
        1.0
    """
    places, values = np.asarray(log_exposure, dtype=float), np.asarray(density, dtype=float)
    if values.ndim == 1:
        values = np.repeat(values[:, None], 3, axis=1)
    if places.ndim != 1 or len(places) < 2 or values.shape != (len(places), 3):
        raise ValueError(
            f"{name} has log exposures of shape {places.shape} and densities of shape {values.shape};"
            " expected [k] and [k] or [k, 3], with two points or more"
        )
    for what, numbers in (("log exposure", places[:, None]), ("density", values)):
        bad = ~np.isfinite(numbers).all(axis=1)
        if bad.any():
            raise ValueError(f"{name} has a {what} that is not finite, at point {int(bad.argmax()) + 1}")
    back = np.diff(places) <= 0
    if back.any():
        at = int(back.argmax())
        raise ValueError(
            f"{name} goes from log exposure {places[at]:g} to {places[at + 1]:g} at point {at + 2}; log"
            " exposures have to rise"
        )
    for colour, column in zip(("red", "green", "blue"), values.T, strict=True):
        _refuse_turns(name, colour, places, column)
    return ResponseCurve(jnp.asarray(places, dtype=float), jnp.asarray(values, dtype=float))


def load_curve(path: Path | str) -> ResponseCurve:
    """The curve in a text file: lines of comma-separated values, and comments after #.

    The first line names the columns, `log_exposure,density` or `log_exposure,red,green,blue`.

    Raises:
        ValueError: a file that cannot be read, other columns, or what `response_curve` refuses.
    """
    try:
        lines = Path(path).read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: this curve cannot be read ({error}); check the path") from error
    rows = list(csv.reader(line for line in lines if line.strip() and not line.lstrip().startswith("#")))
    header = [cell.strip() for cell in rows[0]] if rows else []
    if header not in (["log_exposure", "density"], ["log_exposure", "red", "green", "blue"]):
        raise ValueError(
            f"{path}: the first line is {','.join(header) or 'missing'}; expected log_exposure,density or"
            " log_exposure,red,green,blue"
        )
    numbers = []
    for count, row in enumerate(rows[1:], start=1):
        try:
            numbers.append([float(cell) for cell in row])
        except ValueError:
            numbers.append([])
        if len(numbers[-1]) != len(header):
            raise ValueError(f"{path}: point {count} is {','.join(row)}; expected {len(header)} numbers")
    table = np.array(numbers).reshape(len(numbers), len(header))
    return response_curve(table[:, 0], table[:, 1] if len(header) == 2 else table[:, 1:], name=str(path))


def _refuse_turns(name: str, colour: str, places: np.ndarray, density: np.ndarray) -> None:
    """Refuse a curve that rises here and falls there, naming the first point that goes against its ends."""
    steps = np.diff(density)
    rising = density[-1] >= density[0]
    wrong = steps < 0 if rising else steps > 0
    if wrong.any():
        at = int(wrong.argmax())
        way, against = ("rises", "falls") if rising else ("falls", "rises")
        raise ValueError(
            f"{name} {way} from end to end, but in {colour} it {against} from density {density[at]:g} at log"
            f" exposure {places[at]:g} to {density[at + 1]:g} at {places[at + 1]:g} (point {at + 2}); a"
            " response has to be monotonic"
        )
