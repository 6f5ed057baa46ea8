"""What is drawn over the picture, as SVG in its pixels: a sign for each wish, overlays and the wipe."""

from collections.abc import Mapping
from html import escape

from focusjax.studio._answer import Answer
from focusjax.studio._wishes import kind_of

SIGNS = {"sharp": "◎", "blur": "●", "at_most": "≤", "at_least": "≥", "same_blur_as": "=", "": "·"}
"""One for each kind of wish, so that kinds differ without colours."""


def radius(width: int) -> float:
    """Of a mark in a picture `width` pixels wide."""
    return max(3.0, width / 75)


def nearest_mark(marks: list[tuple[float, float] | None], x: float, y: float, within: float) -> int | None:
    """The mark that (`x`, `y`) is on."""
    found = [
        (abs(complex(mark[0] - x, mark[1] - y)), number)
        for number, mark in enumerate(marks)
        if mark is not None
    ]
    distance, number = min(found, default=(within + 1.0, 0))
    return number if distance <= within else None


def marks_svg(answer: Answer, scale: float, width: int, selected: int | None) -> str:
    """A sign with its number for every wish, and the circle to which its point is blurred.

    Args:
        answer: whose wishes they are.
        scale: pixels shown for one of the config's.
        width: of the picture that is shown, in pixels.
        selected: number of the wish whose card is open.
    """
    size, rows, parts = radius(width), answer.wishes, []
    for number, mark in enumerate(answer.marks()):
        if mark is None:
            continue
        x, y = mark[0] * scale, mark[1] * scale
        row = rows[number] if number < len(rows) else None
        state = "" if row is None else " idle" if not row.counts else " met" if row.met else " missed"
        chosen = " chosen" if number == selected else ""
        if row is not None and abs(row.got) * scale > 2.0:
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{abs(row.got) * scale / 2:.1f}" class="coc"/>'
            )
        verdict = {" met": "✓", " missed": "✗"}.get(state, "")
        sign = SIGNS[kind_of(answer.config, number)] if number < len(answer.config.focus) else "·"
        parts.append(
            f'<g class="mark{state}{chosen}" font-size="{1.3 * size:.1f}">'
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" class="halo"/>'
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{size:.1f}" class="ring"/>'
            f'<text x="{x:.1f}" y="{y:.1f}" class="sign">{escape(sign)}</text>'
            f'<text x="{x + 1.3 * size:.1f}" y="{y - 0.6 * size:.1f}" class="number">'
            f"{number + 1}{verdict}</text>"
            "</g>"
        )
    return "".join(parts)


def controls_svg(answer: Answer, scale: float, width: int, selected: int | None) -> str:
    """A diamond for every control point of the focal surface; arguments as for `marks_svg`."""
    parts, size = [], 1.5 * radius(width)
    for number, control in enumerate(answer.controls()):
        if control.mark is None:
            continue
        x, y = (scale * each for each in control.mark)
        corners = ((x, y - size), (x + size, y), (x, y + size), (x - size, y))
        points = " ".join(f"{each[0]:.1f},{each[1]:.1f}" for each in corners)
        chosen = " chosen" if number == selected else ""
        parts.append(
            f'<g class="control{chosen}"><polygon points="{points}" class="halo"/>'
            f'<polygon points="{points}" class="edge"><title>{escape(control.name)}</title></polygon></g>'
        )
    return "".join(parts)


def layers_svg(
    addresses: Mapping[str, str], size: tuple[int, int], *, overlay: str, wipe: float | None
) -> str:
    """The overlay, and the sharp view left of the wipe.

    Args:
        addresses: of the pictures by kind.
        size: width and height of the picture that is shown.
        overlay: "blur", "depth" or nothing.
        wipe: share of the width that shows the sharp view; None for none.
    """
    width, height = size
    whole = f'width="{width}" height="{height}"'
    parts = []
    if wipe is not None and "sharp" in addresses:
        edge = wipe * width
        parts.append(
            f'<clipPath id="wiped"><rect width="{edge:.1f}" height="{height}"/></clipPath>'
            f'<image href="{escape(addresses["sharp"])}" {whole} clip-path="url(#wiped)"/>'
            f'<line x1="{edge:.1f}" x2="{edge:.1f}" y2="{height}" class="wipe"/>'
        )
    if overlay in addresses:
        parts.append(f'<image href="{escape(addresses[overlay])}" {whole} class="overlay"/>')
    return "".join(parts)
