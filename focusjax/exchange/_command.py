"""The `focusjax export` command."""

import os
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax._arguments import ArgumentError
from focusjax.config import ConfigError, load_config
from focusjax.exchange._export import TARGETS, target_named
from focusjax.exchange._fitting import ExportError
from focusjax.exchange._solved import export_config

_FAILED, _BAD_INPUT = 1, 2


def command(
    config: Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")],
    to: Annotated[str, typer.Option("--to", metavar="|".join(TARGETS), help="The program or format.")],
    shot: Annotated[bool, typer.Option("--shot", help="All frames of the config's [shot].")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="The file; out/<config's name> by default.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the config.")
    ] = None,
    approximate: Annotated[
        bool, typer.Option("--approximate", help="Write the nearest camera that the target can have.")
    ] = False,
) -> None:
    """Solve, and write the camera for another program."""
    console, errors = Console(), Console(stderr=True)
    try:
        target = target_named(to)
        file = Path("out") / f"{config.stem}{target.suffix}" if out is None else out
        read = load_config(config, set_ or ())
        exported = export_config(read, file, to=to, shot=shot, approximate=approximate)
    except (ConfigError, ExportError, ArgumentError) as error:
        _fail(errors, error, _BAD_INPUT)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        _fail(errors, error, _FAILED)
    except Exception as error:
        _fail(errors, RuntimeError(f"internal error, please report it: {error!r}"), _FAILED)
    if exported.sentence:
        console.print(exported.sentence, soft_wrap=True, highlight=False, markup=False)
    first, last = exported.files[0], exported.files[-1]
    named = f"{first}" if first == last else f"{first} to {os.path.basename(last)}"
    console.print(f"Camera: {named}", soft_wrap=True, highlight=False, markup=False)


def _fail(console: Console, error: BaseException, status: int) -> None:
    text = " ".join(str(error).split("\n\n")[0].split()) or type(error).__name__
    console.print(f"focusjax: {text}", soft_wrap=True, highlight=False, markup=False)
    raise typer.Exit(status)
