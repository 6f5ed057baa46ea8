"""The start page: configs to begin with, and a field for any other file."""

from pathlib import Path

from nicegui import ui

from focusjax.config import ConfigError
from focusjax.studio._desk import Desk
from focusjax.studio._elements import named, problem_label

_EVERY = 0.3
"""Seconds between looks for new thumbnails."""


class StartPage:
    """Thumbnails that open a studio."""

    def __init__(self, desk: Desk):
        """Build it where NiceGUI is at."""
        assert desk.gallery is not None
        self._desk, self._gallery = desk, desk.gallery
        self._version = 0
        self._pictures: dict[int, ui.image] = {}
        with named(ui.column().classes("fj-start"), "start"):
            ui.label("focusjax studio").classes("fj-start-title")
            ui.label("Choose a scene, then click on what should be sharp.").classes("fj-dim")
            if self._gallery.entries:
                with ui.row().classes("fj-cards"):
                    for number in range(len(self._gallery.entries)):
                        self._card(number)
            else:
                folders = ", ".join(str(folder.absolute()) for folder in self._gallery.folders)
                none = ui.label(
                    f"There is no config in {folders}. The examples come with the repository, not with the"
                    " installed package. Start with a mesh or a photograph with depth of your own instead."
                )
                named(none, "none").classes("fj-way")
            if desk.any_file:
                self._any_file()
            self._problem = problem_label("problem")
        self._show()
        ui.timer(_EVERY, self._show)

    def _card(self, number: int) -> None:
        entry = self._gallery.entries[number]
        with (
            ui.element("button")
            .classes("fj-thumb at-thumb")
            .mark(f"thumb-{entry.path.stem}")
            .props(f'type="button" aria-label="Open {entry.path.name}"')
            .on("click", lambda: self._open(entry.path))
        ):
            with ui.element("div").classes("fj-thumb-picture"):
                self._pictures[number] = ui.image().props('no-spinner fit="cover"').classes("w-full h-full")
            title = f"{entry.title}" + (f" · {entry.frames} frames" if entry.frames else "")
            ui.label(title).classes("fj-thumb-title")
            ui.label(f"{entry.path}" if not entry.problem else f"has errors: {entry.path}").classes("fj-dim")
            ui.tooltip(entry.problem or f"Open {entry.path}")

    def _any_file(self) -> None:
        with ui.row().classes("fj-row").style("max-width: 640px"):
            field = named(ui.input("A config, a mesh, or a photograph with depth"), "path").classes("col")
            field.props("dense outlined").tooltip("The path of a file on this machine")

            def typed() -> None:
                self._open(Path((field.value or "").strip()).expanduser())

            field.on("keydown.enter", typed)
            button = named(ui.button("Open", on_click=typed), "open").props("unelevated no-caps")
            button.tooltip("Open that file")

    def _open(self, path: Path) -> None:
        try:
            self._desk.open([path])
        except ConfigError as error:
            self._problem.text = str(error)
            return
        ui.navigate.reload()

    def _show(self) -> None:
        if self._desk.studio is not None:
            ui.navigate.reload()
            return
        if self._version == self._gallery.version:
            return
        self._version = self._gallery.version
        for number, picture in self._pictures.items():
            if self._gallery.thumbnail(number) is not None and not picture.source:
                picture.set_source(f"/studio/thumbnail/{number}")
