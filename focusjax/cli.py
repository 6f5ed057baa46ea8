"""The command line: `focusjax run`, `render`, `refocus`, `batch`, `shot`, `studio`, `export`, and more."""

import atexit
import gc
import importlib.metadata
import logging
import os
import platform
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax._console import BAD_INPUT, FAILED, caches, fail, say, talk_of
from focusjax._later import Later, group_of
from focusjax._options import (
    AnchorsOption,
    ConfigArgument,
    JobsOption,
    OutOption,
    QuietOption,
    RootOption,
    SchedulerOption,
    SetOption,
    VerboseOption,
)

LATER = {
    "export": Later(
        "focusjax.exchange._command",
        r"Solve, and write the camera for another program; without [\[focus]] wishes, as the config has it.",
    ),
    "batch": Later("focusjax.batch", "Solve and render many configs, or one with many settings."),
    "dataset": Later(
        "focusjax.dataset._command",
        "Make random pictures with depth, blur and their sharp twins, to learn from.",
    ),
    "lens": Later(
        "focusjax.charts",
        "Draw a real lens: cross-section, spots, highlights, focus and distortion; list its first-order "
        "data.",
    ),
    "stack": Later(
        "focusjax.stack",
        "Plan the fewest shots that make every sharp wish sharp in one of them, take them, and merge them.",
    ),
    "studio": Later(
        "focusjax.studio",
        "Click what should be sharp on a page in the browser, and see the lens and the picture.",
    ),
}
"""Commands of packages; see `Later`."""

LATER_OF_BENCH = {
    "speed-error": Later(
        "focusjax.bench._command",
        "Report the speed of every method against its error, on the scenes of some configs.",
    ),
    "hard-cases": Later(
        "focusjax.hard_cases",
        "Check wishes, glass and pictures that are numerically hard, in both precisions, against the truth.",
    ),
}

app = typer.Typer(cls=group_of(LATER), no_args_is_help=True, pretty_exceptions_enable=False)
bench_app = typer.Typer(
    cls=group_of(LATER_OF_BENCH), help="Measure focusjax beside other methods.", no_args_is_help=True
)
app.add_typer(bench_app, name="bench")


@bench_app.callback()
def _bench() -> None:
    """Measure focusjax beside other methods."""


def _print_versions(wanted: bool) -> bool:
    """Prints what a report of a fault needs, and ends the program."""
    if wanted:
        from focusjax import __version__

        jax, python = importlib.metadata.version("jax"), platform.python_version()
        typer.echo(f"focusjax {__version__} (jax {jax}, Python {python}, {platform.system()})")
        raise typer.Exit
    return wanted


@app.callback()
def focusjax(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_versions, is_eager=True, help="Show the versions, and exit."
        ),
    ] = False,
) -> None:
    """Say what should be sharp; get the lens settings and the picture."""


@app.command()
def run(
    config: ConfigArgument,
    out: OutOption = None,
    set_: SetOption = None,
    root: RootOption = None,
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
) -> None:
    """Solve for the lens settings, then render the picture."""
    _do(config, out, set_, root, quiet, verbose, solving=True, rendering=True)


@app.command()
def solve(
    config: ConfigArgument,
    out: OutOption = None,
    set_: SetOption = None,
    root: RootOption = None,
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
) -> None:
    """Solve for the lens settings only."""
    _do(config, out, set_, root, quiet, verbose, solving=True, rendering=False)


@app.command()
def render(
    config: ConfigArgument,
    out: OutOption = None,
    set_: SetOption = None,
    root: RootOption = None,
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
) -> None:
    """Render with the lens as the config has it."""
    _do(config, out, set_, root, quiet, verbose, solving=False, rendering=True)


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
    anchor: AnchorsOption = None,
    focal_length_35mm: Annotated[
        float | None, typer.Option("--focal-length-35mm", help="mm as on 36 x 24 mm film, if EXIF has none.")
    ] = None,
    focal_length_px: Annotated[
        float | None, typer.Option("--focal-length-px", help="The same in pixels of the photograph.")
    ] = None,
    sharp: Annotated[
        list[str] | None,
        typer.Option(
            "--sharp",
            metavar="X,Y",
            help="A pixel to be sharp, of the picture that is made: of the smaller one with --set"
            " camera.resolution; may be repeated.",
        ),
    ] = None,
    blur: Annotated[
        list[str] | None,
        typer.Option(
            "--blur",
            metavar="X,Y=N",
            help="A pixel to be blurred by N pixels, counted as for --sharp; may be repeated.",
        ),
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
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
) -> None:
    """Refocus a photograph with depth."""
    from focusjax._carry_out import carry_out
    from focusjax._photo_options import in_options
    from focusjax._refocus import refocus_config
    from focusjax.config import Config

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

    carry_out(
        read,
        out or Path("out") / photo.stem,
        solving=focus_distance is None,
        rendering=True,
        talk=talk_of(quiet, verbose),
        reword=in_options,
    )


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
    jobs: JobsOption = 1,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
) -> None:
    r"""Solve all frames of a \[shot] together, then render them; frames that are there already are kept."""
    from focusjax._carry_out import carry_out_shot
    from focusjax.config import load_config

    carry_out_shot(
        lambda: load_config(config, set_ or (), root=root),
        out or Path("out") / config.stem,
        rendering=not solve_only,
        frames=frames,
        jobs=jobs,
        scheduler=scheduler,
        talk=talk_of(quiet, verbose),
    )


@app.command()
def new(
    name: Annotated[
        Path, typer.Argument(help="The folder to make; the config in it is called the same.", metavar="NAME")
    ],
) -> None:
    """Make a folder with a commented config and a small scene to begin with."""
    from focusjax.starter import make_starter

    console, errors = Console(), Console(stderr=True)
    try:
        config = make_starter(name)
    except ValueError as error:
        fail(errors, error, BAD_INPUT)
    except OSError as error:
        fail(errors, error, FAILED, name)
    say(console, f"Made {config}. Try: focusjax run {config}")


@app.command()
def keys(
    table: Annotated[
        str, typer.Argument(help="A table or key, such as lens or focus.blur_px.", metavar="[TABLE]")
    ] = "",
) -> None:
    """List the keys of a config: type, unit, default and meaning; all of them, or those of a table."""
    from focusjax._print_keys import print_keys
    from focusjax.config import ConfigError, config_keys

    try:
        found = config_keys(table)
    except ConfigError as error:
        fail(Console(stderr=True), error, BAD_INPUT)
    print_keys(Console(), found)


@app.command()
def schema(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The file; printed by default.")
    ] = None,
) -> None:
    """Write the JSON Schema of a config, by which editors complete and check it."""
    from focusjax.config import schema_text
    from focusjax.io import replace_file

    if out is None:
        typer.echo(schema_text(), nl=False)
        return
    try:
        replace_file(out, schema_text())
    except OSError as error:
        fail(Console(stderr=True), error, FAILED, out)


def main() -> None:
    """Entry point of the `focusjax` command."""
    # Importing and tracing make millions of objects that stay, which Python would go through again and again.
    gc.set_threshold(50_000, 20, 50)
    # Nor need it look for reference cycles among them when it ends, which takes a second.
    atexit.register(gc.freeze)
    _set_up_jax()
    _quieten()
    app()


def _do(
    config: Path,
    out: Path | None,
    overrides: list[str] | None,
    root: Path | None,
    quiet: bool,
    verbose: bool,
    *,
    solving: bool,
    rendering: bool,
) -> None:
    """One command, from config to exit status."""
    talk = talk_of(quiet, verbose)
    from focusjax._carry_out import carry_out
    from focusjax.config import load_config

    carry_out(
        lambda: load_config(config, overrides or (), root=root),
        out or Path("out") / config.stem,
        solving=solving,
        rendering=rendering,
        talk=talk,
    )


def _set_up_jax() -> None:
    """Keep compiled programs between runs; JAX_ENABLE_COMPILATION_CACHE=0 turns that off.

    By JAX's environment variables, as it is not imported yet.
    """
    # Nobody reads where in the sources a program's operations come from, and XLA takes time for it.
    os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
    off = os.environ.get("JAX_ENABLE_COMPILATION_CACHE") in ("0", "false")
    if "JAX_COMPILATION_CACHE_DIR" in os.environ or off:
        return
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(caches() / "compiled")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")


def _quieten() -> None:
    """Other libraries' notes are for their developers."""
    # Of XLA all but what ends the program: it says by an error, too, that it compiles for long.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    for name in ("jax", "trimesh", "matplotlib", "PIL"):
        logging.getLogger(name).setLevel(logging.ERROR)
    # Dask leaves answers unread that nobody waits for any more.
    logging.getLogger("asyncio").setLevel(logging.CRITICAL)


if __name__ == "__main__":
    sys.exit(main())
