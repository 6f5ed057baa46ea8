"""Where a config is to be saved: a dialog for new ones, and for copies."""

from pathlib import Path

from nicegui import ui

from focusjax.studio._document import EditError
from focusjax.studio._studio import Studio


class SaveDialog:
    """A dialog with the path of a file."""

    def __init__(self, studio: Studio):
        """Build it, closed, where NiceGUI is at."""
        self._studio = studio
        self._replace = ""
        with ui.dialog() as self._dialog, ui.card().style("width: 560px; max-width: 92vw"):
            ui.label("Save as").classes("fj-title")
            self._field = ui.input("File").props("outlined dense").classes("w-full at-file").mark("file")
            self._field.on("keydown.enter", self._save)
            self._problem = ui.label().classes("fj-way").props('role="alert"').classes("at-unsaved")
            with ui.row().classes("fj-row justify-end"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                ui.button("Save", on_click=self._save).props("unelevated no-caps").classes("at-save-as").mark(
                    "save-as"
                )

    def open(self) -> None:
        """Ask for a file; that of the config is offered."""
        self._replace = ""
        self._field.value = str(self._studio.session.document.path)
        self._problem.set_visibility(False)
        self._dialog.open()

    def _save(self) -> None:
        text = (self._field.value or "").strip()
        document = self._studio.session.document
        try:
            if not text:
                raise EditError("there is no file name; give one, such as portrait.toml")
            document.save_as(Path(text).expanduser(), even_if_there=self._replace == text)
        except EditError as error:
            self._replace = text if "save again" in str(error) else ""
            self._problem.text = str(error)
            self._problem.set_visibility(True)
            return
        self._studio.version += 1
        self._dialog.close()
        ui.notify(f"Saved to {document.path}", type="positive", position="bottom")
