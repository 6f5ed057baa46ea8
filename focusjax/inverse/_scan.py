"""Pictures through lenses of many foci and openings, and the lenses whose pictures come closest to a target.

Before a pixel p a lens that is turned, or has a focal surface, is an upright lens focused at w_f(p). So
pictures of upright lenses, at some foci and openings, hold the pictures of all such lenses: at each pixel
the one is read that is focused there. What the target differs by is kept for tiles of pixels, so that any
number of lenses are compared by adding numbers up.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax._counts import later_seed
from focusjax.inverse._sight import nearest_in_sight, served_share
from focusjax.layers import Layers
from focusjax.lens import ThinLens, TiltShiftLens
from focusjax.trace import render

_RAYS = 8
_APART = 16
"""Between the seeds of the two pictures of a lens."""
_FOCI = 14
_OPENINGS = 5
_STOPS = 5.0
"""From the widest opening to the least that is tried."""
_WIDTH = 96
"""Least width in blocks that pictures are kept at."""
_TILE = 4
"""Edge of a tile in blocks."""
_BEYOND = 1.2
"""How much farther and nearer than the surfaces in sight the foci go, in disparity."""


class Scan(eqx.Module):
    """Pictures through upright lenses at f foci and r openings, twice each by different rays.

    The product of what two such pictures differ by from a target has no mean of their noise, which would
    speak for lenses that blur little.

    Attributes:
        focus: disparities in 1/m [f], increasing.
        radius: of the opening in metres [r], decreasing; one only where it is known.
        one: means over blocks of pixels [r, f, y, x, 3].
        other: likewise, by other rays.
        served: whether the layers hold the rays [r, f].
        block: edge of a block in pixels (static).
    """

    focus: Float[np.ndarray, " f"]
    radius: Float[np.ndarray, " r"]
    one: Float[np.ndarray, "r f y x 3"]
    other: Float[np.ndarray, "r f y x 3"]
    served: np.ndarray
    block: int = eqx.field(static=True)


def scan_lenses(
    layers: Layers,
    lens: ThinLens | TiltShiftLens,
    *,
    free: Sequence[str] = ("focus", "f_number"),
    seed: int = 0,
) -> Scan:
    """Pictures to compare any number of targets with: see `fit_image`, which makes its own if not given any.

    Args:
        layers: what targets show.
        lens: shape of the opening, and its radius if "f_number" is not in `free`.
        free: what a fit will look for.
        seed: chooses the rays.

    Raises:
        ValueError: nothing is in sight.

    Example:
        >>> scan = scan_lenses(layers, lens)  # doctest: +SKIP
        >>> fits = [fit_image(frame, layers, lens, scan=scan) for frame in film]  # doctest: +SKIP
    """
    seen = nearest_in_sight(layers)
    seen = seen[seen > 0]
    if not len(seen):
        raise ValueError("no surface is in sight, so that the picture is the same for any lens")
    camera = layers.camera
    focus = np.linspace(seen.min() / _BEYOND, seen.max() * _BEYOND, _FOCI)
    own = float(lens.aperture_radius)
    widest = float(layers.lens.parallax(camera) / camera.focal_px)
    radius = widest * 2.0 ** (-0.5 * _STOPS * np.linspace(0.0, 1.0, _OPENINGS))
    radius = radius if "f_number" in free else np.array([own])
    edge = max(1, camera.width // _WIDTH)
    real = layers.background.dtype
    pictures, served = [], []
    for opening in radius:
        for disparity in focus:
            tried = ThinLens(
                jnp.asarray(disparity, dtype=real), jnp.asarray(opening, dtype=real), lens.aperture
            )
            share = served_share(layers, tried)
            served.append(float(share) > 1.0 - 1e-5)
            tried = eqx.tree_at(lambda each: each.aperture_radius, tried, share * tried.aperture_radius)
            pictures.append(
                [
                    _means(
                        np.asarray(render(layers, tried, rays=_RAYS, even=True, seed=later_seed(seed, k))),
                        edge,
                    )
                    for k in (0, _APART)
                ]
            )
    shape = (len(radius), len(focus))
    both = np.asarray(pictures)
    one, other = (both[:, k].reshape(*shape, *both.shape[2:]) for k in (0, 1))
    return Scan(focus, radius, one, other, np.array(served).reshape(shape), edge)


def check_scan(scan: Scan, layers: Layers, free: Sequence[str]) -> None:
    """Refuse a scan that cannot be of these layers, or is of one opening where that is to be found.

    Raises:
        ValueError: so it is.
    """
    camera, edge = layers.camera, scan.block
    expected, size = (camera.height // edge, camera.width // edge), scan.one.shape[2:4]
    if size != expected:
        raise ValueError(
            f"the scan's pictures are of {size[1]} x {size[0]} blocks but the layers make"
            f" {expected[1]} x {expected[0]}; use scan_lenses with these layers"
        )
    if "f_number" in free and len(scan.radius) == 1:
        raise ValueError("the scan is of one opening but f_number is free; give scan_lenses the same free")


class Compared:
    """A target beside the pictures of a scan, tile by tile.

    With a gain g a picture P differs from the target T by the sum of w (g P - T)^2 = g^2 pp - 2 g pt + tt.

    Attributes:
        pp: [r, f, y, x] over tiles.
        pt: likewise.
        tt: sum over all tiles.
        middles: of the tiles [y, x, 2] in pixels.
    """

    def __init__(self, scan: Scan, target: np.ndarray, weight: np.ndarray) -> None:
        edge, tile = scan.block, _TILE
        counts = _means((weight > 0).astype(float), edge) > 1.0 - 1e-6
        variance = _means(1.0 / np.where(weight > 0, weight, 1.0), edge)
        w = np.where(counts, 1.0 / variance, 0.0)
        like = _means(target, edge)
        self._scan = scan
        self.tt = float((w * like**2).sum())
        self.pp = _sums(w * scan.one * scan.other, tile)
        self.pt = _sums(0.5 * w * (scan.one + scan.other) * like, tile)
        rows, columns = self.pp.shape[2:]
        y, x = np.meshgrid(np.arange(rows) + 0.5, np.arange(columns) + 0.5, indexing="ij")
        self.middles = np.stack([x, y], axis=-1) * edge * tile
        blocked = ~scan.served[..., None, None]
        self.pp = np.where(blocked, 4.0 * self.tt, self.pp)

    def cost(
        self, focus: Float[np.ndarray, "*n y x"], radius: Float[np.ndarray, "*n"], *, gain: float | None
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Sums of squares of lenses focused at `focus` in each tile, and the gains that make them least.

        `gain` is that of all where it is known.
        """
        scan = self._scan
        f = np.clip(np.interp(focus, scan.focus, np.arange(len(scan.focus))), 0, len(scan.focus) - 1)
        stops = np.interp(-np.log(radius), -np.log(scan.radius), np.arange(len(scan.radius)))
        r = np.broadcast_to(stops[..., None, None], f.shape)
        y, x = np.indices(self.pp.shape[2:])
        pp = pt = 0.0
        for (r0, u), (f0, v) in (
            (a, b) for a in _ends(r, len(scan.radius)) for b in _ends(f, len(scan.focus))
        ):
            pp = pp + u * v * self.pp[r0, f0, y, x]
            pt = pt + u * v * self.pt[r0, f0, y, x]
        pp, pt = (np.asarray(a).sum(axis=(-1, -2)) for a in (pp, pt))
        gains = np.maximum(pt / np.maximum(pp, 1e-30), 1e-6) if gain is None else np.full(pp.shape, gain)
        return np.asarray(gains**2 * pp - 2.0 * gains * pt + self.tt), np.asarray(gains)


def _ends(place: np.ndarray, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Whole places beside fractional ones, and the share of each."""
    low = np.minimum(place.astype(int), max(count - 2, 0))
    high = np.minimum(low + 1, count - 1)
    return [(low, 1.0 - (place - low)), (high, place - low)]


def _means(values: np.ndarray, edge: int) -> np.ndarray:
    """Over blocks of `edge` x `edge` pixels [h, w, 3]; what does not fill a block is left out."""
    high, wide = values.shape[0] // edge, values.shape[1] // edge
    cut = values[: high * edge, : wide * edge]
    return cut.reshape(high, edge, wide, edge, -1).mean(axis=(1, 3))


def _sums(values: Float[np.ndarray, "r f y x 3"], tile: int) -> Float[np.ndarray, "r f ty tx"]:
    """Over tiles and colours; the last tiles are filled up with nothing."""
    r, f, y, x, c = values.shape
    room = ((0, 0), (0, 0), (0, -y % tile), (0, -x % tile), (0, 0))
    padded = np.pad(values, room)
    high, wide = padded.shape[2] // tile, padded.shape[3] // tile
    return padded.reshape(r, f, high, tile, wide, tile, c).sum(axis=(3, 5, 6))
