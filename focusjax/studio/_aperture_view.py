"""The shape of the lens's opening as SVG, as large as the f-number has it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from focusjax._programs import jit
from focusjax.lens import AbstractAperture
from focusjax.studio._answer import Answer

_TURNS = 96
_ROOM = 1.06


@jit
def _outline(aperture: AbstractAperture) -> Float[Array, "n 2"]:
    return jax.vmap(aperture.rim)(jnp.linspace(0.0, 1.0, _TURNS, endpoint=False))


def aperture_svg(answer: Answer, size: int = 52) -> str:
    """The opening within the circle of the widest one that the config allows; empty without a lens."""
    if answer.outcome is None:
        return ""
    lens, number = answer.outcome.middle_lens, answer.values()["f_number"]
    table = answer.config.solve
    limited = "f_number" in table.free and "f_number_min" in table.model_fields_set
    widest = min(number, table.f_number_min) if limited else min(number, 1.4)
    if not np.isfinite(number):
        return ""
    half = size / 2
    scale = half / _ROOM * widest / number
    outline = scale * np.asarray(_outline(lens.aperture), dtype=float) + half
    hole = lens.aperture.hole()
    rings = [outline] if hole is None else [outline, half + float(hole) * (outline - half)]
    path = "".join("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in ring) + "z" for ring in rings)
    return (
        f'<svg viewBox="0 0 {size} {size}" width="{size}" height="{size}" class="fj-opening" role="img"'
        f' aria-label="The shape of the opening"><circle cx="{half}" cy="{half}" r="{half / _ROOM:.1f}"/>'
        f'<path d="{path}" fill-rule="evenodd"><title>The opening at f/{number:.1f}, within f/{widest:.1f}'
        "</title></path></svg>"
    )
