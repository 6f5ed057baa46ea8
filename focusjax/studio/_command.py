"""The command `focusjax studio`."""

import importlib.util
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from focusjax._console import fail, say
from focusjax.config import ConfigError

_BAD_INPUT = 2
_INSTALL = "the page needs NiceGUI, which is not installed; install it with: pip install 'focusjax[studio]'"


def command(
    config: Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")],
    root: Annotated[
        Path | None,
        typer.Option(
            "--root", metavar="DIR", help="Folder below which a config may name files; its own by default."
        ),
    ] = None,
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
        fail(errors, ModuleNotFoundError(_INSTALL), _BAD_INPUT)
    from focusjax.studio._serve import serve
    from focusjax.studio._session import Session
    from focusjax.studio._studio import Studio

    try:
        session = Session(config, root=root)
    except ConfigError as error:
        fail(errors, error, _BAD_INPUT)
    studio = Studio(session)
    studio.warm_up()
    serve(
        studio,
        host=host,
        port=port,
        show=show,
        tell=lambda address: say(console, f"Studio: {address}  (Ctrl-C stops it)"),
    )
