"""The focal surface of the lens that made a picture of a known scene."""

import dataclasses
import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from focusjax._arguments import require_switches
from focusjax._counts import require_counts, require_seed
from focusjax.geometry import Camera
from focusjax.inverse._coarse_to_fine import coarse_to_fine, rms
from focusjax.inverse._image_fit import Level, covariance
from focusjax.inverse._levels import Problem
from focusjax.inverse._scan import Compared, Scan, check_scan, scan_lenses
from focusjax.inverse._target import checked_mask, checked_target, weights
from focusjax.inverse._variables import RADIUS_SECANT, AbstractVariables, focus_secant
from focusjax.layers import Layers
from focusjax.lens import FocalSurface, FocalSurfaceLens, ThinLens, focal_surface_lens
from focusjax.trace import check_reach, widest_opening

_SPREAD = 0.15
"""Of the picture's width: how far around a control point its first value is looked for."""


class SurfaceVariables(AbstractVariables):
    """Control values, opening and gain of a lens with a focal surface, of which some are free.

    Settings are the focal disparity at each of k control points, the aperture radius, and the gain.

    Attributes:
        surface: places of the control points, and values to start from.
        camera: that the surface is sampled for.
        radius: of the opening, in metres; the widest one where it is free.
        lens: shape of the opening.
        nearest: largest focal disparity in 1/m.
        free: which of "f_number" and "gain" are free besides (static).
    """

    surface: FocalSurface
    camera: Camera
    radius: Float[Array, ""]
    lens: ThinLens
    nearest: Float[Array, ""]
    free: tuple[str, ...] = eqx.field(static=True)

    @property
    def columns(self) -> tuple[int, ...]:
        count = self.surface.xy.shape[0]
        more = (count + k for k, name in enumerate(("f_number", "gain")) if name in self.free)
        return (*range(count), *more)

    def settings(self, variables: Float[Array, " k"], layers: Layers) -> Float[Array, " p"]:
        count = self.surface.xy.shape[0]
        full = jnp.zeros(count + 2, dtype=variables.dtype).at[jnp.array(self.columns)].set(variables)
        focus = self.nearest * 0.5 * (1.0 + jnp.sin(full[:count]))
        share = 0.5 * (1.0 + jnp.sin(full[count])) if "f_number" in self.free else jnp.ones_like(full[0])
        wide = jnp.concatenate([focus, jnp.stack([self.radius, jnp.ones_like(self.radius)])])
        room = widest_opening(layers, self.lens_at(wide))
        return wide.at[count].multiply(share * room).at[count + 1].set(jnp.exp(full[count + 1]))

    def at(self, settings: Float[Array, " p"]) -> Float[Array, " k"]:
        """The variables of settings that the layers hold."""
        count = self.surface.xy.shape[0]
        upper = jnp.concatenate([jnp.full(count, self.nearest), self.radius[None]])
        turn = jnp.arcsin(2.0 * jnp.clip(settings[:-1] / upper, 0.02, 0.98) - 1.0)
        return jnp.append(turn, jnp.log(settings[-1]))[jnp.array(self.columns)]

    def secants(self, settings: Float[np.ndarray, " p"], camera: Camera) -> Float[np.ndarray, " p"]:
        out = np.full(len(settings), focus_secant(float(settings[-2]), camera))
        out[-2:] = RADIUS_SECANT * settings[-2], 0.05 * settings[-1]
        return out

    def within(self, settings: Float[np.ndarray, " p"], layers: Layers) -> Float[np.ndarray, " p"]:
        out = settings.copy()
        out[:-2] = np.clip(out[:-2], 0.0, float(self.nearest))
        widest = out.copy()
        widest[-2] = float(self.radius)
        lens = self.lens_at(jnp.asarray(widest, dtype=self.radius.dtype))
        room = float(self.radius) * float(widest_opening(layers, lens))
        out[-2:] = min(max(out[-2], 1e-3 * room), room), max(out[-1], 1e-6)
        return out

    def lens_at(self, settings: Float[Array, " p"]) -> FocalSurfaceLens:
        surface = eqx.tree_at(lambda each: each.focus_disparity, self.surface, settings[:-2])
        thin = eqx.tree_at(lambda each: each.aperture_radius, self.lens, settings[-2])
        return focal_surface_lens(surface, self.camera, thin)


@dataclasses.dataclass(frozen=True)
class SurfaceFit:
    """A focal surface that makes a picture like the target.

    Attributes:
        surface: the control points with the values found.
        lens: with that surface.
        gain: what its picture is to be multiplied by.
        picture: that picture [h, w, 3], times the gain.
        rms_error: root mean square of picture less target, over the values that count.
        standard_errors: of each control value [k] in 1/m, as for `ImageFit`; infinite where the picture
            shows nothing that depends on it.
        levels: how each level went, the last that of single pixels.
        converged: whether the last level ended because steps became small.
    """

    surface: FocalSurface
    lens: FocalSurfaceLens
    gain: float
    picture: Float[Array, "h w 3"]
    rms_error: float
    standard_errors: Float[np.ndarray, " k"]
    levels: tuple[Level, ...]
    converged: bool


def fit_focal_surface(
    target: ArrayLike,
    layers: Layers,
    lens: ThinLens,
    surface: FocalSurface,
    *,
    free: tuple[str, ...] = (),
    mask: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    robust: bool = False,
    scan: Scan | None = None,
    exact: Callable[[FocalSurfaceLens], ArrayLike] | None = None,
    rays: int = 64,
    seed: int = 0,
    max_steps: int = 16,
) -> SurfaceFit:
    """The values at the control points of a focal surface with which a picture of `layers` is like `target`.

    As `fit_image`, with a control value each in place of focus, tilt and swing. The first value at a control
    point is that of the upright lens whose picture is most like the target around it.

    Args:
        target: linear picture [h, w, 3] of the size of the layers' camera.
        layers: the known scene, peeled for `widest_lens(...)`.
        lens: shape of the opening, and its radius if "f_number" is not free. Its focus is not used.
        surface: places, kernel and basis of the control points; their values are not used.
        free: what to find besides, of "f_number" and "gain".
        mask: as for `fit_image`.
        noise: as for `fit_image`.
        robust: as for `fit_image`.
        scan: as for `fit_image`.
        exact: as for `fit_image`.
        rays: rays per pixel.
        seed: chooses the rays.
        max_steps: steps allowed on each level.

    Raises:
        ValueError: a target that `fit_image` refuses, or an unknown name in `free`.

    Example:
        >>> fit = fit_focal_surface(photograph, layers, lens, focal_surface(places, 0.5))  # doctest: +SKIP
    """
    require_counts(rays=rays, max_steps=max_steps)
    seed = require_seed(seed)
    require_switches(robust=robust)
    if not isinstance(lens, ThinLens):
        raise ValueError(
            f"lens is a {type(lens).__name__}; expected a ThinLens, for the shape of the opening"
        )
    if not isinstance(surface, FocalSurface):
        raise ValueError(f"surface is a {type(surface).__name__}; expected what `focal_surface` makes")
    if isinstance(free, str):
        raise ValueError(f"free is {free!r}; expected a tuple of names, such as ({free!r},)")
    unknown = [name for name in free if name not in ("f_number", "gain")]
    if unknown:
        raise ValueError(f"free has {unknown[0]!r}; expected some of ['f_number', 'gain']")
    picture = checked_target(target, layers.camera, mask)
    weight = weights(checked_mask(mask, layers.camera), noise, picture.shape)
    real = layers.background.dtype
    scan = scan_lenses(layers, lens, free=free, seed=seed) if scan is None else scan
    check_scan(scan, layers, free)
    widest = layers.lens.parallax(layers.camera) / layers.camera.focal_px
    surface, lens = jax.tree.map(lambda leaf: leaf.astype(real), (surface, lens))
    variables = SurfaceVariables(
        surface=surface,
        camera=layers.camera,
        radius=widest.astype(real) if "f_number" in free else lens.aperture_radius,
        lens=lens,
        nearest=jnp.asarray(scan.focus[-1], dtype=real),
        free=tuple(free),
    )
    like = jnp.asarray(picture, dtype=real)
    problem = Problem(layers, variables, like, jnp.asarray(weight, dtype=real), rays, seed)
    start = variables.at(_start(variables, Compared(scan, picture, weight), scan))
    found, last, levels = coarse_to_fine(
        problem,
        [(start, 0.0)],
        weight,
        max_steps,
        searched=True,
        even=noise is None,
        robust=robust,
        exact=exact,
    )
    spread, known = covariance(found, np.asarray(last.weight))
    count = surface.xy.shape[0]
    settings = jnp.asarray(found.settings, dtype=real)
    best = variables.lens_at(settings)
    check_reach(layers, best)
    return SurfaceFit(
        surface=eqx.tree_at(lambda each: each.focus_disparity, surface, settings[:count]),
        lens=best,
        gain=float(found.settings[-1]),
        picture=like + jnp.asarray(found.residual, dtype=real),
        rms_error=rms(found.residual, weight),
        standard_errors=np.where(known, np.sqrt(np.maximum(np.diag(spread), 0.0)), math.inf)[:count],
        levels=tuple(levels),
        converged=levels[-1].converged,
    )


def _start(variables: SurfaceVariables, compared: Compared, scan: Scan) -> Float[Array, " p"]:
    """The settings of the surface whose values are best around each control point alone."""
    xy = np.asarray(variables.surface.xy)
    wide = _SPREAD * variables.camera.width
    away = ((compared.middles[None] - xy[:, None, None]) ** 2).sum(axis=-1)
    near = np.exp(-0.5 * away / wide**2)
    gain = None if "gain" in variables.free else 1.0
    middles = jnp.asarray(np.moveaxis(compared.middles, -1, 0), dtype=variables.radius.dtype)
    best: tuple[float, np.ndarray] | None = None
    for number, radius in enumerate(scan.radius):
        # With the gain that suits the best single focus; what the surface adds to it is little.
        _, gains = compared.cost(
            np.broadcast_to(scan.focus[:, None, None], (len(scan.focus), *near.shape[1:])),
            np.full(len(scan.focus), radius),
            gain=gain,
        )
        g = gains[:, None, None]
        costs = np.einsum("kyx,fyx->kf", near, g**2 * compared.pp[number] - 2.0 * g * compared.pt[number])
        values = scan.focus[np.argmin(costs, axis=1)]
        moved = eqx.tree_at(
            lambda each: each.focus_disparity,
            variables.surface,
            jnp.asarray(values, dtype=variables.radius.dtype),
        )
        cost, gains = compared.cost(np.asarray(moved.at(middles)[0]), np.asarray(radius), gain=gain)
        if best is None or float(cost) < best[0]:
            best = float(cost), np.array([*values, radius, float(gains)])
    assert best is not None
    return jnp.asarray(best[1], dtype=variables.radius.dtype)
