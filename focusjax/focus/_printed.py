"""What `print` and notebooks say of a solution: settings, wishes and what stands in the way."""

import dataclasses
import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from focusjax._settings import angle, f_number, metres
from focusjax.focus._diagnose import diagnose
from focusjax.focus._frames_solution import FramesSolution
from focusjax.focus._solution import AbstractPrinted, Solution, WishResult
from focusjax.focus._solve_surface import SurfaceSolution
from focusjax.lens import TiltShiftLens

WISH_HEADINGS = ("focus point", "wished", "result", "off by", "verdict")


def wish_rows(table: Sequence[WishResult]) -> list[tuple[str, str, str, str, str]]:
    """What `WISH_HEADINGS` says, of every wish, in words."""
    return [
        (
            row.name,
            wished(row),
            f"{row.got:+.2f} px",
            f"{abs(row.residual):.2f} px",
            (row.note or "not counted") if not row.counts else "met" if row.met else "missed",
        )
        for row in table
    ]


def wished(row: WishResult) -> str:
    """A wish in a few words."""
    if row.relation == "same":
        return f"as blurred as {row.partner}"
    if row.relation == "shown at":
        return "at its place"
    if row.relation == "in frame":
        return f"{row.wished:g} px inside"
    if row.relation != "equal":
        return f"{row.relation} {row.wished:g} px"
    return "sharp" if not row.wished else f"{row.wished:+g} px" if row.signed else f"{row.wished:g} px"


def printed(solution: AbstractPrinted) -> str:
    """A solution of known values in lines of text.

    Example:
        >>> import jax.numpy as jnp
        >>> from focusjax.focus import AtPoint, FocusPoint, Sharp, locate, solve
        >>> from focusjax.geometry import make_camera
        >>> from focusjax.lens import thin_lens
        >>> camera = make_camera(jnp.eye(4), width=640, height=480, focal_length=0.05)
        >>> start = thin_lens(focus_distance=5.0, f_number=2.0, focal_length=0.05)
        >>> points = locate([FocusPoint(AtPoint((0, 0, -2)), Sharp(), name="nose")], camera)
        >>> print(printed(solve(points, camera, start)))
        Focus 2.00 m, f/2.0, 50 mm
        focus point  wished    result   off by  verdict
        nose          sharp  +0.00 px  0.00 px  met
    """
    said = _said(solution)
    rows = [WISH_HEADINGS, *said.rows] if said.rows else []
    widths = [max(len(row[column]) for row in rows) for column in range(len(WISH_HEADINGS) if rows else 0)]
    lines = [
        "  ".join(
            text.ljust(width) if column in (0, len(WISH_HEADINGS) - 1) else text.rjust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
    return "\n".join([*([said.first] if said.first else []), *lines, *said.sentences])


def as_html(solution: AbstractPrinted) -> str:
    """The same as a piece of a page, for notebooks; what is between the tags is text, whatever its names."""
    said = _said(solution)
    parts = [f"<p><b>{html.escape(said.first)}</b></p>"] if said.first else []
    if said.rows:
        head = "".join(f"<th>{html.escape(heading)}</th>" for heading in WISH_HEADINGS)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(text)}</td>" for text in row) + "</tr>" for row in said.rows
        )
        parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
    parts += [f"<p>{html.escape(sentence)}</p>" for sentence in said.sentences]
    return f"<div>{''.join(parts)}</div>"


@dataclasses.dataclass(frozen=True)
class _Said:
    """Settings in one line, a row for every wish, and the diagnosis."""

    first: str
    rows: list[tuple[str, str, str, str, str]]
    sentences: tuple[str, ...]


def _said(solution: AbstractPrinted) -> _Said:
    if isinstance(solution, FramesSolution):
        return _Said(_shot_line(solution), [], tuple(diagnose(solution).sentences))
    assert isinstance(solution, Solution | SurfaceSolution)
    if np.ndim(solution.cost) > 0:
        count = f"{len(solution.cost)} solutions, of which `at` gives one: at(0), at(1), ..."
        return _Said(count, [], ())
    first = "" if isinstance(solution, SurfaceSolution) else _settings(solution)
    return _Said(first, wish_rows(solution.table()), tuple(diagnose(solution).sentences))


def _settings(solution: Solution) -> str:
    lens, camera = solution.lens, solution.camera
    found = solution.settings()
    said = [
        f"Focus {metres(float(lens.focus_distance()))}",
        f_number(float(found.f_number)),
        f"{1000 * float(found.focal_length):.3g} mm",
    ]
    if isinstance(lens, TiltShiftLens):
        turned = lens.movements(camera)
        said += [
            f"{name} {angle(float(np.degrees(float(value))))}"
            for name, value in (("tilt", turned.tilt), ("swing", turned.swing))
        ]
    for name in ("shift", "rise"):
        if name in solution.free:
            said.append(f"{name} {1000 * float(getattr(camera, name)):+.2f} mm")
    return ", ".join(said)


def _shot_line(solution: FramesSolution) -> str:
    settings: dict[str, Any] = solution.settings()
    with np.errstate(divide="ignore"):
        focus = 1.0 / settings["focus_per_m"]
    numbers = settings["f_number"]
    what = [f"focus from {metres(focus[0])} to {metres(focus[-1])}"]
    both = sorted({f_number(number) for number in (numbers.min(), numbers.max())})
    what.append(" to ".join(both))
    return f"{solution.count} frames, " + ", ".join(what)
