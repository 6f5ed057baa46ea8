"""The page: one picture, its marks and cards, the lens and the wishes beside it. It only shows a studio."""

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import events, run, ui
from nicegui.elements.mixins.value_element import ValueElement

from focusjax._console import sentence
from focusjax.exchange import TARGETS
from focusjax.studio._desk import Desk
from focusjax.studio._dialogs import SaveDialog, TextDialog
from focusjax.studio._document import EditError
from focusjax.studio._elements import named
from focusjax.studio._exposure_panel import ExposurePanel
from focusjax.studio._lens_panel import LensPanel
from focusjax.studio._picture_view import PictureView
from focusjax.studio._session import Session
from focusjax.studio._side_view import Plan, make_plan, side_view
from focusjax.studio._stage import Stage
from focusjax.studio._studio import State, Studio
from focusjax.studio._surface_panel import SurfacePanel
from focusjax.studio._timeline import Timeline
from focusjax.studio._wish_panel import WishPanel

_EVERY = 0.02
"""Seconds between looks for something new."""
_WORDS = {
    "starting": "loading and compiling…",
    "solving": "solving…",
    "solving the shot": "solving the shot",
    "draft": "draft",
    "refining": "refining",
    "refined": "refined",
    "no lens": "no lens yet",
    "problem": "stopped",
}
_WITH_SHARE = ("refining", "solving the shot")
_WORKING = ("starting", "solving", "solving the shot", "draft", "refining")
_LONG_S = 1.5
"""Seconds of solving after which it is because a program is being compiled."""
_KEYS = """Click: new point · drag: move it · arrows: nudge (Shift: 10 px)
Delete: remove · Esc: close the card · N: next wish · Enter: new point in the middle
C, or Shift and click: control point of a focal surface
Space: wipe · B: blur · D: depth · L: layers · Z: zoom · R: render
Ctrl-Z, Ctrl-Y: undo, redo · Ctrl-S: save · shots: P: play · , and .: frames · K: keyframe"""
_STEPS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, -1), "ArrowDown": (0, 1)}


class Page:
    """One tab that shows a studio; several may show the same."""

    def __init__(self, studio: Studio, desk: Desk | None = None):
        """Build the page's elements where NiceGUI is at; `desk` is where the studio is open."""
        self.studio, self._desk = studio, desk
        self._version = -1
        self._refused_edit = False
        self._words, self._since = ("", studio.final.state.word), time.monotonic()
        self._planned: object = None
        self._plan: tuple[Stage, Plan] | None = None
        self._dark = ui.dark_mode(None)
        self._bar()
        with ui.row().classes("fj-body"):
            with ui.column().classes("fj-left"):
                self.picture = PictureView(studio, self.attempt, self._selected)
                self.timeline = Timeline(studio, self.picture, self.attempt)
            with ui.column().classes("fj-panel"):
                self.lens = LensPanel(studio, self.attempt)
                self.surface = SurfacePanel(studio, self.picture, self.attempt)
                self.exposure = ExposurePanel(studio, self.attempt)
                self.wishes = WishPanel(studio, self.picture)
                ui.label("From above").classes("fj-head")
                self._side = named(ui.html("", sanitize=False).classes("w-full"), "above")
                ui.label(_KEYS).classes("fj-dim").style("white-space: pre-line")
        self.text = TextDialog(studio)
        self.saving = SaveDialog(studio)
        ui.keyboard(on_key=self._on_key, ignore=["input", "select", "textarea"])
        self._warned = ""
        if studio.session.document.recovered:
            ui.notify(
                "Changes that were not saved last time are here again. Undo goes back to the file.",
                type="info", position="bottom", multi_line=True, timeout=8000,
            )  # fmt: skip
        self.look()
        ui.timer(_EVERY, self.look)

    def attempt(self, edit: Callable[[Session], object]) -> object:
        """Change the session; a notice says why an edit is refused, which then changes nothing."""
        try:
            return self.studio.apply(edit)
        except EditError as error:
            ui.notify(str(error), type="warning", position="bottom", multi_line=True)
            self._refused_edit = True
            self.studio.version += 1
        return None

    def look(self) -> None:
        """Show what is new."""
        studio = self.studio
        if self._desk is not None and self._desk.studio is not studio:
            # Another tab has opened something else, or left it.
            ui.navigate.reload()
            return
        if self._version == studio.version:
            long = time.monotonic() - self._since > _LONG_S
            if long and studio.state.word == "solving" and not studio.final.busy:
                self._state.text = "solving, compiling once…"
            # The view from above comes after what was just shown is on its way.
            self._show_from_above()
            return
        if studio.warning != self._warned:
            self._warned = studio.warning
            ui.notify(studio.warning, type="warning", position="bottom", multi_line=True)
        self._version = studio.version
        document, state = studio.session.document, studio.state
        self._show_state(state)
        self._name.text = document.path.name + (" • unsaved" if document.unsaved else "")
        self._undo.set_enabled(document.can_undo)
        self._redo.set_enabled(document.can_redo)
        self.picture.show()
        self.timeline.show()
        self.lens.show()
        self.surface.show()
        self.exposure.show()
        self.wishes.show()
        self.text.show()
        if self._refused_edit:
            # A browser's field keeps what was typed unless it is sent the value that holds.
            self._refused_edit = False
            for element in list(ui.context.client.elements.values()):
                if isinstance(element, ValueElement):
                    element.update()

    def _show_state(self, state: State) -> None:
        """What the picture is, or how far the final one is."""
        final = self.studio.final.state
        if (state.word, final.word) != self._words:
            if final.word != self._words[1] and final.word in ("rendered", "cancelled", "failed"):
                ui.notify(
                    final.detail,
                    type="positive" if final.word == "rendered" else "warning",
                    position="bottom",
                    multi_line=True,
                    timeout=8000,
                )
            self._words = state.word, final.word
            self._since = time.monotonic()
        if self.studio.final.busy:
            share = f" {100 * final.share:.0f} %" if final.share else ""
            self._state.text = f"rendering{share}: {final.detail}"
        else:
            share = f" {100 * state.share:.0f} %" if state.word in _WITH_SHARE else ""
            self._state.text = f"{_WORDS[state.word]}{share}"
        self._progress.set_visibility(state.word in _WORKING or self.studio.final.busy)

    def save(self) -> None:
        """Write the config to its file, or ask for one; a second time over what others wrote."""
        document = self.studio.session.document
        if document.new:
            self.saving.open()
            return
        try:
            document.save(even_if_changed=self._refused)
        except EditError as error:
            self._refused = "changed by something else" in str(error)
            ui.notify(str(error), type="warning", position="bottom", multi_line=True)
            return
        self._refused = False
        self.studio.version += 1
        ui.notify(f"Saved to {document.path}", type="positive", position="bottom")

    def _bar(self) -> None:
        with ui.row().classes("fj-bar"):
            if self._desk is not None and self._desk.gallery is not None:
                _button("home", "Back to the start page", self._leave)
            config = self.studio.session.document.config
            title = (config.title if config is not None else "") or "focusjax studio"
            ui.label(title).classes("fj-title")
            self._name = ui.label().classes("fj-dim")
            ui.space()
            self._progress = ui.spinner(size="16px").props('aria-label="working"')
            self._state = named(ui.label().classes("fj-state").props('role="status"'), "state")
            self._undo = _button("undo", "Take the last change back (Ctrl-Z)", lambda: self._step("undo"))
            self._redo = _button("redo", "Do it again (Ctrl-Y)", lambda: self._step("redo"))
            self._overlay = ui.toggle(
                {"": "picture", "blur": "blur", "depth": "depth", "layers": "layers"},
                value="",
                on_change=lambda e: self.picture.set_overlay(e.value),
            ).props("dense no-caps size=sm")
            self._overlay.tooltip(
                "Blur: orange behind the focus, blue before it, hatched where sharp. Depth: near is bright."
                " Layers: surfaces that lens rays meet, from one (dark) to five (bright)."
            )
            self._wipe = _button(
                "compare", "Wipe between the sharp view and the picture (Space)", self._toggle_wipe
            )
            _button("zoom_in", "Zoom to the picture's pixels: fit, 1, 2, 4 (Z)", lambda: self.picture.zoom())
            _button("dark_mode", "Light or dark", self._toggle_dark)
            _button("notes", "The config's text", lambda: self.text.open())
            _button(
                "photo_camera", "Make the final picture with its report, as focusjax run does", self._render
            )
            with (
                _button("ios_share", "Write the camera for another program, as focusjax export does"),
                ui.menu(),
            ):
                for name, target in TARGETS.items():
                    ui.menu_item(target.called, functools.partial(self._export, name)).mark(f"export-{name}")
            save = named(ui.button("Save", on_click=self.save), "save")
            save.props("dense no-caps unelevated size=sm")
            save.tooltip("Write the config to its file, comments and all (Ctrl-S)")
            _button("save_as", "Save to another file (Ctrl-Shift-S)", lambda: self.saving.open())
        self._refused = False

    def _selected(self, number: int | None) -> None:
        self.surface.show()
        self.wishes.show()
        self.timeline.show()

    def _show_from_above(self) -> None:
        answer = self.studio.answer
        if answer is None:
            return
        key = (id(answer.outcome), answer.number, answer.frame, self.picture.selected)
        if key != self._planned:
            self._planned = key
            if self._plan is None or self._plan[0] is not answer.stage:
                self._plan = answer.stage, make_plan(answer.stage)
            self._side.content = side_view(answer, self._plan[1], 344, 210, self.picture.selected)

    def _render(self) -> None:
        if self.studio.final.busy:
            self.studio.final.cancel()
            return
        folder = Path("out") / self.studio.session.document.path.stem
        self.attempt(lambda session: self.studio.render(folder))
        if self.studio.final.busy:
            ui.notify(f"The final picture goes to {folder}; press again to stop.", position="bottom")

    async def _export(self, to: str, _: object = None) -> None:
        folder = Path("out") / self.studio.session.document.path.stem
        try:
            said = await run.io_bound(self.studio.export, to, folder)
        except (ValueError, RuntimeError, OSError) as error:
            ui.notify(sentence(error), type="warning", position="bottom")
            return
        ui.notify(" ".join(said or ()), type="positive", position="bottom", multi_line=True, timeout=8000)

    def _step(self, way: str) -> None:
        self.picture.select(None)
        self.attempt(lambda session: getattr(session, way)())

    def _leave(self) -> None:
        assert self._desk is not None
        self._desk.leave()
        ui.navigate.reload()

    def _toggle_wipe(self) -> None:
        self.picture.set_wipe(None if self.picture.wipe is not None else 0.5)

    def _toggle_overlay(self, kind: str) -> None:
        self._overlay.value = "" if self._overlay.value == kind else kind

    def _toggle_dark(self) -> None:
        self._dark.value = not self._dark.value

    def _on_key(self, event: events.KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        key, control = event.key.name, event.modifiers.ctrl or event.modifiers.meta
        if control:
            act: dict[str, Callable[[], Any]] = {
                "z": lambda: self._step("redo" if event.modifiers.shift else "undo"),
                "y": lambda: self._step("redo"),
                "s": self.saving.open if event.modifiers.shift else self.save,
            }
        else:
            act = {
                " ": self._toggle_wipe,
                "b": lambda: self._toggle_overlay("blur"),
                "d": lambda: self._toggle_overlay("depth"),
                "n": self._next,
                "Enter": lambda: self._add_in_the_middle(self.picture.add),
                "c": lambda: self._add_in_the_middle(self.picture.add_control),
                "l": lambda: self._toggle_overlay("layers"),
                "z": self.picture.zoom,
                "r": self._render,
                "p": self.timeline.toggle,
                "k": self.timeline.toggle_key,
                ",": lambda: self.timeline.step(-1),
                ".": lambda: self.timeline.step(1),
                "Escape": lambda: self.picture.select(None),
            }
            delete = self.picture.delete_chosen
            if delete is not None:
                act |= {"Delete": delete, "Backspace": delete}
                if key in _STEPS:
                    size = 10 if event.modifiers.shift else 1
                    dx, dy = _STEPS[key]
                    act[key] = lambda: self.picture.nudge(size * dx, size * dy)
        action = act.get(key if len(key) > 1 else key.lower())
        if action is not None:
            action()

    def _add_in_the_middle(self, add: Callable[[float, float], None]) -> None:
        """A new point, or control point, for those who use no mouse; the arrows take it where it is to be."""
        config = self.studio.session.document.config
        if self.studio.answer is not None and config is not None:
            width, height = config.camera.resolution
            add(width / 2, height / 2)

    def _next(self) -> None:
        answer = self.studio.answer
        count = 0 if answer is None else len(answer.config.focus)
        if count:
            selected = self.picture.selected
            self.picture.select(0 if selected is None else (selected + 1) % count)


def _button(icon: str, help_: str, act: Callable[[], object] | None = None) -> ui.button:
    button = ui.button(icon=icon, on_click=act).props("flat dense size=sm color=grey")
    button.props["aria-label"] = help_
    button.tooltip(help_)
    return button
