"""A lens whose rays are moved by the motion of things during a span, as far as peeling asks for it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.geometry import Camera, LensRay
from focusjax.lens import AbstractLens, AbstractLensWrapper
from focusjax.trace import moved_ray

_RIM = 32
_FILM = 5
_LINES = 32
_SLACK = 1.01
_SLACK_PX = 0.5
"""Between the rays that are looked at others may stray farther: the rim of 32 corners by 0.5 %."""


class SweptLens(AbstractLensWrapper):
    """All rays that a lens has during a span, in the axes in which a body stands still.

    For `peel`: how far rays stray from their film points and how far they move per dioptre, over the times of
    the span. The bounds are those of rays from film points all over the frame, through the rim of the
    opening.

    Attributes:
        lens: the lens itself, which makes blur and rays.
        offset: how far rays stray at infinity in pixels, and
        slope: what they stray more per dioptre: the lines [n] that bound all others from above.
        moves: pixels per dioptre that the farthest ray moves.
    """

    lens: AbstractLens
    offset: Float[Array, " n"]
    slope: Float[Array, " n"]
    moves: Float[Array, ""]

    def ray(self, camera: Camera, film_point: Float[Array, "2"], pupil_point: Float[Array, "2"]) -> LensRay:
        return self.lens.ray(camera, film_point, pupil_point)

    def footprint(
        self, camera: Camera, film_point: Float[Array, "2"], disparity: Float[Array, ""]
    ) -> tuple[Float[Array, "2"], Float[Array, ""]]:
        return film_point, self.reach(camera, disparity)

    def reach(self, camera: Camera, disparity: Float[Array, ""]) -> Float[Array, ""]:
        del camera
        return jnp.max(self.offset + self.slope * disparity)

    def parallax(self, camera: Camera) -> Float[Array, ""]:
        del camera
        return self.moves


def swept_lens(
    lens: AbstractLens, camera: Camera, key: Camera, matrices: Float[np.ndarray, "m 4 4"], nearest: float
) -> SweptLens:
    """The lens over a span, by the rays that it makes in the axes of `camera` at some times in it.

    `matrices` go from there to the axes of `key`, the camera of the layers, at times all over the span;
    `nearest` is the disparity in 1/m up to which bounds are to hold.
    """
    colours = [channel.lens for channel in lens.channels()] or [lens]
    found = [_rays(one, camera, key, jnp.asarray(matrices)) for one in colours]
    a, b, film = (
        np.concatenate([np.asarray(part, dtype=np.float64) for part in parts])
        for parts in zip(*found, strict=True)
    )
    # Rays that do not get through real glass are none.
    there = np.isfinite(a).all(axis=-1) & np.isfinite(b).all(axis=-1)
    a, b, film = a[there], b[there], film[there]
    offset = np.concatenate([(a - film).ravel(), (film - a).ravel()])
    slope = np.concatenate([b.ravel(), -b.ravel()])
    kept = _highest(offset, slope, nearest)
    offset, slope = (np.resize(line[kept], _LINES) for line in (offset, slope))
    real = jnp.zeros(()).dtype
    return SweptLens(
        lens,
        jnp.asarray(offset * _SLACK + _SLACK_PX, dtype=real),
        jnp.asarray(slope * _SLACK, dtype=real),
        jnp.asarray(_SLACK * np.linalg.norm(b, axis=-1).max(), dtype=real),
    )


@jit
def _rays(
    lens: AbstractLens, camera: Camera, key: Camera, matrices: Float[Array, "m 4 4"]
) -> tuple[Float[Array, "_ 2"], Float[Array, "_ 2"], Float[Array, "_ 2"]]:
    real = camera.principal_point.dtype
    angle = np.arange(_RIM) * (2 * np.pi / _RIM)
    rim = jnp.asarray(np.stack([np.cos(angle), np.sin(angle)], axis=-1), dtype=real)
    steps = np.linspace(0.0, 1.0, _FILM)
    places = np.stack(np.meshgrid(steps * camera.width, steps * camera.height), axis=-1)
    film = jnp.asarray(places.reshape(-1, 2), dtype=real)

    def one(matrix: Array, film: Array, pupil: Array) -> tuple[Array, Array, Array]:
        moved = moved_ray(lens.ray(camera, film, pupil), camera, key, matrix)[0]
        return moved.a, moved.b, film

    over = jax.vmap(jax.vmap(jax.vmap(one, (None, None, 0)), (None, 0, None)), (0, None, None))
    found = over(matrices[:, :3].astype(real), film, rim)
    a, b, film = (part.reshape(-1, 2) for part in found)
    return a, b, film


def _highest(offset: np.ndarray, slope: np.ndarray, nearest: float) -> np.ndarray:
    """The lines that are the highest ones somewhere between 0 and `nearest`, at no more than 32 places."""
    # Between two places where each is the highest, another may be higher by what little the slack allows for.
    places = np.linspace(0.0, nearest, _LINES)
    return np.unique([int(np.argmax(offset + slope * place)) for place in places])
