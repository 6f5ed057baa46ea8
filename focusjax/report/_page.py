"""report.html: one self-contained page."""

import math
from typing import Any

from focusjax._settings import angle, f_number, metres
from focusjax._templates import template
from focusjax.report._glass import glass_sentences
from focusjax.report._quality import quality_sentence

_STAGES = {
    "load": "load the meshes",
    "meter": "meter the sharp view",
    "locate": "find the focus points",
    "locate_again": "depths through the solved lens",
    "solve": "solve",
    "solve_again": "solve in the moved frame",
    "glass": "focus and fit the real lens",
    "peel": "peel layers",
    "examine_layers": "examine the layers",
    "plan": "plan rays",
    "render": "trace rays",
    "examine": "examine the picture",
    "guess": "count what was guessed",
    "pinhole": "sharp view",
    "develop": "expose and develop",
    "compile": "compile",
}


def page(title: str, facts: dict[str, Any], pictures: dict[str, str]) -> str:
    """The page as text.

    Args:
        title: heading.
        facts: what `summary` returned.
        pictures: data URLs by kind: "blur", and "image" and "pinhole" when a picture was made.
    """
    total = sum(facts["seconds"].values())
    picture = facts["picture"]
    names = _STAGES | ({"render": "post-process"} if picture and picture["method"] == "post" else {})
    return template("focusjax.report", "page.html.j2").render(
        title=title,
        facts=facts,
        pictures=pictures,
        lens=facts["lens"],
        glass=glass_sentences(facts["lens"]["glass"]) if facts["lens"]["glass"] else [],
        weighed=quality_sentence(picture["quality"]) if picture and picture["quality"] else None,
        wishes=facts["wishes"],
        met=sum(wish["met"] for wish in facts["wishes"]),
        stages=[
            (names.get(name, name), seconds, 100 * seconds / total)
            for name, seconds in facts["seconds"].items()
        ],
        total=total,
        spread=_spread,
        metres=metres,
        f_number=f_number,
        angle=angle,
        pixels=_pixels,
        seconds=_seconds,
    )


def _spread(name: str, error: float | str) -> str:
    """A standard error in words."""
    error = float(error)
    if math.isinf(error):
        return "open"
    if error == 0:
        return "at its limit"
    scale, unit = {
        "focus": (1.0, " dioptres"),
        "f_number": (1.0, " f-numbers"),
        "focal_length": (1000.0, " mm"),
        "shift": (1000.0, " mm"),
        "rise": (1000.0, " mm"),
    }.get(name, (180.0 / math.pi, "°"))
    return f"± {scale * error:.2g}{unit}"


def _pixels(value: float) -> str:
    return f"{0.0 if abs(value) < 0.005 else value:+.2f}"


def _seconds(value: float) -> str:
    return f"{1000 * value:.1f} ms" if value < 0.1 else f"{value:.2f} s"
