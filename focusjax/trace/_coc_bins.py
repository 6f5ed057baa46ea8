"""Circle-of-confusion bins: rays sorted by how blurred what they meet is, before the focal zone or behind.

At disparity w the rays of a film point pass q(v) = a(v) + w b(v), with v the point of the opening, so that
what is small about v is magnified by the Jacobian J(w) = A + w B of a and b by v. Where det J(w) = 0 light is
focused to a line at least: a caustic. For an ideal lens all v have one such w, the focus; spherical
aberration spreads them, and astigmatism makes two of each. Between the least and the largest root, over all v
and colours, lies the focal zone. Where A and B share their axes, as they do but for what small skewness adds,
the least magnification at w is then

    sigma_min(J(w)) >= sigma_min(B) |w - nearest root|,

pixels per aperture radius: no detail finer than that, times the finest detail of the opening, is in the
picture of anything at w. This is the bandwidth of a defocused light field (Soler et al. 2009, Fourier Depth
of Field), measured on the rays themselves and so the same for every lens.

Edges of bins are octaves of the blur's radius in pixels, the same for every lens, so that a lens that moves
needs no other program. Rays of each bin are summed for themselves, as `focusjax.trace._denoise` asks for.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.trace._frame_nodes import frame_nodes

_RINGS = (0.35, 0.7, 0.98)
_SPOKES = 8
LEAST_BLUR = 2.0
"""Radius in pixels: what is less blurred is left as its rays have it."""
_OCTAVES = 4


class FocalZone(eqx.Module):
    """The focal zone of each pixel, row-major.

    Attributes:
        near: its largest disparity [p].
        far: its least one [p].
        parallax: least blur per dioptre beyond it [p], as a radius in pixels.
    """

    near: Float[Array, " p"]
    far: Float[Array, " p"]
    parallax: Float[Array, " p"]

    def reach(self, blur: float) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
        """Disparities nearer and farther than which all is blurred by more than a radius in pixels."""
        depth = blur / jnp.maximum(self.parallax, 1e-30)
        return self.near + depth, self.far - depth


@jit
def focal_zone(lens: AbstractLens, camera: Camera) -> FocalZone:
    """The focal zone of a lens, found at few places of the frame.

    It is as much larger as splines through fewer of them are off.
    """
    nodes = frame_nodes(camera)
    colours = [channel.lens for channel in lens.channels()] or [lens]
    found = jnp.stack([nodes.at_all(lambda film, of=of: _zone_at(of, camera, film)) for of in colours])
    near, far, parallax = found[..., 0].max(axis=0), found[..., 1].min(axis=0), found[..., 2].min(axis=0)
    values = jnp.stack([near, far, parallax], axis=1)
    off = nodes.in_pixels(nodes.off(values, 1), 1)
    near, far, parallax = (nodes.in_pixels(values, 1) + off * jnp.array([[1, -1, -1]], dtype=off.dtype)).T
    return FocalZone(near, far, jnp.maximum(parallax, 0.0))


def _zone_at(lens: AbstractLens, camera: Camera, film: Float[Array, "2"]) -> Float[Array, "3"]:
    """Largest and least disparity of a caustic, and least blur per dioptre, at one film point."""
    opening = lens.opening()
    angle = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    rings = [np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1) for radius in _RINGS]
    points = jnp.asarray(np.concatenate([np.zeros((1, 2)), *rings]), dtype=film.dtype)

    def at(point: Float[Array, "2"]) -> tuple[Array, Array, Array, Array]:
        def both(point: Float[Array, "2"]) -> tuple[Array, Array]:
            ray = lens.ray(camera, film, point)
            return jnp.stack([ray.a, ray.b]), ray.weight

        (a, b), weight = jax.jacfwd(both, has_aux=True)(point)
        square = _det(b)
        linear = a[0, 0] * b[1, 1] + b[0, 0] * a[1, 1] - a[0, 1] * b[1, 0] - b[0, 1] * a[1, 0]
        safe = jnp.where(square == 0, 1.0, square)
        middle = -0.5 * linear / safe
        apart = jnp.sqrt(jnp.maximum(middle**2 - _det(a) / safe, 0.0))
        return middle + apart, middle - apart, _least_stretch(b), (weight > 0) & (square != 0)

    near, far, stretch, passes = jax.vmap(at)(points)
    none = ~passes.any()
    near = jnp.where(none, 0.0, jnp.where(passes, near, -jnp.inf).max())
    far = jnp.where(none, 0.0, jnp.where(passes, far, jnp.inf).min())
    parallax = jnp.where(none, 0.0, jnp.where(passes, stretch, jnp.inf).min())
    return jnp.stack([near, far, parallax * opening.finest()])


def _det(m: Float[Array, "2 2"]) -> Float[Array, ""]:
    return m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]


def _least_stretch(m: Float[Array, "2 2"]) -> Float[Array, ""]:
    """The smaller singular value: |det| over the larger."""
    half = 0.5 * (m**2).sum()
    larger = jnp.sqrt(half + jnp.sqrt(jnp.maximum(half**2 - _det(m) ** 2, 0.0)))
    return jnp.abs(_det(m)) / jnp.where(larger > 0, larger, 1.0)


class CocBins(eqx.Module):
    """Bins from near to far: before the zone by decreasing blur, the zone, behind it by increasing blur.

    Attributes:
        zone: the focal zone of each pixel; None for one bin that holds all rays.
    """

    zone: FocalZone | None

    @property
    def least(self) -> tuple[float, ...]:
        """Least radius in pixels of the blur in each bin; 0 in the focal zone."""
        if self.zone is None:
            return (0.0,)
        edges = [LEAST_BLUR * 2.0**k for k in range(_OCTAVES)]
        return (*reversed(edges), 0.0, *edges)

    def of(self, pixel: Int[Array, " g"], disparity: Float[Array, "s g"]) -> Int[Array, "s g"]:
        """The bin of what some rays of each of some pixels meet."""
        if self.zone is None:
            return jnp.zeros(disparity.shape, dtype=jnp.int32)
        near, far, parallax = (
            plane.at[pixel].get(mode="clip")[None]
            for plane in (self.zone.near, self.zone.far, self.zone.parallax)
        )

        def octave(depth: Float[Array, "s g"]) -> Int[Array, "s g"]:
            """0 within the zone, 1 from the least blur on, one more for each time that it doubles."""
            blur = parallax * depth
            reached = [(blur >= LEAST_BLUR * 2.0**k).astype(jnp.int32) for k in range(_OCTAVES)]
            return functools.reduce(jnp.add, reached)

        return _OCTAVES - octave(disparity - near) + octave(far - disparity)
