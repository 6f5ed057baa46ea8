"""Checks of one sharp view with its depth."""

import numpy as np
from jaxtyping import Float

from focusjax.geometry import Camera


def checked_view(
    image: Float[np.ndarray, "_ _ 3"], disparity: Float[np.ndarray, "_ _"], camera: Camera
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
    """`image` and `disparity` as float64 arrays that fit each other and `camera`.

    Raises:
        ValueError: another size than the camera's, values that are not finite, or negative disparity.
    """
    picture, depth = np.asarray(image, dtype=np.float64), np.asarray(disparity, dtype=np.float64)
    for name, shape in (("image", picture.shape[:2]), ("disparity map", depth.shape)):
        if shape != (camera.height, camera.width):
            raise ValueError(
                f"the {name} is {shape[1]} x {shape[0]} pixels but the camera's frame is"
                f" {camera.width} x {camera.height}; give both the same size"
            )
    for name, values in (("image", picture), ("disparity map", depth)):
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            raise ValueError(f"the {name} has {bad} values that are not finite; expected finite numbers")
    if depth.min() < 0:
        raise ValueError(f"the least disparity is {depth.min():g} 1/m; expected 0 (infinitely far) or more")
    return picture, depth
