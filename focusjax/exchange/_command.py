"""The command `focusjax export`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax._arguments import ArgumentError
from focusjax._console import BAD_INPUT, FAILED, fail, say, warnings_printed
from focusjax._options import ConfigArgument, RootOption, SetOption
from focusjax._progress import progress
from focusjax.config import ConfigError, load_config
from focusjax.exchange._export import TARGETS, target_named
from focusjax.exchange._fitting import ExportError
from focusjax.exchange._solved import export_config


def command(
    config: ConfigArgument,
    to: Annotated[str, typer.Option("--to", metavar="|".join(TARGETS), help="The program or format.")],
    with_shot: Annotated[bool, typer.Option("--shot", help=r"All frames of the config's \[shot].")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The file; out/<config's name> by default.")
    ] = None,
    set_: SetOption = None,
    root: RootOption = None,
    approximate: Annotated[
        bool, typer.Option("--approximate", help="Write the nearest camera that the target can have.")
    ] = False,
    name: Annotated[
        str | None, typer.Option("--name", help="What the target calls the camera; the config's title.")
    ] = None,
    metres_per_unit: Annotated[
        float, typer.Option("--metres-per-unit", help="Of a USD stage; 0.01 for centimetres.")
    ] = 1.0,
    up_axis: Annotated[str, typer.Option("--up-axis", metavar="Y|Z", help="Of a USD stage.")] = "Y",
) -> None:
    r"""Solve, and write the camera for another program; without [\[focus]] wishes, as the config has it."""
    console, errors = Console(), Console(stderr=True)
    try:
        suffix = target_named(to).suffix
        file = Path("out") / f"{config.stem}{suffix}" if out is None else out
        read = load_config(config, set_ or (), root=root)
        with progress(errors) as report, warnings_printed(errors):
            exported = export_config(
                read,
                file,
                to=to,
                shot=with_shot,
                approximate=approximate,
                name=name,
                metres_per_unit=metres_per_unit,
                up_axis=up_axis,
                progress=report,
            )
    except (ConfigError, ExportError, ArgumentError) as error:
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    for line in exported.sentences:
        say(console, line)
