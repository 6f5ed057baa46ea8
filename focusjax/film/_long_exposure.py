"""Long exposures: frames accumulated one by one, as bright as one of them (Kyaw 2013 section 7.4)."""

from typing import SupportsFloat

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import real_numbers


class LongExposure(eqx.Module):
    """The mean of the frames so far, weighted by how long each was exposed. `start_exposure` makes one.

    Each frame is blended in with its share of the time so far, a = t_n / (t_1 + ... + t_n), and what is
    there with 1 - a. So the picture is complete after every frame, however many there are, and as bright as a
    frame: what stands still stays as it is, and a light that moves leaves a trail whose brightness does not
    depend on how finely time was cut. Settings that expose one frame rightly expose all of them.

    Frames stand for the light between them as well, so a light that moves on by more than its own image
    leaves a dotted trail.

    Attributes:
        picture: linear radiance [h, w, 3].
        time: seconds so far, or frames where no durations are given.

    Example:
        >>> dark, bright = jnp.zeros((4, 6, 3)), jnp.ones((4, 6, 3))
        >>> exposure = fj.start_exposure(6, 4).add(dark, 3.0).add(bright, 1.0)
        >>> float(exposure.picture[0, 0, 0]), float(exposure.time)
        (0.25, 4.0)
    """

    picture: Float[Array, "h w 3"]
    time: Float[Array, ""]

    def add(self, frame: Float[Array, "h w 3"], duration: ArrayLike = 1.0) -> "LongExposure":
        """With one frame more, which took `duration`. Differentiable, and made for `lax.scan`.

        Raises:
            ValueError: a frame of another size, or a duration that is negative or not finite.
        """
        if frame.shape != self.picture.shape:
            raise ValueError(
                f"the frame has shape {frame.shape}; expected {self.picture.shape}, that of the frames before"
            )
        _refuse_unless_times(duration)
        spent = jnp.asarray(duration, dtype=self.time.dtype)
        time = self.time + spent
        # Written so that a frame that is as the picture changes no digit of it; nothing at all takes no time.
        share = jnp.where(time > 0.0, spent / jnp.where(time > 0.0, time, 1.0), 0.0)
        blended = self.picture + share.astype(self.picture.dtype) * (frame - self.picture)
        return LongExposure(blended, time)


def start_exposure(width: int, height: int, *, dtype: jnp.dtype | type | None = None) -> LongExposure:
    """A `LongExposure` before its first frame: black, and of no time.

    Example:
        >>> exposure = start_exposure(6, 4)
        >>> for light in (1.0, 3.0):
        ...     exposure = exposure.add(jnp.full((4, 6, 3), light))
        >>> float(exposure.picture[0, 0, 0]), float(exposure.time)
        (2.0, 2.0)
    """
    kind = jnp.zeros(()).dtype if dtype is None else dtype
    return LongExposure(jnp.zeros((height, width, 3), kind), jnp.zeros((), kind))


def expose_frames(
    frames: Float[Array, "n h w 3"], durations: Float[Array, "n"] | SupportsFloat = 1.0
) -> LongExposure:
    """All frames of a stack, accumulated; `durations` are theirs, or that of each.

    Raises:
        ValueError: another number of durations than of frames, or one that is negative or not finite.

    Example:
        >>> frames = jnp.stack([jnp.zeros((4, 6, 3)), jnp.ones((4, 6, 3))])
        >>> float(fj.expose_frames(frames, jnp.array([3.0, 1.0])).picture[0, 0, 0])
        0.25
    """
    _refuse_unless_times(durations)
    spent = jnp.asarray(durations, dtype=frames.dtype)
    if spent.shape not in ((), frames.shape[:1]):
        raise ValueError(
            f"there are {len(frames)} frames and durations of shape {spent.shape}; give one for all, or"
            " one each"
        )

    def add(exposure: LongExposure, each: tuple[Array, Array]) -> tuple[LongExposure, None]:
        return exposure.add(*each), None

    start = start_exposure(frames.shape[2], frames.shape[1], dtype=frames.dtype)
    return jax.lax.scan(add, start, (frames, jnp.broadcast_to(spent, frames.shape[:1])))[0]


def _refuse_unless_times(durations: ArrayLike | SupportsFloat) -> None:
    """Of numbers that are known; those that JAX traces are not."""
    if isinstance(durations, Tracer):
        return
    times = real_numbers(durations, "a frame's duration", "seconds, or numbers in proportion to them")
    wrong = times[~((times >= 0.0) & np.isfinite(times))]
    if wrong.size:
        raise ValueError(
            f"a frame's duration is {wrong.flat[0]:g}; expected a time that is finite and not negative"
        )
