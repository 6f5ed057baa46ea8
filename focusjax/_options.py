"""Arguments and options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

ConfigArgument = Annotated[Path, typer.Argument(help="A TOML file.", metavar="CONFIG")]
OutOption = Annotated[
    Path | None, typer.Option("--out", help="Folder for the results; out/<config's name> by default.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the config, e.g. render.rays=16."),
]
AnchorsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--anchor",
        metavar="X,Y,METRES|VALUE,METRES",
        help="For relative: the distance of a pixel of the photograph's file, or of a value of the depth map"
        " (48,36 is: value 48 is 36 m away); give two of one form.",
    ),
]
RootOption = Annotated[
    Path | None,
    typer.Option(
        "--root", metavar="DIR", help="Folder below which a config may name files; its own by default."
    ),
]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Say warnings and errors only.")]
VerboseOption = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say how long each stage took, and where an error arose.")
]
JobsOption = Annotated[int, typer.Option("--jobs", help="Processes that share the work.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="A Dask scheduler whose workers share the work: tcp://HOST:PORT, or its scheduler file.",
    ),
]
