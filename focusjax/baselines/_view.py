"""One sharp view with its depth: all that post-processing methods know of a scene."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._parallel import in_parallel
from focusjax._programs import jit
from focusjax.baselines._through_lens import RayScene, blocks, line_radiance, pixel_corners
from focusjax.geometry import Camera
from focusjax.lens import AbstractLens
from focusjax.scene import Scene


def pinhole_view(
    scene: Scene | RayScene, camera: Camera, *, edge: int = 3
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
    """What a pinhole sees: linear radiance, and the disparity in 1/m at pixel centres.

    Args:
        scene: what to see.
        camera: frame and pose.
        edge: rays per pixel and axis whose radiance is averaged; odd, so that one passes the centre.

    Returns:
        The picture [h, w, 3] and the disparity [h, w], 0 on the background.

    Raises:
        ValueError: an even number of rays or none, or Embree is not installed.
    """
    if edge < 1 or edge % 2 == 0:
        raise ValueError(f"edge is {edge}; expected an odd number of rays per pixel and axis, such as 3")
    ready = scene if isinstance(scene, RayScene) else RayScene(scene)
    pixel = pixel_corners(camera)
    places = (np.arange(edge) + 0.5) / edge

    def view_of(block: slice) -> tuple[np.ndarray, np.ndarray]:
        corners = pixel[block]
        total, disparity = np.zeros((len(corners), 3)), np.zeros(len(corners))
        for row, y in enumerate(places):
            for column, x in enumerate(places):
                colour, depth = line_radiance(
                    ready, camera, corners + np.array([x, y]), np.zeros((len(corners), 2))
                )
                total += colour
                if row == column == edge // 2:
                    disparity = depth
        return total / edge**2, disparity

    views = in_parallel(view_of, blocks(len(pixel)))
    shape = (camera.height, camera.width)
    image = np.concatenate([view[0] for view in views]).reshape(*shape, 3)
    return image, np.concatenate([view[1] for view in views]).reshape(shape)


def signed_radius(
    disparity: Float[np.ndarray, "h w"], camera: Camera, lens: AbstractLens
) -> Float[np.ndarray, "h w"]:
    """Radius of every pixel's circle of confusion in pixels, negative in front of the focus."""
    real = jnp.zeros(()).dtype
    film = jnp.asarray(pixel_corners(camera) + 0.5, dtype=real)
    blur = _blurs(lens, camera, film, jnp.asarray(disparity.ravel(), dtype=real))
    return np.asarray(blur, dtype=np.float64).reshape(disparity.shape) / 2.0


@jit
def _blurs(
    lens: AbstractLens, camera: Camera, film: Float[Array, "n 2"], disparity: Float[Array, " n"]
) -> Float[Array, " n"]:
    return jax.vmap(lambda point, w: lens.blur(camera, point, w))(film, disparity)
