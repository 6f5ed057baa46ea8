"""What a solve through glass refuses before it runs."""

import jax
from jax.core import Tracer

from focusjax._arguments import ArgumentError, require_kind
from focusjax._words import kind_of, shown
from focusjax.focus._solution import Asked
from focusjax.lens import (
    AbstractLens,
    FittedLens,
    PrescriptionLens,
    SpectralLens,
    ThinLens,
    TiltedPrescriptionLens,
    nearest_focus,
    pupil_radius,
)

_WIDER = 1e-3
"""Share by which an f-number may be wider than the glass, as engraved ones are rounded."""


def checked_glass(glass: object, asked: Asked, usage: str = "solve(through=)") -> AbstractLens:
    """`glass`, when the problem can be solved through it.

    Raises:
        ArgumentError: another kind of lens, a solver, something free that glass does not have, a start wider
            than the glass, or a closest focus that it does not reach.
    """
    kinds = (PrescriptionLens, SpectralLens, FittedLens, TiltedPrescriptionLens)
    remedy = "`prescription_lens`, `spectral_lens` and `tilted_lens` make one"
    require_kind(glass, kinds, usage, remedy, "through")
    assert isinstance(glass, AbstractLens)
    if asked.plan.solver is not None:
        raise ArgumentError(
            f"solver is {kind_of(asked.plan.solver)}; blur through glass has one solver, so leave it out",
            "solver",
        )
    others = [name for name in asked.plan.free if name not in ("focus", "f_number")]
    if others:
        raise ArgumentError(
            f"free has {others[0]!r}, which is not solved for through glass; solve for it without `through`"
            " first, make the glass for the camera and turn it (`tilted_lens`) as found, and leave it out",
            "free",
        )
    if not isinstance(asked.lens, ThinLens):
        raise ArgumentError(
            "the starting lens is turned; start with a thin lens, and turn the glass (`tilted_lens`)", "lens"
        )
    leaves = jax.tree.leaves((glass, asked.camera, asked.lens, asked.limits))
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        return glass
    length = float(asked.camera.focal_length)
    widest = length / (2.0 * float(pupil_radius(glass)))
    starts = length / (2.0 * max(float(asked.lens.aperture_radius), 1e-30))
    if starts < widest * (1.0 - _WIDER):
        raise ArgumentError(
            f"the starting f-number is {shown(starts)}, and the glass is open to f/{widest:.3g}; open the"
            " glass as far as the solve may go, or start with a larger f-number",
            "lens",
        )
    near, nearest = float(asked.limits.near), float(nearest_focus(glass))
    if near <= nearest and "focus" in asked.plan.free:
        raise ArgumentError(
            f"the minimum focus distance is {shown(near)} m, and the glass focuses no nearer than"
            f" {nearest:.3g} m from its entrance pupil; raise it",
            "min_focus_distance",
        )
    return glass
