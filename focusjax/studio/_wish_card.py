"""The card beside a mark: what is wished for its point."""

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from nicegui import events, ui

from focusjax.studio._elements import Quiet, named, number_field
from focusjax.studio._session import Session
from focusjax.studio._wishes import KINDS, KINDS_OF_SURFACE, MEASURED, called, kind_of, pixels_of

Edit = Callable[[Session, Any], object]

if TYPE_CHECKING:
    from focusjax.studio._picture_view import PictureView


_FIRST_PX = 20.0
"""Diameter in pixels at a picture's width of 640, for wishes that had none."""


class WishCard:
    """A card that follows the mark of the wish that is selected."""

    def __init__(self, view: "PictureView"):
        """Build it, closed, where NiceGUI is at."""
        self._view = view
        self._number: int | None = None
        self._built: object = None
        self._quiet = Quiet()
        self._fields: dict[str, Any] = {}
        self._card = named(ui.card().classes("fj-card"), "card")
        self._card.set_visibility(False)

    def open(self, number: int | None) -> None:
        """Show the card of a wish, or none."""
        self._number = number
        self.show()

    @property
    def number(self) -> int:
        """Of the wish whose card is open."""
        assert self._number is not None
        return self._number

    def show(self) -> None:
        """Show what is new of the wish."""
        config = self._view.studio.session.document.config
        number = self._number
        there = config is not None and number is not None and number < len(config.focus)
        self._card.set_visibility(there)
        if not there:
            return
        assert config is not None
        assert number is not None
        names = [called(config, index) for index in range(len(config.focus))]
        kind = kind_of(config, number)
        others = tuple(name for k, name in enumerate(names) if k != number)
        surface = config.lens.focal_surface is not None
        shape = (kind, others if kind == "same_blur_as" else (), surface)
        if shape != self._built:
            self._built = shape
            self._build(kind, others, KINDS_OF_SURFACE if surface else tuple(KINDS))
        self._fill(number, kind)
        x, y = self._view.place_of(number)
        self._card.style(_beside(x, y))

    def _build(self, kind: str, others: Sequence[str], kinds: Sequence[str]) -> None:
        self._fields = {}
        self._card.clear()
        with self._card:
            with ui.row().classes("fj-row"):
                self._build_name()
            self._fields["summary"] = named(ui.label().classes("fj-dim"), "summary")
            toggle = ui.toggle({each: KINDS[each] for each in kinds}, on_change=self._choose)
            toggle.props("dense no-caps unelevated size=sm spread").classes("w-full")
            self._fields["kind"] = named(toggle, "kind")
            with ui.row().classes("fj-row"):
                self._build_numbers(kind, others)
            with ui.row().classes("fj-row"):
                self._build_switches()

    def _build_name(self) -> None:
        field = named(ui.input().props("dense borderless").classes("col"), "name")
        field.on("change", lambda: self._do(lambda s: s.rename(self.number, field.value or "")))
        field.tooltip("The wish's name")
        self._fields["name"] = field
        ui.button(icon="close", on_click=lambda: self._view.select(None)).props(
            'flat dense round size=sm color=grey aria-label="Close the card"'
        )

    def _build_numbers(self, kind: str, others: Sequence[str]) -> None:
        if kind in MEASURED:
            self._number_field(
                "pixels", "px", 0.5, "The blur's diameter in pixels of the picture",
                lambda s, v: s.set_pixels(self.number, v, self._view.studio.frame),
            )  # fmt: skip
        if kind == "same_blur_as":
            field = ui.select(list(others), label="as blurred as", on_change=self._other)
            self._fields["other"] = named(field.props("dense").classes("col"), "other")
        self._number_field(
            "weight", "weight", 1.0, "How much this wish counts beside the others",
            lambda s, v: s.set_weight(self.number, v, self._view.studio.frame),
        )  # fmt: skip
        self._number_field(
            "tolerance", "± px", 0.5, "The largest miss that still counts as met; empty for 1 px",
            lambda s, v: s.set_tolerance(self.number, v), may_be_empty=True,
        )  # fmt: skip

    def _build_switches(self) -> None:
        self._switch(
            "whole", "whole object", "All of the object that shows, not this one point",
            lambda s, v: s.spread(self.number, whole=v),
        )  # fmt: skip
        self._switch(
            "on", "on", "Off: the wish is kept, and does not count", lambda s, v: s.switch(self.number, on=v)
        )
        ui.space()
        delete = ui.button("Delete", on_click=lambda: self._view.delete(self.number))
        named(delete, "delete").props("flat dense no-caps size=sm color=negative")
        delete.tooltip("Forget this wish (Delete)")

    def _number_field(
        self, key: str, label: str, step: float, help_: str, edit: Edit, *, may_be_empty: bool = False
    ) -> None:
        act = functools.partial(self._typed, edit, may_be_empty=may_be_empty)
        self._fields[key] = number_field(key, help_, act, wait_ms=350, label=label, min=0.0, step=step)

    def _switch(self, key: str, label: str, help_: str, edit: Edit) -> None:
        box = ui.checkbox(label, on_change=lambda e: self._typed(edit, e.value)).props("dense size=xs")
        self._fields[key] = named(box, key).tooltip(help_)

    def _fill(self, number: int, kind: str) -> None:
        """Values of the fields, without taking them for what somebody typed."""
        studio, fields = self._view.studio, self._fields
        config, answer = studio.session.config, studio.answer
        wish = config.focus[number]
        row = answer.wishes[number] if answer is not None and number < len(answer.wishes) else None
        mark = None if answer is None else answer.mark(number)
        summary = "…" if answer is None or mark is None else answer.under(*mark).sentence()
        if row is not None and row.counts:
            summary += ". Met." if row.met else f". Missed by {abs(row.residual):.1f} px."
        frame, pixels = studio.frame, pixels_of(wish)
        if frame and pixels is not None:
            pixels = studio.session.value_at(number, frame, "blur")
        values: dict[str, Any] = {
            "name": called(config, number),
            "kind": kind or None,
            "pixels": pixels,
            "other": wish.same_blur_as,
            "weight": studio.session.value_at(number, frame, "weight") if frame else wish.weight,
            "tolerance": 1.0 if wish.tolerance_px is None else wish.tolerance_px,
            "whole": wish.object is not None and wish.triangle is None,
            "on": wish.weight > 0,
        }
        fields["summary"].text = summary
        with self._quiet:
            for key, value in values.items():
                if key in fields:
                    fields[key].value = value

    def _choose(self, event: events.ValueChangeEventArguments[Any]) -> None:
        if self._quiet or event.value is None:
            return
        config, kind, number = self._view.studio.session.config, event.value, self.number
        if kind == "same_blur_as":
            others = [called(config, k) for k in range(len(config.focus)) if k != number]
            if not others:
                ui.notify(
                    "There is no other wish yet whose blur it could have; add one first.", type="warning"
                )
                self._built = None
                self.show()
                return
            self._do(lambda s: s.wish_for(number, kind, other=others[0]))
            return
        known = pixels_of(config.focus[number])
        usual = round(_FIRST_PX * config.camera.resolution[0] / 640, 1)
        pixels = usual if known is None else abs(known)
        self._do(lambda s: s.wish_for(number, kind, pixels=pixels))

    def _other(self, event: events.ValueChangeEventArguments[Any]) -> None:
        if not self._quiet and event.value is not None:
            self._do(lambda s: s.wish_for(self.number, "same_blur_as", other=event.value))

    def _typed(self, edit: Edit, value: Any, *, may_be_empty: bool = False) -> None:
        if not self._quiet and (may_be_empty or value is not None):
            self._do(lambda session: edit(session, value))

    def _do(self, edit: Any) -> None:
        self._view.attempt(edit)
        self.show()


def _beside(x: float, y: float) -> str:
    """Where the card goes for a mark at shares (x, y): beside it, not over what it is on."""
    right, below = x < 0.5, y < 0.5
    across = f"calc({100 * (x if right else 1 - x):.2f}% + 13% + 16px)"
    down = f"max(8px, calc({100 * (y if below else 1 - y):.2f}% - 60px))"
    return (
        f"{'left' if right else 'right'}: {across}; {'right' if right else 'left'}: auto;"
        f" {'top' if below else 'bottom'}: {down}; {'bottom' if below else 'top'}: auto"
    )
