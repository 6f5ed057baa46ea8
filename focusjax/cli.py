"""The command line: `focusjax run`, `solve`, `render`, `batch`, `shot` and `bench`."""

import logging
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import jax
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from focusjax import batch, bench, job
from focusjax.config import ConfigError, load_config
from focusjax.focus import Solution, SurfaceSolution, WishResult, diagnose
from focusjax.io import staged_folder
from focusjax.report import FILES, angle, depth_of_field, f_number, metres, movements, save_outcome
from focusjax.shot import SolvedShot, film

FAILED, BAD_INPUT, MISSED = 1, 2, 3
"""Exit statuses beside 0: failed; bad usage or config; solved, but a wish is missed."""

_STAGES = {
    "load": "Loading meshes",
    "locate": "Finding focus points",
    "locate_again": "Finding depths",
    "solve": "Solving",
    "solve_first": "Solving",
    "peel": "Peeling layers",
    "plan": "Planning rays",
    "render": "Tracing rays",
    "examine": "Examining the picture",
    "pinhole": "Sharp view",
    "film": "Writing the film",
    "save": "Writing files",
}

app = typer.Typer(
    help="Say what should be sharp; get the lens settings and the picture.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
bench_app = typer.Typer(help="Measure focusjax beside other methods.", no_args_is_help=True)
app.command("batch")(batch.command)
app.add_typer(bench_app, name="bench")
ConfigArgument = Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results; out/<config's name> by default.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the config, e.g. render.rays=16."),
]


@app.command()
def run(config: ConfigArgument, out: OutOption = None, set_: SetOption = None) -> None:
    """Solve for the lens settings, then render the picture."""
    _do(config, out, set_, solving=True, rendering=True)


@app.command()
def solve(config: ConfigArgument, out: OutOption = None, set_: SetOption = None) -> None:
    """Solve for the lens settings only."""
    _do(config, out, set_, solving=True, rendering=False)


@app.command()
def render(config: ConfigArgument, out: OutOption = None, set_: SetOption = None) -> None:
    """Render with the lens as the config has it."""
    _do(config, out, set_, solving=False, rendering=True)


@app.command()
def shot(
    config: ConfigArgument,
    out: OutOption = None,
    set_: SetOption = None,
    solve_only: Annotated[bool, typer.Option("--solve-only", help="Solve, and make no pictures.")] = False,
    frames: Annotated[
        str | None, typer.Option("--frames", metavar="N,N,...", help="Make pictures of these frames only.")
    ] = None,
) -> None:
    """Solve all frames of a [shot] together, then render them; frames that are there already are kept."""
    console, errors = Console(), Console(stderr=True)
    folder = out if out is not None else Path("out") / config.stem
    try:
        read = load_config(config, set_ or ())
        chosen = None if frames is None else _frames(frames)
        with _progress(errors) as tell, _warnings_told(errors):
            solved, _ = film(read, folder, rendering=not solve_only, frames=chosen, progress=tell)
    except ConfigError as error:
        _fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        _fail(errors, error, FAILED)
    except Exception as error:
        _fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    _tell_shot(console, solved)
    console.print(f"Report: {folder / 'report.html'}", soft_wrap=True, highlight=False)
    if solved.missed():
        raise typer.Exit(MISSED)


@bench_app.command("speed-error")
def speed_error(
    configs: Annotated[list[Path], typer.Argument(help="TOML files.", metavar="CONFIG...")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the report.")],
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--methods",
            metavar="NAME[=SETTING,...]",
            help=f"Of {', '.join(method.name for method in bench.METHODS)}; may be repeated.",
        ),
    ] = None,
    size: Annotated[
        str | None, typer.Option("--size", metavar="WxH", help="Pixels; the configs' own by default.")
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", help="Timed calls after the first.")] = 3,
    reference: Annotated[
        str | None,
        typer.Option("--reference", metavar="mitsuba|raycast", help="Who makes the converged picture."),
    ] = None,
    reference_samples: Annotated[
        int, typer.Option("--reference-samples", help="Samples per pixel of the converged picture.")
    ] = 2048,
    cache: Annotated[
        Path | None, typer.Option("--cache", help="Folder that keeps converged pictures between runs.")
    ] = None,
) -> None:
    """Report the speed of every method against its error, on the scenes of some configs."""
    console, errors = Console(), Console(stderr=True)
    try:
        chosen = bench.chosen_methods(methods or ())
        pixels = None if size is None else _size(size)
        read = [load_config(path) for path in configs]
        with (
            staged_folder(out, owned=bench.FILES) as stage,
            _progress(errors) as tell,
            _warnings_told(errors),
        ):
            tell("load", None)
            results = bench.speed_error(
                [bench.case_from_config(config, pixels) for config in read],
                chosen,
                cache=_caches() / "references" if cache is None else cache,
                maker=reference,
                samples=reference_samples,
                repeats=repeats,
                progress=tell,
            )
            tell("save", None)
            bench.save_results(stage, results)
    except (ConfigError, bench.ChoiceError) as error:
        _fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        _fail(errors, error, FAILED)
    except Exception as error:
        _fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    for found in results.cases:
        console.print(_comparison(found))
    console.print(f"Report: {out / 'report.html'}", soft_wrap=True, highlight=False)
    failures = [why for found in results.cases for why in found.failures.values()]
    if failures:
        _fail(errors, ValueError("; ".join(failures)), FAILED)


def main() -> None:
    """Entry point of the `focusjax` command."""
    _set_up_jax()
    _quieten()
    app()


def _do(
    config_path: Path, out: Path | None, overrides: list[str] | None, *, solving: bool, rendering: bool
) -> None:
    """One command, from config to exit status."""
    console, errors = Console(), Console(stderr=True)
    folder = out if out is not None else Path("out") / config_path.stem
    try:
        config = load_config(config_path, overrides or ())
        with staged_folder(folder, owned=FILES) as stage, _progress(errors) as tell, _warnings_told(errors):
            outcome = job.run(config, solving=solving, rendering=rendering, progress=tell)
            tell("save", None)
            save_outcome(stage, outcome)
    except ConfigError as error:
        _fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        _fail(errors, error, FAILED)
    except Exception as error:
        _fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    _tell_outcome(console, outcome, folder)
    if outcome.solution is not None and not all(
        row.met or not row.counts for row in outcome.solution.table()
    ):
        raise typer.Exit(MISSED)


def _tell_outcome(console: Console, outcome: job.Outcome, folder: Path) -> None:
    """What a photographer wants to know, in a few lines."""
    lens, camera = outcome.middle_lens, outcome.camera
    sharp = depth_of_field(camera, lens)
    console.print(
        f"[bold]Focus {metres(float(lens.focus_distance()))}, {f_number(float(lens.f_number(camera)))}[/]"
        f"  sharp from {metres(sharp.near)} to {metres(sharp.far)}"
    )
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
    if outcome.solution is not None:
        console.print(_wishes(outcome.solution))
    if isinstance(outcome.solution, Solution):
        for sentence in diagnose(outcome.solution).sentences:
            console.print(sentence, highlight=False, markup=False)
    if outcome.picture is not None and not outcome.picture.complete:
        console.print("Some surfaces did not fit into the layers; raise render.max_layers.")
    stages = outcome.seconds | {"compile": sum(outcome.compile_seconds.values())}
    seconds = ", ".join(f"{name.replace('_', ' ')} {_duration(value)}" for name, value in stages.items())
    console.print(f"[dim]{seconds}[/]", highlight=False, soft_wrap=True)
    console.print(f"Report: {folder / 'report.html'}", soft_wrap=True, highlight=False)


def _tell_shot(console: Console, solved: SolvedShot) -> None:
    """How a shot went, in a few lines."""
    solution = solved.solution
    focus = 1.0 / solution.settings()["focus_per_m"]
    console.print(
        f"[bold]{solution.count} frames, focus from {metres(float(focus[0]))} to"
        f" {metres(float(focus[-1]))}[/]"
        f"  solved together in {int(solution.steps)} steps",
        highlight=False,
    )
    for name, change in solution.largest_changes().items():
        if change.per_frame:
            console.print(
                f"{name}: at most {change.per_frame:.3g} per frame, {change.per_frame2:.3g} per frame^2",
                highlight=False,
            )
    for name, count, error in solved.missed():
        console.print(
            f"{name} is missed in {count} frame{'' if count == 1 else 's'}, by up to {error:.2f} px",
            highlight=False,
            markup=False,
        )


def _frames(text: str) -> list[int]:
    """Frame numbers from text such as 1,24,48."""
    parts = text.split(",")
    if not all(part.strip().isdecimal() for part in parts):
        raise ConfigError(f"--frames is {text}; expected frame numbers such as 1,24,48")
    return [int(part) for part in parts]


def _wishes(solution: Solution | SurfaceSolution) -> Table:
    table = Table(box=None, header_style="dim", pad_edge=False)
    for heading in ("wish", "wished", "got", "missed by", ""):
        table.add_column(heading, justify="left" if heading in ("wish", "") else "right")
    for row in solution.table():
        verdict = "[green]met[/]" if row.met else "[red]missed[/]"
        if not row.counts:
            verdict = row.note or "not counted"
        table.add_row(row.name, _wished(row), f"{row.got:+.2f} px", f"{abs(row.residual):.2f} px", verdict)
    return table


def _wished(row: WishResult) -> str:
    """A wish in a few words."""
    if row.relation == "same":
        return "as another"
    if row.relation == "shown at":
        return "at its place"
    if row.relation == "in frame":
        return f"{row.wished:g} px inside"
    if row.relation != "equal":
        return f"{row.relation} {row.wished:g} px"
    return "sharp" if not row.wished else f"{row.wished:+g} px" if row.signed else f"{row.wished:g} px"


def _comparison(found: bench.CaseResults) -> Table:
    """What a scene's measurements say, a line for each setting."""
    table = Table(title=found.case.title, box=None, header_style="dim", pad_edge=False, title_justify="left")
    for heading in ("method", "setting", "picture", "set-up", "MiB", "PSNR", "SSIM", "silhouettes"):
        table.add_column(heading, justify="left" if heading in ("method", "setting") else "right")
    for row in found.rows:
        table.add_row(
            row.method,
            f"{row.setting} {row.knob}",
            _duration(row.seconds),
            _duration(row.setup_seconds),
            f"{row.peak_mib:.0f}",
            f"{row.psnr:.2f} dB",
            "" if row.ssim is None else f"{row.ssim:.4f}",
            "" if row.silhouette_psnr is None else f"{row.silhouette_psnr:.2f} dB",
        )
    return table


def _size(text: str) -> tuple[int, int]:
    """Width and height from text such as 800x600."""
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise bench.ChoiceError(f"--size is {text}; expected width and height in pixels, such as 800x600")
    return int(width), int(height)


def _duration(seconds: float) -> str:
    return f"{1000 * seconds:.1f} ms" if seconds < 0.1 else f"{seconds:.1f} s"


@contextmanager
def _progress(console: Console) -> Iterator[job.Progress]:
    """A progress bar on a terminal, gone when the run ends; nothing where output goes to a file."""
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    task = bar.add_task("Starting", total=None)
    current = None

    def tell(stage: str, share: float | None) -> None:
        nonlocal current
        if stage != current:
            bar.reset(task, total=None, description=_STAGES.get(stage, stage))
            current = stage
        if share is not None:
            bar.update(task, total=1.0, completed=min(share, 1.0))

    try:
        bar.start()
        yield tell
    finally:
        bar.stop()


@contextmanager
def _warnings_told(console: Console) -> Iterator[None]:
    """Our own warnings as one line each; those of other libraries say nothing to a user."""

    def show(message: Warning | str, category: type[Warning], *rest: object, **more: object) -> None:
        if category is UserWarning:
            console.print(f"Warning: {message}", soft_wrap=True, highlight=False, markup=False)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("default", category=UserWarning, module="focusjax|__main__")
        warnings.showwarning = show
        yield


def _fail(console: Console, error: BaseException, status: int) -> None:
    """The error's first paragraph on one line, and out."""
    text = " ".join(str(error).split("\n\n")[0].split()) or type(error).__name__
    console.print(f"focusjax: {text}", soft_wrap=True, highlight=False, markup=False)
    raise typer.Exit(status)


def _set_up_jax() -> None:
    """Keep compiled programs between runs; JAX_ENABLE_COMPILATION_CACHE=0 turns that off."""
    if "JAX_COMPILATION_CACHE_DIR" in os.environ or os.environ.get("JAX_ENABLE_COMPILATION_CACHE") in (
        "0",
        "false",
    ):
        return
    jax.config.update("jax_compilation_cache_dir", str(_caches() / "compiled"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


def _caches() -> Path:
    """Where focusjax keeps what later runs can use."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "focusjax"


def _quieten() -> None:
    """Other libraries' notes are for their developers."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    for name in ("jax", "trimesh", "matplotlib", "PIL"):
        logging.getLogger(name).setLevel(logging.ERROR)


if __name__ == "__main__":
    sys.exit(main())
