"""The page on derivatives of pictures: what is differentiated, what is not, and how far they are off."""

from collections.abc import Sequence
from pathlib import Path

Row = Sequence[str]

DIFFERENTIATED = (
    ("focus, aperture radius, plane in focus, focal surface, shape of the opening", "exact, see below"),
    (
        "a lens of your own",
        "exact, where rays are differentiable in film point, opening point and arrays",
    ),
    ("`layers.samples.radiance`, `layers.background`", "exact: the picture is linear in them"),
    ("exposure and film, applied to the picture", "by JAX"),
)
STOPPED = (
    ("geometry, camera, opacity, margin of the layers", "derivative 0: peel again"),
    ("materials of highlights (`view_dependent=True`)", "derivative 0; the lens's own is exact"),
    ("which rays are traced, and how deep rays look", "no part of the converged picture"),
    ("second derivatives", "not offered: they would miss silhouettes"),
)
BIASES = (
    (
        "finite layer samples",
        "as the picture's: the converged derivative is that of the layers, whose silhouettes and colours"
        " differ from the scene's by a share of a sample. Below it is what more rays do not mend",
    ),
    (
        "too few layers, or a lens wider than the one peeled for",
        "surfaces are missing; the latter is refused",
    ),
    (
        "rates that differ within a pixel",
        "how rays spread is averaged about its mean over a quarter as many rays as cross a border, 4 at"
        " least: one over their number of a term that is 0 for thin lenses",
    ),
    (
        "a closed opening",
        "0 by the opening, since openings of either sign make the same picture",
    ),
    (
        "single precision",
        "about 1e-6 of the largest value; the opening's middle, where the flow has no inverse, is left out"
        " up to a thousandth of its radius",
    ),
)


def write_page(file: Path, command: str, measured: Sequence[Row], other: Sequence[Row] | str) -> None:
    """Write the page.

    Args:
        file: where to.
        command: that measured.
        measured: heading and rows.
        other: Mitsuba's answers with a heading, or why there are none.
    """
    parts = [
        "# Derivatives of pictures: what holds, and how well",
        f"Written by `{command}`.",
        "`render_differentiable` gives the derivative of the converged picture, not that of its own"
        " arithmetic: means over film and opening are differentiated as what crosses the borders of pixels"
        " and the rim of the opening, with radiances as they are. `focusjax/trace/_motion.py` has the"
        " mathematics.",
        "## Differentiated",
        _table([("what", "how"), *DIFFERENTIATED]),
        "## Stopped",
        _table([("what", "what that means"), *STOPPED]),
        "## Where bias remains",
        _table([("source", "size"), *BIASES]),
        "## Measured",
        "Against central differences of pictures cast by Embree, which share nothing with the layers."
        " Projection: of the derivative on the true one, 1 is right. Error: root-mean-square over that of the"
        " truth, whose own noise is taken out. Loss: relative error of the derivative of the"
        " squared difference from the picture through another lens. `plain` is the derivative of what traced"
        " rays bring back, with visibility as it is.",
        _table(measured),
        "## Mitsuba's own derivative",
        "It marks neither parameter as differentiable. Asked all the same, of a glowing square out of focus:",
        other if isinstance(other, str) else _table(other),
    ]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\n\n".join(parts) + "\n")


def _table(rows: Sequence[Row]) -> str:
    """A table in Markdown, with a heading."""
    first, *rest = (f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in rows)
    return "\n".join([first, f"|{' --- |' * len(rows[0])}", *rest])
