"""The command `focusjax studio`."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax.config import ConfigError

_BAD_INPUT = 2
_INSTALL = "the page needs NiceGUI, which is not installed; install it with: pip install 'focusjax[studio]'"


def command(
    config: Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")],
    host: Annotated[
        str | None,
        typer.Option("--host", help="Listen there for other machines, too; the address then has a token."),
    ] = None,
    port: Annotated[int, typer.Option("--port", help="The server's port.", min=1, max=65535)] = 8123,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
) -> None:
    """Click what should be sharp on a page in the browser, and see the lens and the picture."""
    console, errors = Console(), Console(stderr=True)
    if importlib.util.find_spec("nicegui") is None:
        _fail(errors, _INSTALL)
    from focusjax.studio._serve import serve
    from focusjax.studio._session import Session
    from focusjax.studio._studio import Studio

    try:
        session = Session(config)
    except ConfigError as error:
        _fail(errors, str(error))
    studio = Studio(session)
    studio.warm_up()
    serve(
        studio,
        host=host,
        port=port,
        show=show,
        tell=lambda address: console.print(
            f"Studio: {address}  (Ctrl-C stops it)", soft_wrap=True, highlight=False
        ),
    )


def _fail(console: Console, text: str) -> None:
    console.print(f"focusjax: {text}", soft_wrap=True, highlight=False, markup=False)
    raise typer.Exit(_BAD_INPUT)
