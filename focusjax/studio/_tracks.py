"""A shot over time as SVG: a bar for each wish with its keyframes, and curves of focus, f-number and blur."""

from collections.abc import Callable, Sequence
from html import escape

import numpy as np
from jaxtyping import Float

from focusjax._settings import f_number, metres
from focusjax.config import Config
from focusjax.studio._reel import Reel
from focusjax.studio._timing import KEYED, keys_of, span_of
from focusjax.studio._wishes import called

LEFT = 132
"""Pixels to the left of the frames, for names."""
RIGHT = 62
"""The same to the right, for values."""
_BAR, _CURVE = 17, 32
"""Heights of a wish's bar and of a curve."""


def tracks_svg(config: Config, reel: Reel | None, frame: int, width: int, selected: int | None = None) -> str:
    """All tracks, with the frame at hand.

    Args:
        config: whose `[shot]` it is.
        reel: its solved frames; None before they are.
        frame: which is shown, counted from 1.
        width: of the drawing in pixels.
        selected: number of the wish whose card is open.
    """
    assert config.shot is not None
    count = config.shot.frames
    scale = (width - LEFT - RIGHT) / max(count - 1, 1)

    def at(number: float) -> float:
        return LEFT + scale * (min(max(number, 1), count) - 1)

    parts, top = [], 4.0
    for number in range(len(config.focus)):
        first, last = span_of(config, number)
        name, chosen = called(config, number), " chosen" if number == selected else ""
        start, end = at(1 if first is None else first), at(count if last is None else last)
        parts.append(
            f'<text x="4" y="{top + 12:.0f}" class="name{chosen}">{number + 1} {escape(_short(name))}</text>'
            f'<rect x="{start - 2:.1f}" y="{top + 3:.0f}" width="{end - start + 4:.1f}" height="{_BAR - 6}"'
            f' class="bar{chosen}"><title>{escape(name)} counts here</title></rect>'
        )
        for each in sorted({frame for what in KEYED for frame in keys_of(config, number, what)}):
            x, y = at(each), top + _BAR / 2
            parts.append(
                f'<path d="M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5 -5z" class="key"><title>keyframe at {each:g}'
                "</title></path>"
            )
        top += _BAR
    if reel is not None:
        curves = _curves(config, reel)
        for name, low, high, rows in curves:
            parts += _curve(name, low, high, rows, top, at)
            top += _CURVE
    x = at(frame)
    parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{top + 4:.0f}" class="now"/>')
    return (
        f'<svg viewBox="0 0 {width} {top + 6:.0f}" class="fj-tracks" role="img"'
        f' aria-label="The shot over time, at frame {frame}">{"".join(parts)}</svg>'
    )


Rows = Sequence[tuple[str, Float[np.ndarray, "t"]]]


def _curves(config: Config, reel: Reel) -> list[tuple[str, str, str, Rows]]:
    """Name, what the lowest and the highest value are called, and rows with their classes."""
    curves = reel.curves
    focus, numbers = curves["focus"], curves["f_number"]
    blurs = [
        (f"wish{k % 5}", np.abs(curves[f"blur {k}"]))
        for k in range(len(config.focus))
        if f"blur {k}" in curves
    ]
    highest = max((float(row.max(initial=0.0)) for _, row in blurs), default=0.0)
    with np.errstate(divide="ignore"):
        far, near = 1.0 / float(focus.min()), 1.0 / float(focus.max())
    found: list[tuple[str, str, str, Rows]] = [("Focus", metres(far), metres(near), [("focus", focus)])]
    if np.isfinite(numbers).all():
        ends = f_number(float(numbers.min())), f_number(float(numbers.max()))
        found.append(("f-number", *ends, [("number", numbers)]))
    found.append(("Blur", "0 px", f"{highest:.0f} px", blurs))
    return found


def _curve(name: str, low: str, high: str, rows: Rows, top: float, at: Callable[[float], float]) -> list[str]:
    least = 0.0 if name == "Blur" else min(float(row.min()) for _, row in rows)
    most = max(float(row.max()) for _, row in rows)
    room = max(most - least, 1e-9)
    height = _CURVE - 8
    parts = [f'<text x="4" y="{top + 20:.0f}" class="name">{name}</text>']
    for kind, row in rows:
        flat = most - least < 1e-6 * max(abs(most), 1e-9)
        shares = np.full(len(row), 0.5) if flat else (row - least) / room
        points = " ".join(
            f"{at(frame):.1f},{top + 4 + height * (1 - share):.1f}" for frame, share in enumerate(shares, 1)
        )
        parts.append(f'<polyline points="{points}" class="{kind}"/>')
    right = at(1e9) + 8
    parts.append(f'<text x="{right:.0f}" y="{top + 12:.0f}" class="end">{escape(high)}</text>')
    if low != high:
        parts.append(f'<text x="{right:.0f}" y="{top + _CURVE - 3:.0f}" class="end">{escape(low)}</text>')
    return parts


def _short(name: str, most: int = 17) -> str:
    return name if len(name) <= most else name[: most - 1] + "…"
