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
) -> None:
    r"""Solve, and write the camera for another program; without [\[focus]] wishes, as the config has it."""
    console, errors = Console(), Console(stderr=True)
    try:
        suffix = target_named(to).suffix
        file = Path("out") / f"{config.stem}{suffix}" if out is None else out
        read = load_config(config, set_ or (), root=root)
        with progress(errors) as report, warnings_printed(errors):
            exported = export_config(
                read, file, to=to, shot=with_shot, approximate=approximate, progress=report
            )
    except (ConfigError, ExportError, ArgumentError) as error:
        fail(errors, error, BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED)
    except Exception as error:
        fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), FAILED)
    for line in exported.sentences:
        say(console, line)
