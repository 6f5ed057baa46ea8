"""Noise taken out of a picture by Open Image Denoise, as users of path tracers do."""

import numpy as np
from jaxtyping import Float


def denoised(picture: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    """`picture` without its noise: Open Image Denoise for colours of any brightness, at its best quality.

    Args:
        picture: linear radiance, finite; negative values count as 0.

    Raises:
        ValueError: Open Image Denoise's Python binding is not installed.
    """
    try:
        import pyoidn  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise ValueError(
            "denoising needs Open Image Denoise, which is not installed; run `pip install pyoidn`"
        ) from error
    return np.asarray(pyoidn.denoise(np.maximum(picture, 0.0).astype(np.float32), hdr=True))
