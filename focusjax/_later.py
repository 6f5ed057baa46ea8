"""Commands of packages that take long to import, which are imported when such a command runs."""

import importlib
from collections.abc import Mapping
from typing import Any, NamedTuple

import typer
import typer.main
from typer.core import TyperCommand, TyperGroup


class Later(NamedTuple):
    """A command that is found when it runs.

    Attributes:
        module: that holds it, as a function called `command`.
        summary: the first sentence of its help, for the list of commands.
    """

    module: str
    summary: str


def group_of(later: Mapping[str, Later]) -> type[TyperGroup]:
    """A class of groups for `typer.Typer(cls=...)` that have the commands `later`, too, by name."""

    class Group(TyperGroup):
        def __init__(self, **settings: Any):
            super().__init__(**settings)
            for name, each in later.items():
                self.commands[name] = _LaterCommand(name, each)

    return Group


class _LaterCommand(TyperCommand):
    """What the list of commands shows of one; the command itself takes its place when it is called."""

    def __init__(self, name: str, later: Later):
        super().__init__(name, help=later.summary)
        self.module = later.module

    def found(self) -> Any:
        """The command itself."""
        alone = typer.Typer(add_completion=False)
        alone.command(self.name)(importlib.import_module(self.module).command)
        return typer.main.get_command(alone)

    def make_context(self, *args: Any, **settings: Any) -> Any:
        return self.found().make_context(*args, **settings)
