"""The picture of the page: what is clicked and dragged on it, and what is drawn over it."""

import functools
from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from focusjax.studio._elements import Attempt, named
from focusjax.studio._marks import controls_svg, layers_svg, marks_svg, nearest_mark, radius
from focusjax.studio._overlays import shown_size
from focusjax.studio._studio import Studio
from focusjax.studio._wish_card import WishCard

_ZOOMS = (0, 1, 2, 4)
"""Pixels of the screen for one of the picture's; 0 shows all of it."""
_STILL = 0.006
"""Share of the picture's width by which a press may move and still be a click."""


class PictureView:
    """The picture with its marks.

    Attributes:
        selected: number of the wish whose card is open; None for none.
        control: number of the focal surface's control point that is chosen; None for none.
        wipe: share of the width that shows the sharp view; None for none.
        overlay: "blur", "depth" or nothing.
    """

    def __init__(self, studio: Studio, attempt: Attempt, on_select: Callable[[int | None], None]):
        """Build it where NiceGUI is at.

        Args:
            studio: what is shown.
            attempt: makes a change to the session, or says why it cannot be.
            on_select: called with the number of the wish that is selected; None for none.
        """
        self.studio, self.attempt, self._on_select = studio, attempt, on_select
        self.selected: int | None = None
        self.control: int | None = None
        self.wipe: float | None = None
        self.overlay = ""
        self._press: tuple[float, float] | None = None
        self._dragged: tuple[str, int] | None = None
        self._drags = 0
        self._loaded = 0
        self._zoom = 0
        self._seen = tuple(0.5 * each for each in self._resolution())
        width, height = self._size()
        with ui.element("div").classes("fj-stage"):
            with ui.element("div").classes("fj-frame") as self._frame:
                self._frame.style(f"--fj-ratio: {width / height:.5f}")
                image = ui.interactive_image(
                    size=(width, height),
                    events=["mousedown", "mousemove", "mouseup", "mouseleave"],
                    on_mouse=self._on_mouse,
                    sanitize=False,
                )
                self.image = named(image.classes("w-full"), "picture")
                self.card = WishCard(self)
            self._under = named(ui.label().classes("fj-under"), "under")
            self._under.set_visibility(False)
            self._note = named(ui.label().classes("fj-under").style("top: 8px; bottom: auto"), "note")

    def show(self) -> None:
        """Show what the studio has."""
        studio = self.studio
        shown = studio.shown.get("picture")
        width, height = self._size()
        self._frame.style(f"--fj-ratio: {width / height:.5f}")
        if shown is not None and shown.number != self._loaded:
            self._loaded = shown.number
            self.image.set_source(address("picture", shown.number))
        count = 0 if studio.answer is None else len(studio.answer.config.focus)
        if self.selected is not None and self.selected >= count and not self._awaited(self.selected):
            self.select(None)
        config = studio.session.document.config
        table = None if config is None else config.lens.focal_surface
        if self.control is not None and (table is None or self.control >= len(table.points)):
            self.select_control(None)
        state = studio.state
        self._note.text = state.detail if state.word in ("problem", "no lens") else ""
        self._note.set_visibility(bool(self._note.text))
        self._draw()
        self.card.show()

    def select(self, number: int | None) -> None:
        """Open the card of a wish, or none."""
        self.selected, self.control = number, None
        self.card.open(number)
        self._draw()
        self._on_select(number)

    def select_control(self, number: int | None) -> None:
        """Choose a control point of the focal surface, or none."""
        self.select(None)
        self.control = number
        self._draw()
        self._on_select(None)

    def delete_control(self, number: int) -> None:
        """Forget a control point."""
        self.select_control(None)
        self.attempt(lambda session: session.delete_control(number))

    def add_control(self, x: float, y: float) -> None:
        """A new control point at what is under (x, y), in pixels of the config's picture."""
        added = self.attempt(lambda session: session.add_control(x, y))
        if isinstance(added, int):
            self.select_control(added)

    @property
    def delete_chosen(self) -> Callable[[], None] | None:
        """Forgets the wish or the control point that is chosen; None where none is."""
        wish, control = self.selected, self.control
        if wish is not None:
            return lambda: self.delete(wish)
        return None if control is None else lambda: self.delete_control(control)

    def delete(self, number: int) -> None:
        """Forget a wish."""
        self.select(None)
        self.attempt(lambda session: session.delete_point(number))

    def add(self, x: float, y: float) -> None:
        """A new wish for what is under (x, y), in pixels of the config's picture."""
        added = self.attempt(lambda session: session.add_point(x, y))
        if isinstance(added, int):
            self.select(added)

    def zoom(self) -> None:
        """The whole picture, or each of its pixels as 1, 2 or 4 of the screen's, around what is looked at."""
        self._zoom = (self._zoom + 1) % len(_ZOOMS)
        factor, width = _ZOOMS[self._zoom], self._size()[0]
        answer, selected = self.studio.answer, self.selected
        mark = None if answer is None or selected is None else answer.mark(selected)
        x, y = mark or self._seen
        if not factor:
            self._frame.style("width: min(100cqw, calc(100cqh * var(--fj-ratio)))")
            return
        self._frame.style(f"width: {factor * width}px; flex: none")
        at = factor * self._scale() * x, factor * self._scale() * y
        ui.run_javascript(
            f"setTimeout(() => {{const s = document.querySelector('.fj-stage');"
            f" s.scrollTo({at[0]:.0f} - s.clientWidth / 2, {at[1]:.0f} - s.clientHeight / 2)}}, 60)"
        )

    def nudge(self, dx: float, dy: float) -> None:
        """Move the selected point, or control point, by pixels of the config's picture."""
        answer, number, control = self.studio.answer, self.selected, self.control
        if answer is not None and control is not None and control < len(answer.controls()):
            mark, table = answer.controls()[control].mark, self.studio.session.config.lens.focal_surface
            if mark is not None and table is not None and control < len(table.points):
                x, y = table.points[control].pixel or mark
                self.attempt(lambda s: s.move_control(control, x + dx, y + dy, drag="nudge"))
            return
        mark = None if answer is None or number is None else answer.mark(number)
        if number is not None and mark is not None:
            x, y = self.studio.session.config.focus[number].pixel or mark
            self.attempt(lambda s: s.move_point(number, x + dx, y + dy, drag="nudge"))

    def set_overlay(self, kind: str) -> None:
        """Lay the "blur" or "depth" map over the picture, or nothing."""
        self.overlay = kind
        self._draw()

    def set_wipe(self, share: float | None) -> None:
        """Show the sharp view on that share of the width."""
        self.wipe = share
        self._draw()

    def place_of(self, number: int) -> tuple[float, float]:
        """Shares of width and height at which the mark of a wish is."""
        answer = self.studio.answer
        mark = None if answer is None else answer.mark(number)
        width, height = self._resolution()
        return (0.5, 0.5) if mark is None else (mark[0] / width, mark[1] / height)

    def _awaited(self, number: int) -> bool:
        """Whether a wish is new, and its answer to come."""
        config = self.studio.session.document.config
        return config is not None and number < len(config.focus)

    def _draw(self) -> None:
        answer = self.studio.answer
        if answer is None:
            return
        size = self._size()
        addresses = {kind: address(kind, each.number) for kind, each in self.studio.shown.items()}
        content = layers_svg(addresses, size, overlay=self.overlay, wipe=self.wipe)
        content += controls_svg(answer, self._scale(), size[0], self.control)
        content += marks_svg(answer, self._scale(), size[0], self.selected)
        self.image.content = content

    def _on_mouse(self, event: events.MouseEventArguments) -> None:
        x, y = event.image_x / self._scale(), event.image_y / self._scale()
        act: dict[str, Callable[[float, float], Any]] = {
            "mousedown": self._down,
            "mousemove": self._move,
            "mouseup": functools.partial(self._up, shift=event.shift),
            "mouseleave": self._leave,
        }
        if self.studio.answer is not None and (event.type != "mousedown" or event.button == 0):
            act[event.type](x, y)

    def _down(self, x: float, y: float) -> None:
        answer = self.studio.answer
        assert answer is not None
        width = self._resolution()[0]
        self._press = (x, y)
        if self.wipe is not None and abs(x / width - self.wipe) < 0.015:
            self._dragged = ("wipe", 0)
            return
        self._drags += 1
        wish = nearest_mark(answer.marks(), x, y, 1.4 * radius(width))
        control = nearest_mark([each.mark for each in answer.controls()], x, y, 1.6 * radius(width))
        self._dragged = ("wish", wish) if wish is not None else None
        if wish is None and control is not None:
            self._dragged = ("control", control)
            if control != self.control:
                self.select_control(control)
        elif wish is not None and wish != self.selected:
            self.select(wish)

    def _move(self, x: float, y: float) -> None:
        answer = self.studio.answer
        assert answer is not None
        width = self._resolution()[0]
        if self._dragged == ("wipe", 0):
            self.set_wipe(min(max(x / width, 0.0), 1.0))
            return
        self._seen = x, y
        self._under.text = answer.under(x, y).sentence()
        self._under.set_visibility(True)
        self._drag_to(x, y)

    def _drag_to(self, x: float, y: float) -> bool:
        """Move what is dragged; whether there is anything."""
        if self._dragged is None or self._dragged[0] == "wipe" or not self._moved(x, y):
            return False
        (what, number), drag = self._dragged, f"{self._drags}"
        if what == "wish":
            self.attempt(lambda session: session.move_point(number, x, y, drag=drag))
        else:
            self.attempt(lambda session: session.move_control(number, x, y, drag=drag))
        return True

    def _up(self, x: float, y: float, *, shift: bool = False) -> None:
        clicked = self._press is not None and self._dragged is None and not self._moved(x, y)
        if self._drag_to(x, y):
            self.studio.session.end_drag()
        self._press = self._dragged = None
        if clicked and shift:
            self.add_control(x, y)
        elif clicked:
            self.add(x, y)

    def _leave(self, x: float, y: float) -> None:
        self._under.set_visibility(False)

    def _moved(self, x: float, y: float) -> bool:
        assert self._press is not None
        far = abs(complex(x - self._press[0], y - self._press[1]))
        return far > _STILL * self._resolution()[0]

    def _resolution(self) -> tuple[int, int]:
        answer, config = self.studio.answer, self.studio.session.document.config
        known = answer.config if answer is not None else config
        return known.camera.resolution if known is not None else (640, 480)

    def _size(self) -> tuple[int, int]:
        return shown_size(self._resolution())

    def _scale(self) -> float:
        """Pixels shown for one of the config's."""
        return self._size()[0] / self._resolution()[0]


def address(kind: str, number: int) -> str:
    """Where the server has a picture."""
    return f"/studio/{kind}/{number}"
