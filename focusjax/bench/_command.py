"""The command `focusjax bench speed-error`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from focusjax._console import BAD_INPUT, FAILED, caches, duration, fail, say, warnings_printed
from focusjax._options import RootOption
from focusjax._progress import progress
from focusjax._words import printable
from focusjax.bench._case import case_from_config
from focusjax.bench._methods import METHODS, ChoiceError, chosen_methods
from focusjax.bench._run import CaseResults, speed_error
from focusjax.bench._save import FILES, save_results
from focusjax.config import ConfigError, load_config
from focusjax.io import staged_folder


def command(
    configs: Annotated[list[Path], typer.Argument(help="TOML files.", metavar="CONFIG...")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the report.")],
    methods: Annotated[
        list[str] | None,
        typer.Option(
            "--methods",
            metavar="NAME[=SETTING,...]",
            help=f"Of {', '.join(method.name for method in METHODS)}; may be repeated.",
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
        chosen = chosen_methods(methods or ())
        pixels = None if size is None else _size(size)
        read = [load_config(path, root=root) for path in configs]
        with (
            staged_folder(out, owned=FILES) as stage,
            progress(errors) as report,
            warnings_printed(errors),
        ):
            report("load", None)
            results = speed_error(
                [case_from_config(config, pixels) for config in read],
                chosen,
                cache=caches() / "references" if cache is None else cache,
                maker=reference,
                samples=reference_samples,
                repeats=repeats,
                progress=report,
            )
            report("save", None)
            save_results(stage, results)
    except (ConfigError, ChoiceError) as error:
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, out)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    for found in results.cases:
        console.print(_comparison(found))
    say(console, f"Report: {out / 'report.html'}")
    failures = [why for found in (*results.cases, results) for why in found.failures.values()]
    if failures:
        fail(errors, ValueError("; ".join(failures)), FAILED)


def _size(text: str) -> tuple[int, int]:
    """Width and height from text such as 800x600."""
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise ChoiceError(f"--size is {text}; expected width and height in pixels, such as 800x600")
    return int(width), int(height)


def _comparison(found: CaseResults) -> Table:
    """What a scene's measurements say, a line for each setting."""
    dropped = found.reference.dropped
    caption = f"samples of the reference that are not finite and left out: {dropped}" if dropped else None
    table = Table(
        title=Text(printable(found.case.title)),
        caption=caption,
        box=None,
        header_style="dim",
        pad_edge=False,
        title_justify="left",
        caption_justify="left",
    )
    for heading in ("method", "setting", "picture", "set-up", "MiB", "PSNR", "SSIM", "silhouettes"):
        table.add_column(heading, justify="left" if heading in ("method", "setting") else "right")
    for row in found.rows:
        table.add_row(
            row.method,
            f"{row.setting} {row.knob}",
            duration(row.seconds),
            duration(row.setup_seconds),
            f"{row.peak_mib:.0f}",
            f"{row.psnr:.2f} dB",
            "" if row.ssim is None else f"{row.ssim:.4f}",
            "" if row.silhouette_psnr is None else f"{row.silhouette_psnr:.2f} dB",
        )
    return table
