"""The focus that makes a part of the picture sharpest, by contrast."""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from focusjax._counts import later_seed, require_counts, require_seed
from focusjax._programs import jit
from focusjax.geometry import Camera
from focusjax.inverse._sight import nearest_in_sight
from focusjax.inverse._target import checked_mask
from focusjax.layers import Layers
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.trace import check_reach, render, widest_opening

_Lens = TypeVar("_Lens", bound=ThinLens | TiltShiftLens)

_SCANNED = 25
_SCAN_RAYS = 16
_APART = 8
"""Between the seeds of two pictures, whose noise must not be the same."""
_BEYOND = 0.1
"""Share of the region's range of disparities by which the scan goes beyond it."""
_PRECISION = 1e-3
"""Of a step of the scan."""
_FLAT = 1e-6
"""Mean square of the differences between neighbours over that of the picture, below which there are none."""


def autofocus(
    layers: Layers,
    lens: _Lens,
    region: ArrayLike | Sequence[int],
    *,
    rays: int = 64,
    seed: int = 0,
) -> _Lens:
    """`lens` focused so that a region of its picture has the most contrast; a plane keeps its lean.

    Contrast is the sum of squares of the differences between neighbouring pixels of the region. It is taken
    as the product of two pictures of different rays, in which noise, which is largest where blur is, has no
    mean. First a scan with few rays over the disparities in the region; then the zero of the contrast's
    derivative by the focus, with all that silhouettes do to it (`render`), next to the best.

    A region of several things at different distances has several maxima; the highest is taken.

    Args:
        layers: peeled for `lens` at every focus in question; see `widest_lens`. What their rays do not
            reach is not tried.
        lens: whose focus is to change.
        region: mask [h, w] of the pixels that count, or left, top, width and height of a box in pixels.
        rays: rays per pixel of each of the two pictures.
        seed: chooses the rays.

    Raises:
        ValueError: a region without surfaces, without neighbours, or of one colour at any focus; layers that
            hold the rays of no focus on the region; a pinhole.

    Example:
        >>> sharp = autofocus(layers, lens, (120, 80, 32, 32))  # doctest: +SKIP
    """
    require_counts(rays=rays)
    seed = require_seed(seed)
    if not isinstance(lens, ThinLens | TiltShiftLens):
        raise ValueError(f"lens is a {type(lens).__name__}; expected a ThinLens or a TiltShiftLens")
    if not float(lens.aperture_radius) > 0:
        raise ValueError("the lens is a pinhole, whose picture is the same at any focus; open its aperture")
    counts = region_mask(region, layers.camera)
    if not (counts[:, 1:] & counts[:, :-1]).any() and not (counts[1:] & counts[:-1]).any():
        raise ValueError("the region has no two pixels side by side; contrast takes more than one")
    seen = nearest_in_sight(layers)[counts]
    seen = seen[seen > 0]
    if not len(seen):
        raise ValueError("there is no surface in the region to focus on")
    mask = jnp.asarray(counts)
    scan = _scan(layers, lens, float(seen.min()), float(seen.max()))
    contrasts = []
    for focus in scan:
        one, other = (
            render(
                layers, _focused(lens, focus), rays=min(rays, _SCAN_RAYS), even=True, seed=later_seed(seed, k)
            )
            for k in (0, _APART)
        )
        light = float(jnp.where(mask[..., None], one * other, 0.0).sum())
        contrasts.append(float(_contrast(one, other, mask)) / light if light > 0 else 0.0)
    best = int(np.argmax(contrasts))
    if not contrasts[best] > _FLAT:
        raise ValueError("the region has no contrast at any focus; choose one that holds edges or texture")

    def slope(focus: float) -> float:
        at = jnp.asarray(focus, dtype=scan.dtype)
        other = render(layers, _focused(lens, at), rays=rays, even=True, seed=later_seed(seed, _APART))
        return float(_slope(layers, lens, at, other, mask, rays=rays, seed=seed))

    low, high = (float(scan[min(max(best + k, 0), len(scan) - 1)]) for k in (-1, 1))
    found = float(scan[best])
    if slope(low) > 0 > slope(high):
        from scipy.optimize import root_scalar

        found = float(root_scalar(slope, bracket=(low, high), xtol=_PRECISION * (high - low)).root)
    answer = _focused(lens, jnp.asarray(found, dtype=lens.focus_disparity.dtype))
    check_reach(layers, answer)
    return answer


def region_mask(region: ArrayLike | Sequence[int], camera: Camera) -> Bool[np.ndarray, "h w"]:
    """The pixels of a box (left, top, width, height) or mask.

    Raises:
        ValueError: a box that is not within the frame, or a mask of another size or empty.
    """
    box = np.asarray(region)
    if box.ndim != 1:
        return checked_mask(box, camera)
    if box.shape != (4,) or not np.issubdtype(box.dtype, np.integer):
        raise ValueError(f"region is {box.tolist()}; expected left, top, width and height in whole pixels")
    left, top, width, height = (int(v) for v in box)
    inside = left >= 0 and top >= 0 and left + width <= camera.width and top + height <= camera.height
    if not (inside and width > 0 and height > 0):
        raise ValueError(
            f"region is {box.tolist()} (left, top, width, height); expected a box within the"
            f" {camera.width} x {camera.height} picture"
        )
    mask = np.zeros((camera.height, camera.width), dtype=bool)
    mask[top : top + height, left : left + width] = True
    return mask


def _scan(layers: Layers, lens: ThinLens | TiltShiftLens, least: float, largest: float) -> Array:
    """Focus disparities to try, of those that the layers serve.

    Raises:
        ValueError: they serve none.
    """
    # Surfaces at one disparity are sharp there; a step as wide as a hundredth of it is still seen.
    beyond = max(_BEYOND * (largest - least), 0.02 * largest)
    real = layers.background.dtype
    scan = jnp.linspace(max(least - beyond, 0.0), largest + beyond, _SCANNED, dtype=real)
    share = _widest_openings(layers, lens, scan)
    scan = scan[np.asarray(share) > 1.0 - 1e-6]
    if not len(scan):
        raise ValueError(
            "rays of the lens leave what the layers were peeled for at every focus on the region; peel for"
            " widest_lens(...)"
        )
    return scan


@jit
def _widest_openings(
    layers: Layers, lens: ThinLens | TiltShiftLens, scan: Float[Array, " n"]
) -> Float[Array, " n"]:
    return jax.vmap(lambda focus: widest_opening(layers, _focused(lens, focus)))(scan)


def _focused(lens: _Lens, focus: Float[Array, ""]) -> _Lens:
    if isinstance(lens, ThinLens):
        return eqx.tree_at(lambda each: each.focus_disparity, lens, focus)
    return eqx.tree_at(lambda each: each.plane, lens, lens.plane.at[2].set(focus))


def _contrast(
    one: Float[Array, "h w 3"], other: Float[Array, "h w 3"], mask: Bool[Array, "h w"]
) -> Float[Array, ""]:
    """Sum over the mask of the product of two pictures' differences between neighbours."""
    across, down = mask[:, 1:] & mask[:, :-1], mask[1:] & mask[:-1]
    changes = jnp.where(across[..., None], jnp.diff(one, axis=1) * jnp.diff(other, axis=1), 0.0).sum()
    return changes + jnp.where(down[..., None], jnp.diff(one, axis=0) * jnp.diff(other, axis=0), 0.0).sum()


@jit
def _slope(
    layers: Layers,
    lens: ThinLens | TiltShiftLens,
    focus: Float[Array, ""],
    other: Float[Array, "h w 3"],
    mask: Bool[Array, "h w"],
    *,
    rays: int,
    seed: int,
) -> Float[Array, ""]:
    """Half the contrast's derivative by the focus: the change of one picture times another of other rays."""

    def contrast(at: Float[Array, ""]) -> Float[Array, ""]:
        picture = render(layers, _focused(lens, at), even=True, rays=rays, seed=seed)
        return _contrast(picture, other, mask)

    return jax.jvp(contrast, (focus,), (jnp.ones_like(focus),))[1]
