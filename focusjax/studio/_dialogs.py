"""The dialogs: the config's text, and where to save it."""

from pathlib import Path

from nicegui import ui

from focusjax.studio._document import EditError
from focusjax.studio._elements import named, problem_label
from focusjax.studio._studio import Studio


class TextDialog:
    """The config's text, with what is wrong with it; it opens by itself where the config cannot be used."""

    def __init__(self, studio: Studio):
        """Build it, closed, where NiceGUI is at."""
        self._studio = studio
        self._offered = False
        with ui.dialog() as self._dialog, ui.card().style("width: 820px; max-width: 92vw"):
            self._title = ui.label().classes("fj-title")
            self._problem = problem_label("problem")
            self._area = named(ui.textarea().classes("w-full fj-text"), "text")
            self._area.props("outlined dense spellcheck=false")
            with ui.row().classes("fj-row justify-end"):
                ui.button("Close", on_click=self._dialog.close).props("flat no-caps")
                use = ui.button("Use this text", on_click=self._use)
                named(use, "use").props("unelevated no-caps")

    def open(self) -> None:
        """Show the text as it is now."""
        document = self._studio.session.document
        self._title.text = str(document.path)
        self._area.value = document.text
        self._problem.text = document.problem or self._stopped()
        self._dialog.open()

    def show(self) -> None:
        """Open where the config, or a file that it names, cannot be used, once."""
        if (self._studio.session.document.config is None or self._stopped()) and not self._offered:
            self._offered = True
            self.open()

    def _stopped(self) -> str:
        """Why there is nothing to see at all; empty where there is."""
        state = self._studio.state
        return state.detail if state.word == "problem" and self._studio.answer is None else ""

    def _use(self) -> None:
        try:
            self._studio.apply(lambda session: session.set_text(self._area.value or ""))
        except EditError as error:
            self._problem.text = str(error)
            return
        self._problem.text = ""
        self._dialog.close()


class SaveDialog:
    """The path of a file, for new configs and for copies."""

    def __init__(self, studio: Studio):
        """Build it, closed, where NiceGUI is at."""
        self._studio = studio
        self._replace = ""
        with ui.dialog() as self._dialog, ui.card().style("width: 560px; max-width: 92vw"):
            ui.label("Save as").classes("fj-title")
            self._field = named(ui.input("File").props("outlined dense").classes("w-full"), "file")
            self._field.on("keydown.enter", self._save)
            self._problem = problem_label("unsaved")
            with ui.row().classes("fj-row justify-end"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                save = ui.button("Save", on_click=self._save)
                named(save, "save-as").props("unelevated no-caps")

    def open(self) -> None:
        """Ask for a file; that of the config is offered."""
        self._replace = self._problem.text = ""
        self._field.value = str(self._studio.session.document.path)
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
            return
        self._studio.version += 1
        self._dialog.close()
        ui.notify(f"Saved to {document.path}", type="positive", position="bottom")
