"""The summary of a run or a shot on the command line, in a few lines."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from focusjax import job
from focusjax._console import duration, say
from focusjax._words import printable
from focusjax.focus import (
    WISH_HEADINGS,
    FramesSolution,
    Solution,
    SurfaceFramesSolution,
    SurfaceSolution,
    diagnose,
    wish_rows,
)
from focusjax.lens import depth_of_field
from focusjax.report import (
    angle,
    close_focus_sentence,
    f_number,
    glass_facts,
    glass_sentences,
    guessed_sentence,
    left_out,
    metres,
    movements,
    quality_facts,
    quality_sentence,
)
from focusjax.shot import SETTING_NAMES, SolvedShot


def print_outcome(console: Console, outcome: job.Outcome, folder: Path) -> None:
    """What a photographer wants to know, in a few lines."""
    lens, camera = outcome.middle_lens, outcome.camera
    sharp = depth_of_field(camera, lens, outcome.config.lens.close_focus)
    ideal = "" if outcome.glass is None else ", if the glass had no aberrations"
    console.print(
        f"[bold]Focus {metres(float(lens.focus_distance()))}, {f_number(float(outcome.settings.f_number))}[/]"
        f"  sharp from {metres(sharp.near)} to {metres(sharp.far)}{ideal}"
    )
    if (close := close_focus_sentence(outcome)) is not None:
        say(console, close)
    moved = movements(outcome)
    if moved["tilt_deg"] or moved["swing_deg"]:
        console.print(
            f"Tilt {angle(moved['tilt_deg'])}, swing {angle(moved['swing_deg'])};"
            f" hinge {metres(moved['hinge_distance_m'])} from the lens",
            highlight=False,
        )
    if moved["rise_mm"] or moved["shift_mm"]:
        console.print(f"Rise {moved['rise_mm']:+.2f} mm, shift {moved['shift_mm']:+.2f} mm", highlight=False)
    if outcome.config.lens.focal_surface is not None:
        console.print("In the middle of the picture; a focal surface sets it from place to place.")
    facts = glass_facts(outcome)
    for sentence in glass_sentences(facts) if facts is not None else ():
        say(console, sentence)
    if outcome.exposure is not None:
        settings, _, text = outcome.exposure
        taken = outcome.photograph
        white = "" if taken is None else f"; {100 * taken.white_share:.1f} % of the picture is white"
        console.print(
            f"{job.shutter(float(settings.time))} at ISO {float(settings.iso):.0f},"
            f" EV {float(settings.exposure_value()):.1f}{white}",
            highlight=False,
        )
        if text is not None:
            say(console, text)
    if outcome.solution is not None:
        console.print(_wishes(outcome.solution))
        console.print("[dim]Blur is a diameter: + behind the focus, - in front of it.[/]", highlight=False)
        for sentence in diagnose(outcome.solution).sentences:
            say(console, sentence)
    if (missing := left_out(outcome)) is not None:
        say(console, missing)
    if outcome.picture is not None and outcome.picture.examined is not None:
        missed, saving = outcome.picture.examined.missed, outcome.picture.examined.saving
        behind = ", not counting what is seen through others" if outcome.picture.examined.see_through else ""
        console.print(
            f"The layers miss {100 * missed.share:.4f} % of the surfaces that rays meet first{behind},"
            f" ± {100 * missed.standard_error:.4f} %. Plain peeling makes {len(saving.plain)} layers, the"
            f" umbra {len(saving.umbra)}, which spares {100 * saving.samples_saved:.0f} % of the samples.",
            highlight=False,
        )
    if outcome.guessed is not None:
        console.print(guessed_sentence(outcome.guessed), highlight=False, markup=False)
    quality = quality_facts(outcome)
    chosen = None if quality is None else quality_sentence(quality)
    if chosen is not None:
        say(console, chosen)
    stages = outcome.seconds | {"compile": sum(outcome.compile_seconds.values())}
    seconds = ", ".join(f"{name.replace('_', ' ')} {duration(value)}" for name, value in stages.items())
    console.print(f"[dim]{seconds}[/]", highlight=False, soft_wrap=True)
    say(console, f"Report: {folder / 'report.html'}")


def print_shot(console: Console, solved: SolvedShot) -> None:
    """How a shot went, in a few lines."""
    solution = solved.solution
    with np.errstate(divide="ignore"):
        focus = 1.0 / solution.settings()["focus_per_m"]
    console.print(
        f"[bold]{solution.count} frames, focus from {metres(float(focus[0]))} to"
        f" {metres(float(focus[-1]))}[/]"
        f" {_how_solved(solution)}",
        highlight=False,
    )
    for name, change in solution.largest_changes().items():
        if change.seen:
            called, unit = SETTING_NAMES[name]
            say(
                console,
                f"{called} changes by at most {change.per_frame:.3g}{' ' * bool(unit)}{unit} per frame, and"
                f" this by {change.per_frame2:.3g}",
            )
    for sentence in solved.diagnosis.sentences:
        say(console, sentence)


def _how_solved(solution: FramesSolution | SurfaceFramesSolution) -> str:
    if not solution.points.names:
        return "by keyframes"
    if isinstance(solution, SurfaceFramesSolution):
        return "in the middle of the picture, surfaces solved together"
    through = "" if solution.glass is None else " through the glass"
    return f"solved together in {int(solution.steps)} steps{through}"


def _wishes(solution: Solution | SurfaceSolution) -> Table:
    table = Table(box=None, header_style="dim", pad_edge=False)
    for heading in WISH_HEADINGS:
        at_end = heading in (WISH_HEADINGS[0], WISH_HEADINGS[-1])
        table.add_column(heading, justify="left" if at_end else "right")
    colours = {"met": Text("met", "green"), "missed": Text("missed", "red")}
    for *said, verdict in wish_rows(solution.table()):
        table.add_row(*(Text(printable(part)) for part in said), colours.get(verdict, Text(verdict)))
    return table
