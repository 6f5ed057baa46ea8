"""A prescription by its third-order aberrations alone: quick, and with each aberration apart."""

import math
from typing import SupportsFloat

import jax.numpy as jnp
import numpy as np

from focusjax.geometry import Camera
from focusjax.lens._focused import in_terms_of
from focusjax.lens._thin import ThinLens
from focusjax.lens.aberrations import AberratedLens, seidel
from focusjax.optics import Prescription, first_order, seidel_sums


def seidel_lens(
    prescription: Prescription,
    camera: Camera,
    *,
    focus_distance: SupportsFloat,
    f_number: SupportsFloat | None = None,
) -> AberratedLens:
    """The thin lens with the Seidel aberrations of a prescription, in place of `prescription_lens`.

    It has the entrance pupil of that, focused where rays near the axis meet, and its spots for small fields
    and apertures; there is no vignetting, no fall-off of light, and nothing of the fifth order. A coefficient
    W of the wavefront at the edge of field and pupil moves rays by W / u' on the film, with u' = r / s the
    slope of the marginal ray there, r the pupil's radius and s the film's scale (Welford, Aberrations of
    Optical Systems, chapter 8): by W f / r in pixels.

    Args:
        prescription: any that forms images.
        camera: whose focal length the lens gets; its frame's half diagonal is the field.
        focus_distance: metres from the entrance pupil; `inf` is allowed.
        f_number: focal length over entrance pupil diameter; that of the prescription if not given.

    Raises:
        ValueError: as `prescription_lens`.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.optics import lens_preset
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> triplet = lens_preset("cooke_triplet_50mm_f4")
        >>> lens = seidel_lens(triplet, camera, focus_distance=2.0)
        >>> len(lens.aberrations)
        1
    """
    lens, disparity = in_terms_of(prescription, camera, focus_distance, f_number)
    radius = first_order(lens).entrance_pupil_radius
    half_diagonal = 0.5 * float(np.hypot(camera.width, camera.height))
    waves = seidel_sums(
        lens,
        field=math.atan(half_diagonal / float(camera.focal_px)),
        object_distance=1e3 * float(focus_distance),
    ).wavefront()
    pixels = float(camera.focal_px / radius)
    thin = ThinLens(disparity, jnp.asarray(radius * 1e-3))
    terms = {name.lower(): pixels * float(waves[name]) for name in ("W040", "W131", "W222", "W220", "W311")}
    return AberratedLens(thin, (seidel(thin, camera, **terms),))
