"""The shot below the picture: a slider over its frames, play, and the tracks of the wishes."""

import functools

from nicegui import ui

from focusjax.studio._elements import Attempt, Quiet, named, number_field
from focusjax.studio._picture_view import PictureView
from focusjax.studio._studio import Studio
from focusjax.studio._timing import KEYED, keys_of, span_of
from focusjax.studio._tracks import LEFT, RIGHT, tracks_svg
from focusjax.studio._wishes import MEASURED, kind_of

_WIDTH = 900


class Timeline:
    """Scrubs and plays a shot; hidden for stills."""

    def __init__(self, studio: Studio, view: PictureView, attempt: Attempt):
        """Build it where NiceGUI is at."""
        self._studio, self._view, self._attempt = studio, view, attempt
        self._drawn: object = None
        self._quiet = Quiet()
        self._shown_number = 0
        with named(ui.column().classes("fj-timeline"), "timeline") as self._box:
            with ui.row().classes("fj-row"):
                self._play = named(ui.button(icon="play_arrow", on_click=self.toggle), "play")
                self._play.props('flat dense round size=sm aria-label="Play"')
                self._play.tooltip("Play at draft quality (P)")
                self._label = named(ui.label().classes("fj-num").style("width: 78px"), "frame")
                ui.space()
                self._from = self._end("from", "The first frame in which the chosen wish counts")
                self._to = self._end("to", "The last frame in which the chosen wish counts")
                self._key = named(ui.button("◆ +", on_click=self.toggle_key), "key")
                self._key.props("flat dense size=sm no-caps")
                self._key.tooltip("Set or take away a keyframe of the chosen wish at this frame (K)")
            with ui.element("div").style(f"width: 100%; padding: 0 {_share(RIGHT)} 0 {_share(LEFT)}"):
                # Its ends lie above those of the tracks.
                self._slider = named(ui.slider(min=1, max=2, step=1), "scrub")
                self._slider.props('dense aria-label="Frame"').tooltip("The frame that is shown (, and .)")
                self._slider.on("update:model-value", lambda e: self._scrubbed(e.args), throttle=0.04)
            self._tracks = named(ui.html("", sanitize=False).classes("w-full"), "tracks")
        self._timer = ui.timer(1 / 24, self._step, active=False)

    def show(self) -> None:
        """Show what is new."""
        studio = self._studio
        config = studio.session.document.config
        shot = None if config is None or not config.focus else config.shot
        self._box.set_visibility(shot is not None)
        if shot is None or config is None:
            self._timer.deactivate()
            return
        frame, selected = max(studio.frame, 1), self._view.selected
        self._label.text = f"{frame} / {shot.frames}"
        self._slider.props(f"max={shot.frames}")
        self._slider.enabled = studio.reel is not None
        chosen = selected if selected is not None and selected < len(config.focus) else None
        for field in (self._from, self._to, self._key):
            field.set_enabled(chosen is not None)
        with self._quiet:
            self._slider.value = frame
            self._from.value, self._to.value = (None, None) if chosen is None else span_of(config, chosen)
        if chosen is not None:
            here = any(frame in keys_of(config, chosen, what) for what in KEYED)
            self._key.text = "◆ \N{MINUS SIGN}" if here else "◆ +"
        drawn = (config, studio.reel, frame, selected)
        if drawn != self._drawn:
            self._drawn = drawn
            self._tracks.content = tracks_svg(config, studio.reel, frame, _WIDTH, selected)

    def toggle(self) -> None:
        """Play, or stop."""
        playing = not self._timer.active
        self._timer.active = playing and self._studio.reel is not None
        self._play.props(f"icon={'pause' if self._timer.active else 'play_arrow'}")
        config = self._studio.session.document.config
        if config is not None and config.shot is not None:
            self._timer.interval = 1.0 / config.shot.fps

    def step(self, frames: int) -> None:
        """Go forwards, or back."""
        self._studio.show_frame(self._studio.frame + frames)

    def toggle_key(self) -> None:
        """Give the chosen wish a keyframe at this frame, of its blur or else its weight; or take it away."""
        number, frame = self._view.selected, self._studio.frame
        config = self._studio.session.document.config
        if number is None or config is None or config.shot is None:
            return
        if any(frame in keys_of(config, number, what) for what in KEYED):
            self._attempt(lambda session: session.delete_key(number, frame))
            return
        what = "blur" if kind_of(config, number) in MEASURED else "weight"
        value = self._studio.session.value_at(number, frame, what)
        self._attempt(lambda session: session.set_key(number, frame, what, value))

    def _end(self, end: str, help_: str) -> ui.number:
        return number_field(
            f"{end}-frame", help_, functools.partial(self._act, end), wait_ms=500, width="84px",
            props="clearable", label=end, min=1, step=1, precision=0,
        )  # fmt: skip

    def _act(self, end: str, frame: float | None) -> None:
        number = self._view.selected
        if not self._quiet and number is not None:
            self._attempt(lambda s: s.act(number, end, None if frame is None else int(frame)))

    def _scrubbed(self, frame: object) -> None:
        if not self._quiet and isinstance(frame, int | float):
            self._studio.show_frame(int(frame))

    def _step(self) -> None:
        """The next frame, once the last one is there to be seen."""
        reel, answer = self._studio.reel, self._studio.answer
        picture = self._studio.shown.get("picture")
        if reel is None or answer is None or picture is None or answer.frame != self._studio.frame:
            return
        if picture.number != self._shown_number:
            self._shown_number = picture.number
            self._studio.show_frame(self._studio.frame % reel.count + 1)


def _share(pixels: int) -> str:
    return f"{100 * pixels / _WIDTH:.2f}%"
