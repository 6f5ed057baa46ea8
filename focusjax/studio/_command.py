"""The command `focusjax studio`."""

import importlib.util
import socket
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from focusjax._console import BAD_INPUT, fail, say
from focusjax._options import AnchorsOption, RootOption
from focusjax._photo_options import STUDIO, in_options
from focusjax._refocus import anchors_of
from focusjax.config import ConfigError

_INSTALL = "the page needs NiceGUI, which is not installed; install it with: pip install 'focusjax[studio]'"
_PORTS = range(8123, 8143)
"""Tried one after another where none is asked for."""


def _free_port(host: str, port: int | None) -> int:
    """The port that is asked for, or a free one.

    Raises:
        OSError: nothing can listen there; the message says what to change.
    """
    for each in _PORTS if port is None else (port,):
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind((host, each))
            except socket.gaierror:
                raise OSError(f"--host {host}: this is no address of this machine; try 0.0.0.0") from None
            except OSError as error:
                problem = error.strerror
            else:
                return each
    which = f"--port {port}" if port is not None else f"ports {_PORTS.start} to {_PORTS.stop - 1}"
    raise OSError(f"{which} at {host}: cannot be listened to ({problem}); choose another with --port")


def _in_words(message: str, files: list[Path]) -> str:
    """A message with the options of this command, unless a config is opened, which has keys."""
    return message if files[0].suffix.lower() == ".toml" else in_options(message, STUDIO)


def command(
    files: Annotated[
        list[Path] | None,
        typer.Argument(help="A config (TOML), meshes, or a photograph with depth.", metavar="[FILE]..."),
    ] = None,
    depth: Annotated[
        Path | None, typer.Option("--depth", metavar="FILE", help="A photograph's depth map.")
    ] = None,
    depth_unit: Annotated[
        str | None,
        typer.Option("--depth-unit", metavar="UNIT", help="What it has: m, mm, 1/m, px, relative."),
    ] = None,
    depth_scale: Annotated[
        float | None, typer.Option("--depth-scale", metavar="X", help="What a stored 1 is in that unit.")
    ] = None,
    anchors: AnchorsOption = None,
    focal_length_35mm: Annotated[
        float | None,
        typer.Option("--focal-length-35mm", metavar="MM", help="A photograph's, as on 36 x 24 mm film."),
    ] = None,
    root: RootOption = None,
    host: Annotated[
        str | None,
        typer.Option("--host", help="Listen there for other machines, too; the address then has a token."),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option("--port", help="The server's port; a free one by default.", min=1, max=65535),
    ] = None,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
) -> None:
    """Click what should be sharp on a page in the browser, and see the lens and the picture."""
    console, errors = Console(), Console(stderr=True)
    if importlib.util.find_spec("nicegui") is None:
        fail(errors, ModuleNotFoundError(_INSTALL), BAD_INPUT)
    from focusjax.studio._desk import Desk
    from focusjax.studio._gallery import Gallery
    from focusjax.studio._serve import LOCAL, serve

    try:
        chosen = _free_port(LOCAL if host is None else host, port)
        known = anchors_of(anchors or ())
    except (OSError, ConfigError) as error:
        fail(errors, error, BAD_INPUT)
    photo: dict[str, Any] = {
        "depth": None if depth is None else str(depth),
        "anchors": known or None,
        "depth_unit": depth_unit,
        "depth_scale": depth_scale,
        "focal_length_35mm": focal_length_35mm,
    }
    desk = Desk(gallery=None if files else Gallery(), any_file=host is None)
    if files:
        try:
            desk.open(files, root=root, photo=photo)
        except ConfigError as error:
            fail(errors, ConfigError(_in_words(str(error), files)), BAD_INPUT)
    serve(
        desk,
        host=host,
        port=chosen,
        show=show,
        announce=lambda address: say(console, f"Studio: {address}  (Ctrl-C stops it)"),
    )
