"""A depth map on the pixels of its photograph: enlarged, holes filled, edges moved to those of the colours.

A weighted median (Ma, He, Wei, Zhang and Wu 2013) over measured pixels around p, at places q of a disk, with
weights

    exp(-|I_p - I_q|^2 / (2 sigma^2)) / (1 + (g_q / t)^2),

colours I as they are shown and g the range of disparity around q against a threshold t. So a pixel on a ramp
between two depths takes the one of the side that it looks like, and ramps themselves have no say. Holes take
theirs from disks as wide as the hole. Elsewhere the map stays as it was measured.
"""

import numpy as np
import scipy
from jaxtyping import Bool, Float

_SIGMA = 0.06
"""Difference of colours, 0 to 1, that counts as another surface."""
_EDGE = 0.04
"""Share of the map's range of disparity over which a step is an edge."""
_TAPS = 48
_AT_ONCE = 1 << 16
_GOLDEN = 2.399963229728653
_PASSES = 2


def aligned(
    disparity: Float[np.ndarray, "_ _"],
    known: Bool[np.ndarray, "_ _"],
    step: float,
    shown: Float[np.ndarray, "h w 3"],
    align_px: float,
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Disparity of every pixel of the photograph, and where it was measured.

    Args:
        disparity: 1/m, of any size.
        known: where it is measured.
        step: smallest difference of disparity that the map resolves.
        shown: the photograph's values as they are shown.
        align_px: pixels of the depth map by which its edges may lie off; 0 to leave them.
    """
    height, width = shown.shape[:2]
    scale = max(height / disparity.shape[0], 1.0)
    filled = nearest_known(disparity, known)
    depth, there = _enlarged(filled, known, (height, width))
    depth = depth.astype(np.float32)
    low, high = np.percentile(depth[there], [1, 99]) if there.any() else (0.0, 0.0)
    threshold = max(_EDGE * float(high - low), 2.5 * step, 1e-9)
    if not there.all():
        depth = _holes_filled(depth, there, shown, threshold)
    radius = align_px * scale
    for _ in range(_PASSES if radius > 0 else 0):
        wide = 2 * int(np.ceil(radius)) + 1
        spread = scipy.ndimage.maximum_filter(depth, wide) - scipy.ndimage.minimum_filter(depth, wide)
        near_edge = np.flatnonzero(spread.ravel() > threshold)
        reach = np.full(len(near_edge), 2.0 * radius + 1.0, dtype=np.float32)
        sources = np.ones_like(there)
        depth.reshape(-1)[near_edge] = _medians(near_edge, reach, depth, sources, shown, threshold)
    return depth, there


def nearest_known(values: np.ndarray, known: Bool[np.ndarray, "h w"]) -> np.ndarray:
    """Values [h, w, ...], each of the nearest place where they are known; as they are where none is."""
    if known.all() or not known.any():
        return values
    index = scipy.ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
    return values[*index]


def _enlarged(values: np.ndarray, known: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Bilinear values and nearest validity on another grid over the same picture."""
    if values.shape == shape:
        return values.copy(), known.copy()
    rows, columns = ((np.arange(n) + 0.5) * m / n - 0.5 for n, m in zip(shape, values.shape, strict=True))
    places = np.meshgrid(rows, columns, indexing="ij")
    depth = scipy.ndimage.map_coordinates(values, places, order=1, mode="nearest")
    row = np.clip(np.round(rows).astype(int), 0, values.shape[0] - 1)
    column = np.clip(np.round(columns).astype(int), 0, values.shape[1] - 1)
    return depth, known[np.ix_(row, column)]


def _holes_filled(depth: np.ndarray, there: np.ndarray, shown: np.ndarray, threshold: float) -> np.ndarray:
    """Holes by medians over disks that reach well past their borders."""
    away = scipy.ndimage.distance_transform_edt(~there)
    holes = np.flatnonzero(~there.ravel())
    reach = (1.5 * away.ravel()[holes] + 4.0).astype(np.float32)
    out = depth.copy()
    out.reshape(-1)[holes] = _medians(holes, reach, depth, there, shown, threshold)
    return out


def _medians(
    places: np.ndarray,
    reach: np.ndarray,
    depth: np.ndarray,
    sources: np.ndarray,
    shown: np.ndarray,
    threshold: float,
) -> np.ndarray:
    """Weighted medians around flat `places`, over disks of radius `reach`."""
    height, width = depth.shape
    range_ = scipy.ndimage.maximum_filter(depth, 3) - scipy.ndimage.minimum_filter(depth, 3)
    trust = (sources / (1.0 + (range_ / threshold) ** 2)).astype(np.float32).ravel()
    flat, colours = depth.ravel(), shown.reshape(-1, 3).astype(np.float32)
    k = np.arange(_TAPS)
    disk = np.sqrt((k + 0.5) / _TAPS)[:, None] * np.stack([np.cos(k * _GOLDEN), np.sin(k * _GOLDEN)], axis=1)
    out = np.empty(len(places), dtype=depth.dtype)
    for start in range(0, len(places), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        own, radius = places[part], reach[part][:, None]
        row, column = np.divmod(own, width)
        y = np.clip(np.round(row[:, None] + radius * disk[:, 1]), 0, height - 1).astype(np.intp)
        x = np.clip(np.round(column[:, None] + radius * disk[:, 0]), 0, width - 1).astype(np.intp)
        there = y * width + x
        apart = ((colours[there] - colours[own][:, None]) ** 2).sum(axis=2)
        weight = trust[there] * (np.exp(-apart / (2 * _SIGMA**2)) + 1e-6)
        values = flat[there]
        order = np.argsort(values, axis=1)
        values = np.take_along_axis(values, order, axis=1)
        total = np.cumsum(np.take_along_axis(weight, order, axis=1), axis=1)
        middle = (total < 0.5 * total[:, -1:]).sum(axis=1)
        chosen = np.take_along_axis(values, np.minimum(middle, _TAPS - 1)[:, None], axis=1)[:, 0]
        out[part] = np.where(total[:, -1] > 0, chosen, flat[own])
    return out
