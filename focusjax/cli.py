"""The command line: `focusjax run`, `render`, `refocus`, `batch`, `shot`, `studio`, `export`, and more."""

import logging
import os
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import jax
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from focusjax import __version__, batch, bench, charts, exchange, hard_cases, job, stack, studio
from focusjax._arguments import ArgumentError
from focusjax._console import fail, say, warnings_told
from focusjax._refocus import refocus_config
from focusjax._tell import comparison, tell_outcome, tell_shot
from focusjax.config import Config, ConfigError, load_config
from focusjax.io import staged_folder
from focusjax.report import FILES, save_outcome
from focusjax.shot import film

FAILED, BAD_INPUT, MISSED = 1, 2, 3
"""Exit statuses beside 0: failed; bad usage or config; solved, but a wish is missed."""

_STAGES = {
    "load": "Loading meshes",
    "locate": "Finding focus points",
    "locate_again": "Finding depths",
    "solve": "Solving",
    "peel": "Peeling layers",
    "plan": "Planning rays",
    "render": "Tracing rays",
    "examine": "Examining the picture",
    "guess": "Counting what was guessed",
    "pinhole": "Sharp view",
    "develop": "Developing",
    "expose": "Adding frames up",
    "film": "Writing the film",
    "save": "Writing files",
}

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)
bench_app = typer.Typer(help="Measure focusjax beside other methods.", no_args_is_help=True)
app.command("batch")(batch.command)
app.command("lens")(charts.command)
app.command("stack")(stack.command)
app.command("studio")(studio.command)
app.add_typer(bench_app, name="bench")
bench_app.command("hard-cases")(hard_cases.command)
ConfigArgument = Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results; out/<config's name> by default.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the config, e.g. render.rays=16."),
]
RootOption = Annotated[
    Path | None,
    typer.Option(
        "--root", metavar="DIR", help="Folder below which a config may name files; its own by default."
    ),
]


def _tell_versions(wanted: bool) -> bool:
    """Prints what a report of a fault needs, and ends the program."""
    if wanted:
        python = platform.python_version()
        typer.echo(f"focusjax {__version__} (jax {jax.__version__}, Python {python}, {platform.system()})")
        raise typer.Exit
    return wanted


@app.callback()
def focusjax(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_tell_versions, is_eager=True, help="Show the versions, and exit."
        ),
    ] = False,
) -> None:
    """Say what should be sharp; get the lens settings and the picture."""


@app.command()
def run(
    config: ConfigArgument, out: OutOption = None, set_: SetOption = None, root: RootOption = None
) -> None:
    """Solve for the lens settings, then render the picture."""
    _do(config, out, set_, root, solving=True, rendering=True)


@app.command()
def solve(
    config: ConfigArgument, out: OutOption = None, set_: SetOption = None, root: RootOption = None
) -> None:
    """Solve for the lens settings only."""
    _do(config, out, set_, root, solving=True, rendering=False)


@app.command()
def render(
    config: ConfigArgument, out: OutOption = None, set_: SetOption = None, root: RootOption = None
) -> None:
    """Render with the lens as the config has it."""
    _do(config, out, set_, root, solving=False, rendering=True)


@app.command()
def refocus(
    photo: Annotated[
        Path, typer.Argument(help="A photograph with depth: jpg, png, heic or exr.", metavar="PHOTO")
    ],
    depth: Annotated[
        Path | None, typer.Option("--depth", help="Its depth map, where that is a file of its own.")
    ] = None,
    depth_unit: Annotated[
        str | None, typer.Option("--depth-unit", metavar="m|mm|1/m|px|relative", help="What its values are.")
    ] = None,
    depth_scale: Annotated[
        float | None, typer.Option("--depth-scale", help="What a stored value of 1 is in that unit.")
    ] = None,
    depth_invalid: Annotated[
        float | None, typer.Option("--depth-invalid", help="The stored value that marks holes.")
    ] = None,
    depth_focal_px: Annotated[
        float | None, typer.Option("--depth-focal-px", help="For px: focal length in the depth map's pixels.")
    ] = None,
    depth_offset_px: Annotated[
        float | None, typer.Option("--depth-offset-px", help="For px: what is added to disparities.")
    ] = None,
    baseline_m: Annotated[
        float | None, typer.Option("--baseline-m", help="For px: distance of the two cameras in metres.")
    ] = None,
    anchor: Annotated[
        list[str] | None,
        typer.Option("--anchor", metavar="X,Y,METRES", help="For relative: a known distance; give two."),
    ] = None,
    focal_length_35mm: Annotated[
        float | None, typer.Option("--focal-length-35mm", help="mm as on 36 x 24 mm film, if EXIF has none.")
    ] = None,
    focal_length_px: Annotated[
        float | None, typer.Option("--focal-length-px", help="The same in pixels of the photograph.")
    ] = None,
    sharp: Annotated[
        list[str] | None, typer.Option("--sharp", metavar="X,Y", help="A pixel to be sharp; may be repeated.")
    ] = None,
    blur: Annotated[
        list[str] | None,
        typer.Option("--blur", metavar="X,Y=N", help="A pixel to be blurred by N pixels; may be repeated."),
    ] = None,
    focus_distance: Annotated[
        float | None, typer.Option("--focus-distance", help="Metres, in place of wishes.")
    ] = None,
    f_number: Annotated[
        float | None, typer.Option("--f-number", help="Of a lens on 36 x 24 mm film; left out, solved for.")
    ] = None,
    highlight_stops: Annotated[
        float | None, typer.Option("--highlight-stops", help="How much brighter white is than it was stored.")
    ] = None,
    out: OutOption = None,
    set_: SetOption = None,
) -> None:
    """Refocus a photograph with depth."""

    def read() -> Config:
        settings = {
            "depth_unit": depth_unit,
            "depth_scale": depth_scale,
            "depth_invalid": depth_invalid,
            "depth_focal_px": depth_focal_px,
            "depth_offset_px": depth_offset_px,
            "baseline_m": baseline_m,
            "focal_length_35mm": focal_length_35mm,
            "focal_length_px": focal_length_px,
            "highlight_stops": highlight_stops,
        }
        return refocus_config(
            photo,
            depth,
            settings,
            sharp=sharp or (),
            blur=blur or (),
            anchors=anchor or (),
            focus_distance_m=focus_distance,
            f_number=f_number,
            overrides=set_ or (),
        )

    folder = out if out is not None else Path("out") / photo.stem
    _carry_out(read, folder, solving=focus_distance is None, rendering=True)


@app.command()
def shot(
    config: ConfigArgument,
    out: OutOption = None,
    set_: SetOption = None,
    root: RootOption = None,
    solve_only: Annotated[bool, typer.Option("--solve-only", help="Solve, and make no pictures.")] = False,
    frames: Annotated[
        str | None, typer.Option("--frames", metavar="N,N,...", help="Make pictures of these frames only.")
    ] = None,
) -> None:
    r"""Solve all frames of a \[shot] together, then render them; frames that are there already are kept."""
    console, errors = Console(), Console(stderr=True)
    folder = out if out is not None else Path("out") / config.stem
    try:
        read = load_config(config, set_ or (), root=root)
        chosen = None if frames is None else _frames(frames)
        with _progress(errors) as tell, warnings_told(errors):
            solved, _ = film(read, folder, rendering=not solve_only, frames=chosen, progress=tell)
    except ConfigError as error:
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, folder)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    tell_shot(console, solved)
    say(console, f"Report: {folder / 'report.html'}")
    if solved.missed():
        raise typer.Exit(MISSED)


@app.command()
def export(
    config: ConfigArgument,
    to: Annotated[
        str, typer.Option("--to", metavar="|".join(exchange.TARGETS), help="The program or format.")
    ],
    with_shot: Annotated[bool, typer.Option("--shot", help=r"All frames of the config's \[shot].")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The file; out/<config's name> by default.")
    ] = None,
    set_: SetOption = None,
    root: RootOption = None,
    approximate: Annotated[
        bool, typer.Option("--approximate", help="Write the nearest camera that the target can have.")
    ] = False,
) -> None:
    r"""Solve, and write the camera for another program; without [\[focus]] wishes, as the config has it."""
    console, errors = Console(), Console(stderr=True)
    try:
        suffix = exchange.target_named(to).suffix
        file = Path("out") / f"{config.stem}{suffix}" if out is None else out
        read = load_config(config, set_ or (), root=root)
        with _progress(errors) as tell, warnings_told(errors):
            exported = exchange.export_config(
                read, file, to=to, shot=with_shot, approximate=approximate, progress=tell
            )
    except (ConfigError, exchange.ExportError, ArgumentError) as error:
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    for line in exported.sentences:
        say(console, line)


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
    root: RootOption = None,
) -> None:
    """Report the speed of every method against its error, on the scenes of some configs."""
    console, errors = Console(), Console(stderr=True)
    try:
        chosen = bench.chosen_methods(methods or ())
        pixels = None if size is None else _size(size)
        read = [load_config(path, root=root) for path in configs]
        with (
            staged_folder(out, owned=bench.FILES) as stage,
            _progress(errors) as tell,
            warnings_told(errors),
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
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, out)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    for found in results.cases:
        console.print(comparison(found))
    say(console, f"Report: {out / 'report.html'}")
    failures = [why for found in (*results.cases, results) for why in found.failures.values()]
    if failures:
        fail(errors, ValueError("; ".join(failures)), FAILED)


def main() -> None:
    """Entry point of the `focusjax` command."""
    _set_up_jax()
    _quieten()
    app()


def _do(
    config_path: Path,
    out: Path | None,
    overrides: list[str] | None,
    root: Path | None,
    *,
    solving: bool,
    rendering: bool,
) -> None:
    """One command, from config to exit status."""
    folder = out if out is not None else Path("out") / config_path.stem
    _carry_out(
        lambda: load_config(config_path, overrides or (), root=root),
        folder,
        solving=solving,
        rendering=rendering,
    )


def _carry_out(read: Callable[[], Config], folder: Path, *, solving: bool, rendering: bool) -> None:
    """What a config asks for, into `folder`, to exit status."""
    console, errors = Console(), Console(stderr=True)
    try:
        config = read()
        with staged_folder(folder, owned=FILES) as stage, _progress(errors) as tell, warnings_told(errors):
            outcome = job.run(config, solving=solving, rendering=rendering, progress=tell)
            tell("save", None)
            save_outcome(stage, outcome)
    except ConfigError as error:
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, folder)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    tell_outcome(console, outcome, folder)
    if outcome.solution is not None and not all(
        row.met or not row.counts for row in outcome.solution.table()
    ):
        raise typer.Exit(MISSED)


def _frames(text: str) -> list[int]:
    """Frame numbers from text such as 1,24,48."""
    parts = text.split(",")
    if not all(part.strip().isdecimal() for part in parts):
        raise ConfigError(f"--frames is {text}; expected frame numbers such as 1,24,48")
    return [int(part) for part in parts]


def _size(text: str) -> tuple[int, int]:
    """Width and height from text such as 800x600."""
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise bench.ChoiceError(f"--size is {text}; expected width and height in pixels, such as 800x600")
    return int(width), int(height)


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


def _set_up_jax() -> None:
    """Keep compiled programs between runs; JAX_ENABLE_COMPILATION_CACHE=0 turns that off."""
    if "JAX_COMPILATION_CACHE_DIR" in os.environ or os.environ.get("JAX_ENABLE_COMPILATION_CACHE") in (
        "0",
        "false",
    ):
        return
    jax.config.update("jax_compilation_cache_dir", str(_caches() / "compiled"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


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
