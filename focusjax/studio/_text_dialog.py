"""The config's text, with what is wrong with it beside it."""

from nicegui import ui

from focusjax.studio._document import EditError
from focusjax.studio._studio import Studio


class TextDialog:
    """A dialog with the text; it opens by itself where the config cannot be used."""

    def __init__(self, studio: Studio):
        """Build it, closed, where NiceGUI is at."""
        self._studio = studio
        self._offered = False
        with ui.dialog() as self._dialog, ui.card().style("width: 820px; max-width: 92vw"):
            self._title = ui.label().classes("fj-title")
            self._problem = (
                ui.label().classes("fj-way").mark("problem").classes("at-problem").props('role="alert"')
            )
            self._area = (
                ui.textarea()
                .classes("w-full fj-text")
                .props("outlined dense spellcheck=false")
                .mark("text")
                .classes("at-text")
            )
            with ui.row().classes("fj-row justify-end"):
                ui.button("Close", on_click=self._dialog.close).props("flat no-caps")
                ui.button("Use this text", on_click=self._use).props("unelevated no-caps").mark(
                    "use"
                ).classes("at-use")

    def open(self) -> None:
        """Show the text as it is now."""
        document = self._studio.session.document
        self._title.text = str(document.path)
        self._area.value = document.text
        self._show_problem(document.problem or self._stopped())
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
            self._show_problem(str(error))
            return
        self._show_problem("")
        self._dialog.close()

    def _show_problem(self, problem: str) -> None:
        self._problem.text = problem
        self._problem.set_visibility(bool(problem))
