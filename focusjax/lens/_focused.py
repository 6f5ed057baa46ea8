"""Real lenses with their film in place: what film points see is found, and their rays are bounded."""

import dataclasses
import math
from typing import SupportsFloat

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from focusjax._arguments import real_number, require_kind
from focusjax._programs import jit
from focusjax._words import shown
from focusjax.geometry import Camera
from focusjax.lens._aperture import AbstractAperture, Disk
from focusjax.lens._film import film_for, rings
from focusjax.lens._prescription import PrescriptionLens
from focusjax.lens._pupils import Pupils, find_pupils, from_film, openness
from focusjax.lens._ray_bounds import STEEPEST, RayBounds, find_all_around, find_bounds, is_round
from focusjax.lens._stop_map import StopMap, find_stop_map
from focusjax.optics import (
    Prescription,
    film_distance,
    first_order,
    focused_by_group,
    line,
    opened_to,
    with_focal_length,
)

_RADII = 33
"""Film radii at which pupils and bounds are kept; as many less one lie between them."""
FRAME_MARGIN = 4.0
"""Pixels beyond the frame from which rays may start, for wide filters."""
_EDGE = 128
"""Rays along and across the unit square that measure the light through an opening that is not round."""
_ROUND = Disk()
_SHORTEST, _LONGEST = 300.0, 2500.0
"""Wavelengths in nm for which catalogues of glass are made."""


def prescription_lens(
    prescription: Prescription,
    camera: Camera,
    *,
    focus_distance: SupportsFloat,
    f_number: SupportsFloat | None = None,
    focus: str = "traced",
    breathing: bool = False,
    falloff: bool = True,
    group: tuple[int, int] | None = None,
    aperture: AbstractAperture | None = None,
) -> PrescriptionLens:
    """A prescription in a photographer's terms, scaled to the camera's focal length, with checked values.

    Args:
        prescription: any that forms images (`focusjax.optics`).
        camera: whose focal length the lens gets, and whose frame its rays are bounded for. It stands in the
            entrance pupil.
        focus_distance: metres from there; `inf` is allowed.
        f_number: focal length over entrance pupil diameter; that of the prescription if not given.
        focus: "traced" puts the film where the spot on the axis has the least variance, "paraxial" where rays
            near the axis meet.
        breathing: let the picture's scale follow the film's distance.
        falloff: let light fall off as cos^4 towards the corners; vignetting does so either way.
        group: numbers, from 0, of the first and last surface of the group that focuses, by moving between
            the others (`focusjax.optics.focused_by_group`). The whole lens does if not given. The film then
            moves by what "traced" and "paraxial" differ in, and `refocused` moves it, too.
        aperture: shape of the opening in the stop; round when not given. Light that it takes is made up for.

    Raises:
        ValueError: a lens without real images, an opening beyond the prescription's, a focus distance that
            takes the film into the lens or to infinity, an unknown way to focus, a group that cannot focus
            there, blades or a mask in a lens with a height field, or a fisheye whose frame looks farther than
            80 degrees from the axis.

    Example:
        >>> from focusjax.geometry import look_at
        >>> from focusjax.optics import lens_preset
        >>> camera = look_at((0, 0, 2), (0, 0, 0), width=60, height=40, focal_length=0.05)
        >>> planar = lens_preset("planar_us583336_f4.5_1897")
        >>> lens = prescription_lens(planar, camera, focus_distance=2.0)
        >>> round(float(lens.f_number(camera)), 2)
        4.5
    """
    if focus not in ("paraxial", "traced"):
        raise ValueError(f'focus is {focus!r}; expected "paraxial" or "traced"')
    lens, disparity = in_terms_of(prescription, camera, focus_distance, f_number, group)
    opening = Disk() if aperture is None else aperture
    remedy = "`polygon`, `obstructed`, `apodized`, `squeezed` and `mask` make one"
    require_kind(opening, AbstractAperture, "prescription_lens(aperture=)", remedy, "aperture")
    if not (is_round(lens) or isinstance(opening, Disk)):
        raise ValueError(
            f"{lens.name} has a height field, whose stop is round, and the aperture is a"
            f" {type(opening).__name__}; give a disk"
        )
    made = focused_lens(
        lens, camera, disparity, focus=focus, breathing=breathing, falloff=falloff, aperture=opening
    )
    _refuse_all_around(made, camera)
    return made


def in_terms_of(
    prescription: Prescription,
    camera: Camera,
    focus_distance: SupportsFloat,
    f_number: SupportsFloat | None,
    group: tuple[int, int] | None = None,
) -> tuple[Prescription, Float[Array, ""]]:
    """A prescription scaled to the camera, stopped down, its group moved; its focus in 1/m. All checked.

    Raises:
        ValueError: as `prescription_lens`, of these.
    """
    distance = real_number(focus_distance, "focus distance in metres", "a positive distance or infinity")
    if not distance > 0:
        raise ValueError(f"focus distance is {shown(distance)} m; expected a positive distance or infinity")
    lens = with_focal_length(prescription, float(camera.focal_length) * 1e3)
    if f_number is not None:
        lens = opened_to(lens, real_number(f_number, "f-number", "a positive number such as 2.8"))
    disparity = jnp.asarray(1.0 / distance, dtype=float)
    if group is not None:
        lens = focused_by_group(lens, *group, 1e-3 / distance)
    film, scale = film_distance(lens, lens.indices(line()), disparity * 1e-3)
    if not 0 < float(scale) < float("inf"):
        seen = first_order(lens)
        reach = 1e-3 * float(seen.entrance_pupil - seen.front_focal_distance)
        raise ValueError(
            f"focus distance {shown(distance)} m is within the front focal point of {lens.name},"
            f" {reach:.3g} m from its entrance pupil, where it forms no real image; focus farther away or use"
            " a shorter focal length"
        )
    if not float(film) > 0:
        raise ValueError(f"the film of {lens.name} would be {-float(film):.3g} mm inside the lens")
    return lens, disparity


def _refuse_all_around(lens: PrescriptionLens, camera: Camera) -> None:
    """A picture in perspective, whose rays are q = a + b w, ends before 90 degrees."""
    beyond = np.flatnonzero(np.asarray(lens.bounds.beyond) > 0.5)
    pixels = float(lens.film_step * camera.focal_px) * (beyond[0] if len(beyond) else math.inf)
    if pixels < float(lens.film_step * camera.focal_px) * (_RADII - 1) - FRAME_MARGIN:
        raise ValueError(
            f"{lens.prescription.name} looks farther than {np.degrees(np.arctan(STEEPEST)):.1f} degrees from"
            f" the axis at {pixels:.0f} pixels from the middle of the picture, within its frame; pictures"
            " here are in perspective, which ends before 90 degrees, so use a smaller sensor or a longer"
            " focal length"
        )


def focused_lens(
    prescription: Prescription,
    camera: Camera,
    focus_disparity: Float[Array, ""],
    *,
    focus: str = "traced",
    breathing: bool = False,
    falloff: bool = True,
    aperture: AbstractAperture = _ROUND,
    farthest: Float[Array, ""] | None = None,
) -> PrescriptionLens:
    """As `prescription_lens`, unchecked, not scaled nor stopped down: for derivatives and compiled code.

    Differentiable in the prescription and the focus; only the ellipse that rays are spread over is taken as
    it is, since any that covers the opening gives the same picture. `farthest` is the tangent to the axis up
    to which film points are seen, that of the frame's farthest corner if not given.
    """
    indices = prescription.indices(line())
    film, scale = film_for(prescription, camera, focus_disparity, focus, breathing=breathing)
    pupil = first_order(prescription).entrance_pupil
    farthest = _farthest(camera) if farthest is None else farthest
    step = jax.lax.stop_gradient(farthest) / (_RADII - 1)
    lens = _placed(prescription, indices, film, scale, pupil, step, falloff, aperture)
    return dataclasses.replace(lens, focus_disparity=focus_disparity, focus=focus, breathing=breathing)


def at_wavelength(lens: PrescriptionLens, wavelength: SupportsFloat | Float[Array, ""]) -> PrescriptionLens:
    """The same lens with its film where it is, for light of another `wavelength` in nm.

    Raises:
        ValueError: a wavelength beyond 300 to 2500 nm, where formulas of glass mean nothing.
    """
    if not isinstance(wavelength, Tracer):
        nanometres = real_number(wavelength, "the wavelength", "nanometres, such as 550")
        if not _SHORTEST <= nanometres <= _LONGEST:
            raise ValueError(
                f"the wavelength is {nanometres:g} nm; expected {_SHORTEST:g} to {_LONGEST:g}, for which"
                " glasses have an index"
            )
    return with_indices(lens, lens.prescription.indices(jnp.asarray(wavelength, dtype=lens.indices.dtype)))


def with_indices(lens: PrescriptionLens, indices: Float[Array, " n_plus_1"]) -> PrescriptionLens:
    """The same lens with its film where it is, for light that is refracted by other `indices`."""
    place = (lens.film_place, lens.film_scale, lens.entrance_pupil, lens.film_step)
    other = _placed(lens.prescription, indices, *place, lens.falloff, lens.aperture)
    kept = {name: getattr(lens, name) for name in ("focus_disparity", "exposure", "focus", "breathing")}
    return dataclasses.replace(other, **kept)


def _farthest(camera: Camera) -> Float[Array, ""]:
    """Tangent to which film points are seen, beyond the frame's farthest corner."""
    size = jnp.array([camera.width, camera.height], dtype=camera.principal_point.dtype)
    farthest = jnp.maximum(camera.principal_point, size - camera.principal_point)
    return (jnp.sqrt(farthest @ farthest) + FRAME_MARGIN) / camera.focal_px


def _placed(
    prescription: Prescription,
    indices: Float[Array, " n_plus_1"],
    film: Float[Array, ""],
    scale: Float[Array, ""],
    pupil: Float[Array, ""],
    step: Float[Array, ""],
    falloff: bool,
    aperture: AbstractAperture,
) -> PrescriptionLens:
    """The lens with its film in place: find what film points see, and bound their rays.

    What does not depend on the opening's shape is compiled apart, so that another shape does not compile it
    again.
    """
    pupils, bounds = _seen(prescription, indices, film, scale, pupil, step)
    round_stop = isinstance(aperture, Disk)
    lens = PrescriptionLens(
        prescription=prescription,
        indices=indices,
        focus_disparity=jnp.zeros_like(film),
        film_place=film,
        film_scale=scale,
        entrance_pupil=pupil,
        film_step=step,
        pupils=pupils,
        bounds=bounds,
        aperture=aperture,
        stop_map=None if round_stop else _mapped(prescription, indices, film, scale, step, pupils),
        exposure=jnp.ones_like(film),
        falloff=falloff,
        focus="traced",
        breathing=False,
    )
    return dataclasses.replace(lens, exposure=_light_on_axis(lens))


@jit
def _seen(
    prescription: Prescription,
    indices: Float[Array, " n_plus_1"],
    film: Float[Array, ""],
    scale: Float[Array, ""],
    pupil: Float[Array, ""],
    step: Float[Array, ""],
) -> tuple[Pupils, RayBounds]:
    """Pupils of the film radii that are kept, and bounds of their rays."""
    radii = _film_radii(step, indices.dtype)
    if is_round(prescription):
        pupils = find_pupils(prescription, indices, film, scale * radii)
        bounds = find_bounds(prescription, indices, film, scale, pupil, pupils, radii)
    else:
        pupils, bounds = find_all_around(prescription, indices, film, scale, pupil, radii)
    return jax.tree.map(lambda leaf: leaf[::2], pupils), bounds


@jit
def _mapped(
    prescription: Prescription,
    indices: Float[Array, " n_plus_1"],
    film: Float[Array, ""],
    scale: Float[Array, ""],
    step: Float[Array, ""],
    pupils: Pupils,
) -> StopMap:
    """Where rays of the film radii that are kept have to be aimed."""
    radii = _film_radii(step, indices.dtype)[::2]
    return find_stop_map(prescription, indices, film, scale * radii, pupils)


@jit
def _light_on_axis(lens: PrescriptionLens) -> Float[Array, ""]:
    """What the opening lets through to the middle of the film, in mm^2."""
    dtype = lens.indices.dtype
    if isinstance(lens.aperture, Disk):
        points = rings(lens.prescription, dtype)
    else:
        middles = (jnp.arange(_EDGE, dtype=dtype) + 0.5) / _EDGE
        square = jnp.stack(jnp.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
        points = jax.vmap(lens.aperture.point)(square)

    def light(point: Array) -> Array:
        zero = jnp.zeros_like(lens.film_place)
        target, area = lens.aimed_at(zero, point[0], point[1])
        found, cosine = from_film(lens.prescription, lens.indices, lens.film_place, (zero, zero), target)
        return area * openness(found.clearance) * (cosine**4 if lens.falloff else 1.0)

    return jnp.mean(jax.vmap(light)(points))


def _film_radii(step: Float[Array, ""], dtype: jnp.dtype) -> Float[Array, " k"]:
    """Tangents of the film radii that are kept, and of those between them."""
    return 0.5 * step * jnp.arange(2 * _RADII - 1, dtype=dtype)
