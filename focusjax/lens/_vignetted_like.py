"""An ideal lens with the cat's eyes and the dark corners of a real one."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from focusjax.geometry import Camera
from focusjax.lens._base import AbstractLens
from focusjax.lens._falloff import CosineFalloff, DarkenedLens, illumination
from focusjax.lens._vignetted import VignettedLens

_PLACES = 13
_START = (1.2, 1.3, 0.8, 0.5, 4.0)
"""Radii of the disks ahead and behind and how far they are shifted in the corner, in radii of the opening;
and the power of the cosine."""
_LEAST, _MOST = (1.0, 1.0, 0.0, 0.0, 0.0), (10.0, 10.0, 10.0, 10.0, 8.0)


def vignetted_like(lens: AbstractLens, real: AbstractLens, camera: Camera) -> DarkenedLens:
    """`lens` behind one disk and before another, that together darken its corners as `real` does.

    Kyaw (2013, section 4.4) takes the rims of the first and the last element for the disks. Pupils of real
    lenses move and grow with the angle, so that rims seen by first-order optics are 10 % off; here radii and
    places of the disks, and the power of the cosine that natural vignetting follows, are fitted to the light
    through `real` along the picture's diagonal, relative to the axis. So a lens without glass gets the
    vignetting of one that has it, at a fraction of the cost. They are its own at this opening.

    Args:
        lens: an ideal lens, as far open as `real`.
        real: a lens that knows its vignetting, such as a `PrescriptionLens`.
        camera: the camera both stand in.

    Raises:
        ValueError: a closed lens.
    """
    opening = float(lens.parallax(camera)) / float(camera.focal_px)
    if not opening > 0:
        raise ValueError("a closed lens has no vignetting; open it")
    middle = np.asarray(camera.principal_point, dtype=float)
    from scipy.optimize import least_squares

    size = np.array([camera.width, camera.height])
    corner = np.where(middle > size / 2, 0.0, size)
    along = np.linspace(0.0, 1.0, _PLACES)[:, None]
    places = jnp.asarray(middle + along * (corner - middle), dtype=float)
    wanted = np.asarray(illumination(real, camera, places))
    wanted = wanted / wanted[0]
    steepest = float(np.hypot(*(corner - middle)) / camera.focal_px)

    def model(values: np.ndarray) -> DarkenedLens:
        ahead, behind, shift_ahead, shift_behind, power = (jnp.asarray(float(v), dtype=float) for v in values)

        def disk(inner: AbstractLens, radius: Array, shift: Array) -> VignettedLens:
            return VignettedLens(inner, radius * opening, shift * (opening / steepest))

        return DarkenedLens(disk(disk(lens, behind, -shift_behind), ahead, shift_ahead), CosineFalloff(power))

    def left(values: np.ndarray) -> np.ndarray:
        found = np.asarray(illumination(model(values), camera, places))
        return (found / found[0] - wanted) / np.maximum(wanted, 0.05)

    # Finite differences: more than single precision has digits for, which stops the fit early at worst.
    found = least_squares(left, _START, bounds=(_LEAST, _MOST), diff_step=1e-3, xtol=1e-6, ftol=1e-8)
    return model(found.x)
