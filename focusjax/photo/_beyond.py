"""What is beyond the frame of a photograph: its mirror image, the smoother the farther away.

Close to the frame the picture most likely goes on as it is, and farther out only its mean is known. A guess
that is to be right on the average therefore loses its detail with distance: at d pixels from the frame the
mirror image is blurred with a standard deviation of d.
"""

import numpy as np
import scipy
from jaxtyping import Float


def extended(picture: Float[np.ndarray, "h w 3"], border: int) -> Float[np.ndarray, "_ _ 3"]:
    """The picture with `border` pixels more on each side; `border` is at most the shorter side."""
    out = np.pad(picture, ((border, border), (border, border), (0, 0)), mode="symmetric").astype(np.float32)
    # A box of s pixels, twice, has the variance (s^2 - 1) / 6.
    sizes = 2 ** np.arange(1, max(int(np.ceil(np.log2(2.5 * max(border, 1)))), 1) + 1) + 1
    spreads = np.concatenate([[0.0], np.sqrt((sizes**2 - 1) / 6)])
    level = np.interp(np.arange(border, 0, -1), spreads, np.arange(len(spreads))).astype(np.float32)
    for turn in range(4):
        view = np.rot90(out, turn)
        strip = view[: 2 * border].copy()
        share = np.maximum(1.0 - level, 0.0)
        mixed = share[:, None, None] * strip[:border]
        for number, size in enumerate(sizes, start=1):
            share = np.maximum(1.0 - np.abs(level - number), 0.0)[:, None, None]
            if not share.any():
                continue
            smooth = strip
            for _ in range(2):
                smooth = scipy.ndimage.uniform_filter(smooth, (size, size, 1))
            mixed += share * smooth[:border]
        view[:border] = mixed
    return out
