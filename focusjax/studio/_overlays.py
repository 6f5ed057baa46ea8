"""Maps over the picture, and pictures as bytes for a browser."""

import io
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

_WIDEST = 1600
"""Pixels of a picture that is sent; wider ones are made smaller."""
_QUALITY = 92
_BEHIND, _BEFORE = np.array([230, 126, 34]), np.array([52, 120, 246])
"""Orange behind the focus and blue before it, which most colour-blind people can distinguish."""
_SHARP = np.array([255, 255, 255])
_FULL_PX = 24.0
"""Blur in pixels from which on the blur map is as strong as it gets."""

Rgba = UInt8[np.ndarray, "h w 4"]


def jpeg(pixels: UInt8[np.ndarray, "h w 3"], size: tuple[int, int]) -> bytes:
    """The picture as JPEG of `size` (width, height), so that a draft lies where the refined one will."""
    return _encoded(pixels, size, Image.Resampling.BICUBIC, format="JPEG", quality=_QUALITY, subsampling=0)


def webp(pixels: Rgba, size: tuple[int, int]) -> bytes:
    """A map that the picture shows through, as WebP of `size`."""
    return _encoded(pixels, size, Image.Resampling.NEAREST, format="WEBP", quality=80, method=0)


def _encoded(
    pixels: UInt8[np.ndarray, "h w c"], size: tuple[int, int], how: Image.Resampling, **options: Any
) -> bytes:
    image = Image.fromarray(pixels)
    if image.size != size:
        image = image.resize(size, how)
    stream = io.BytesIO()
    image.save(stream, **options)
    return stream.getvalue()


def shown_size(resolution: tuple[int, int]) -> tuple[int, int]:
    """Width and height in which pictures of a config's `resolution` are sent."""
    width, height = resolution
    scale = min(1.0, _WIDEST / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def blur_overlay(blur: Float[np.ndarray, "h w"], circle_px: float) -> Rgba:
    """Signed blur: orange behind the focus, blue before it, stronger the more; the zone of focus in white.

    Args:
        blur: signed diameter in pixels, positive behind the focus.
        circle_px: circle of confusion in pixels, within which all is sharp. Its zone is hatched, so that it
            shows without colours, too.
    """
    size = np.abs(blur)
    strength = np.sqrt(np.clip(size / _FULL_PX, 0.0, 1.0))
    colour = np.where((blur > 0)[..., None], _BEHIND, _BEFORE)
    alpha = 30 + 170 * strength
    rows, columns = np.indices(blur.shape)
    sharp = size <= circle_px
    colour = np.where(sharp[..., None], _SHARP, colour)
    alpha = np.where(sharp, np.where((rows + columns) % 8 < 4, 130.0, 40.0), alpha)
    return np.concatenate([colour, alpha[..., None]], axis=-1).astype(np.uint8)


def depth_overlay(disparity: Float[np.ndarray, "h w"]) -> Rgba:
    """Near is bright and far is dark, evenly in disparity; the background is black."""
    largest = max(float(disparity.max(initial=0.0)), 1e-30)
    share = np.sqrt(disparity / largest)
    grey = np.round(255 * share)[..., None]
    return np.concatenate([grey, grey, grey, np.full_like(grey, 225.0)], axis=-1).astype(np.uint8)


_COUNTS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]])
"""Colours (viridis) for 1, 2, 3, 4 and more layers, brighter the more, so that they differ without hue."""


def layers_overlay(counts: Int[np.ndarray, "h w"]) -> Rgba:
    """How many surfaces, one behind the other, lens rays may meet at each pixel: dark blue 1 to yellow 5."""
    colour = _COUNTS[np.clip(counts, 1, len(_COUNTS)) - 1]
    alpha = np.where(counts > 0, 205, 40)[..., None]
    return np.concatenate([colour, alpha], axis=-1).astype(np.uint8)
