"""What may change of a lens to fit a picture, as one vector without bounds, and back.

A setting in a box is lower + (upper - lower) (1 + sin u) / 2 with u any number, as MINUIT has it (James and
Roos 1975): smooth, and bounds are reached, at finite u, where the slope is zero. The opening's box ends where
the layers end (`trace.widest_opening`), which may depend on the focus; gain is exp u.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from focusjax.geometry import Camera
from focusjax.inverse._sight import nearest_in_sight
from focusjax.layers import Layers
from focusjax.lens import AbstractLens, ThinLens, TiltShiftLens, as_tilt_shift, view_tangents
from focusjax.trace import widest_opening

PARAMETERS = ("focus", "f_number", "tilt", "swing", "gain")
"""What can be solved for, in the order of the settings."""

FOCUS, RADIUS, TILT, SWING, GAIN = range(5)

_SECANT_PX = 0.2
"""Half the length of secants by focus, in pixels of blur."""
RADIUS_SECANT = 0.06
"""Of secants by the opening, as a share of its radius."""
MOST_TILT = math.radians(45.0)
_NEARER = 1.25
"""How much nearer than the nearest surface in sight, in disparity, the focus may be."""
_AT_LIMIT = 1e-3
"""Share of the box from its ends within which a setting is said to be at its limit."""


class AbstractVariables(eqx.Module):
    """Some settings [p] of a lens, the last of them the gain, that are free: variables [k] without bounds."""

    @property
    @abc.abstractmethod
    def columns(self) -> tuple[int, ...]:
        """Positions of the free settings among all."""

    @abc.abstractmethod
    def settings(self, variables: Float[Array, " k"], layers: Layers) -> Float[Array, " p"]:
        """The settings, within their box and within what `layers` hold."""

    @abc.abstractmethod
    def lens_at(self, settings: Float[Array, " p"]) -> AbstractLens:
        """The lens of given settings."""

    @abc.abstractmethod
    def secants(self, settings: Float[np.ndarray, " p"], camera: Camera) -> Float[np.ndarray, " p"]:
        """How far each setting may move for blur to change by a part of a pixel."""

    @abc.abstractmethod
    def within(self, settings: Float[np.ndarray, " p"], layers: Layers) -> Float[np.ndarray, " p"]:
        """The nearest settings in the box, with an opening that `layers` serve."""


class Variables(AbstractVariables):
    """The free settings of a lens before a camera, and their box.

    Settings are (focus disparity, aperture radius, n_y, n_x, gain), n of the plane in focus in 1/m.

    Attributes:
        lens: where to start, and the values of what is not free.
        gain: of the picture; where to start.
        lower: least settings [5]; of the opening, as a share of the widest; of the gain, not used.
        upper: largest settings [5], likewise.
        free: parameters to solve for, in the order of `PARAMETERS` (static).
    """

    lens: ThinLens | TiltShiftLens
    gain: Float[Array, ""]
    lower: Float[Array, "5"]
    upper: Float[Array, "5"]
    free: tuple[str, ...] = eqx.field(static=True)

    @property
    def columns(self) -> tuple[int, ...]:
        """Positions of the free parameters among the settings."""
        return tuple(PARAMETERS.index(name) for name in self.free)

    def start(self, layers: Layers) -> Float[Array, " k"]:
        """The variables of the lens to start from."""
        return self.at(settings_of(self.lens, self.gain), layers)

    def at(self, settings: Float[Array, "5"], layers: Layers) -> Float[Array, " k"]:
        """The variables of given settings, moved off the ends of the box, where slopes are 0."""
        share = settings.at[RADIUS].divide(self._room(settings, layers))
        share = (share - self.lower) / (self.upper - self.lower)
        turn = jnp.arcsin(2.0 * jnp.clip(share, 0.02, 0.98) - 1.0)
        return turn.at[GAIN].set(jnp.log(settings[GAIN]))[jnp.array(self.columns)]

    def settings(self, variables: Float[Array, " k"], layers: Layers) -> Float[Array, "5"]:
        """The settings [5], within the box and within what `layers` hold."""
        turn = jnp.zeros(5, dtype=variables.dtype).at[jnp.array(self.columns)].set(variables)
        inside = self.lower + (self.upper - self.lower) * 0.5 * (1.0 + jnp.sin(turn))
        moved = inside.at[GAIN].set(jnp.exp(turn[GAIN]))
        free = np.isin(np.arange(5), self.columns)
        settings = jnp.where(free, moved, settings_of(self.lens, self.gain))
        room = self._room(settings, layers)
        radius = room * settings[RADIUS] if free[RADIUS] else jnp.minimum(settings[RADIUS], room)
        return settings.at[RADIUS].set(radius)

    def lens_at(self, settings: Float[Array, "5"]) -> ThinLens | TiltShiftLens:
        """The lens of given settings."""
        if isinstance(self.lens, ThinLens):
            return ThinLens(settings[FOCUS], settings[RADIUS], self.lens.aperture)
        plane = settings[jnp.array([SWING, TILT, FOCUS])]
        return TiltShiftLens(plane, settings[RADIUS], self.lens.aperture)

    def secants(self, settings: Float[np.ndarray, " p"], camera: Camera) -> Float[np.ndarray, " p"]:
        focus = focus_secant(float(settings[RADIUS]), camera)
        wide, high = _edges(camera)
        return np.array(
            [focus, RADIUS_SECANT * settings[RADIUS], focus / high, focus / wide, 0.05 * settings[GAIN]]
        )

    def within(self, settings: Float[np.ndarray, " p"], layers: Layers) -> Float[np.ndarray, " p"]:
        out, columns = settings.copy(), [c for c in self.columns if c not in (RADIUS, GAIN)]
        out[columns] = np.clip(settings, np.asarray(self.lower), np.asarray(self.upper))[columns]
        room = float(self._room(jnp.asarray(out, dtype=self.lower.dtype), layers))
        least = 1e-3 * room if RADIUS in self.columns else 0.0
        out[RADIUS] = min(max(out[RADIUS], least), room)
        out[GAIN] = max(out[GAIN], 1e-6)
        return out

    def at_limits(self, settings: Float[Array, "5"], layers: Layers) -> Bool[np.ndarray, " k"]:
        """Which of the free settings are at an end of their box."""
        share = settings.at[RADIUS].divide(self._room(settings, layers))
        share = np.asarray((share - self.lower) / (self.upper - self.lower))
        return ((np.abs(share - 0.5) > 0.5 - _AT_LIMIT) & (np.arange(5) != GAIN))[np.array(self.columns)]

    def _room(self, settings: Float[Array, "5"], layers: Layers) -> Float[Array, ""]:
        """The radius of the widest opening that layers serve, focused as the settings have it."""
        most = layers.lens.parallax(layers.camera) / layers.camera.focal_px
        widest = settings.at[RADIUS].set(most)
        return most * widest_opening(layers, self.lens_at(widest))


def focus_secant(radius: float, camera: Camera) -> float:
    """Change of focus disparity that changes blur by `_SECANT_PX`; less for a nearly closed lens."""
    return _SECANT_PX / (2.0 * max(radius * float(camera.focal_px), 0.1))


def _edges(camera: Camera) -> tuple[float, float]:
    """Tangents of the view at the frame's sides, and at its top or bottom, whichever is larger."""
    ends = jnp.array([(0.0, 0.0), (camera.width, camera.height)], dtype=camera.focal_px.dtype)
    wide, high = np.abs(np.asarray(jax.vmap(lambda p: view_tangents(camera, p))(ends))).max(axis=0)
    return float(wide), float(high)


def settings_of(lens: ThinLens | TiltShiftLens, gain: Float[Array, ""]) -> Float[Array, "5"]:
    """Focus disparity, aperture radius, n_y, n_x and gain."""
    across = lens.plane[:2] if isinstance(lens, TiltShiftLens) else jnp.zeros(2, dtype=gain.dtype)
    parts = (lens.focus_disparity, lens.aperture_radius, across[1], across[0], gain)
    return jnp.stack([part.astype(gain.dtype) for part in parts])


def in_order(free: tuple[str, ...]) -> tuple[str, ...]:
    """The names in the order of the settings, each once.

    Raises:
        ValueError: none, or an unknown one.
    """
    if isinstance(free, str):
        raise ValueError(f"free is {free!r}; expected a tuple of names, such as ({free!r},)")
    unknown = [name for name in free if name not in PARAMETERS]
    if unknown:
        raise ValueError(f"free has {unknown[0]!r}; expected some of {list(PARAMETERS)}")
    if not free:
        raise ValueError(f"no parameter is free; give some of {list(PARAMETERS)}")
    return tuple(name for name in PARAMETERS if name in free)


def make_variables(
    layers: Layers,
    lens: ThinLens | TiltShiftLens,
    free: tuple[str, ...],
    min_focus_distance: float | None,
    like: Float[Array, "h w 3"],
) -> Variables:
    """The variables of a fit to a picture `like` in number type.

    The focus may be from infinity to a little nearer than the nearest surface in sight, or to
    `min_focus_distance`; the plane may lean as far as it takes to be at infinity on one side of the frame
    and nearest on the other, or by 45 degrees.

    Raises:
        ValueError: nothing is in sight, or the least distance is not a positive length.
    """
    real = like.dtype
    if {"tilt", "swing"} & set(free):
        lens = as_tilt_shift(lens)
    lens = jax.tree.map(lambda leaf: leaf.astype(real), lens)
    if min_focus_distance is None:
        nearest = _NEARER * float(nearest_in_sight(layers).max())
        if not nearest > 0:
            raise ValueError("no surface is in sight, so that the picture is the same for any lens")
    elif not 0 < min_focus_distance < math.inf:
        raise ValueError(f"min_focus_distance is {min_focus_distance} m; expected a positive length")
    else:
        nearest = 1.0 / min_focus_distance
    camera = layers.camera
    wide, high = _edges(camera)
    most = math.sin(MOST_TILT) / math.sqrt(2.0) / float(camera.focal_length)
    swing, tilt = (min(most, nearest / edge) for edge in (wide, high))
    upper = jnp.array([nearest, 1.0, tilt, swing, 1.0], dtype=real)
    lower = jnp.array([0.0, 0.0, -tilt, -swing, 0.0], dtype=real)
    return Variables(lens=lens, gain=jnp.ones((), dtype=real), lower=lower, upper=upper, free=free)
