"""A lens to peel for when the one that made a picture is not known yet."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from focusjax.geometry import Camera
from focusjax.lens import ThinLens, view_tangents


def widest_lens(
    camera: Camera, *, min_focus_distance: float, f_number: float, max_tilt: float = 0.0
) -> ThinLens:
    """A lens whose rays go as far as those of any lens that may have made a picture.

    Layers serve lenses whose rays stray from their film points no farther than those of the lens they were
    peeled for. At disparity w those of a thin lens stray by f E |w_f - w|, which is most for the widest
    opening, near things when it is focused on infinity, and far things when it is focused near. This lens
    is focused beyond infinity, at -w_f of the nearest focus: f E (w_f + w) is no less than any of these.
    It is made to be peeled for, not to take pictures with.

    Args:
        camera: as the picture is framed.
        min_focus_distance: metres; the nearest that the lens may be focused, anywhere in the frame.
        f_number: the smallest it may have.
        max_tilt: radians; the most that its axis may be turned, by tilt and swing together.

    Raises:
        ValueError: a value out of range.

    Example:
        >>> from focusjax.geometry import look_at
        >>> camera = look_at((0, 0, 0), (0, 0, -1), width=64, height=48, focal_length=0.05)
        >>> float(widest_lens(camera, min_focus_distance=0.5, f_number=2).focus_disparity)
        -2.0
    """
    if not 0 < min_focus_distance < math.inf:
        raise ValueError(f"min_focus_distance is {min_focus_distance:g} m; expected a positive length")
    if not 0 < f_number < math.inf:
        raise ValueError(f"f-number is {f_number}; expected a positive number such as 2.8")
    if not 0 <= max_tilt < math.pi / 2:
        raise ValueError(f"max_tilt is {max_tilt} rad; expected 0 up to less than pi/2")
    nearest, length = 1.0 / min_focus_distance, float(camera.focal_length)
    radius = length / (2.0 * f_number)
    if max_tilt:
        radius *= _turned(camera, radius, nearest, max_tilt)
    return ThinLens(
        focus_disparity=jnp.asarray(-nearest, dtype=float), aperture_radius=jnp.asarray(radius, dtype=float)
    )


def _turned(camera: Camera, radius: float, nearest: float, max_tilt: float) -> float:
    """How much farther the rays of a turned opening go, at most, than those of an upright one."""
    corners = jnp.array([(x, y) for x in (0.0, camera.width) for y in (0.0, camera.height)], dtype=float)
    across = np.linalg.norm(np.asarray(jax.vmap(lambda p: view_tangents(camera, p))(corners)), axis=1).max()
    # |Q_xy - Q_z (x, y)| <= 1 + sin(t) |(x, y)|, over 1 - Q_z w_f.
    lean = math.sin(max_tilt)
    gap = 1.0 - radius * lean * nearest
    if not gap > 0.1:
        raise ValueError(
            f"an opening of radius {radius:.4g} m turned by {math.degrees(max_tilt):.4g} degrees comes within"
            f" a tenth of the nearest focus, {1.0 / nearest:.4g} m; raise min_focus_distance or the f-number"
        )
    return (1.0 + lean * float(across)) / gap
