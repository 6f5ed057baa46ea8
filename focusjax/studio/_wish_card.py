"""The card beside a mark: what is wished for its point."""

from typing import TYPE_CHECKING, Any

from nicegui import events, ui

from focusjax.studio._wishes import KINDS, called, kind_of

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
        self._quiet = False
        self._fields: dict[str, Any] = {}
        self._card = ui.card().classes("fj-card").mark("card").classes("at-card")
        self._card.set_visibility(False)

    def open(self, number: int | None) -> None:
        """Show the card of a wish, or none."""
        self._number, self._built = number, None
        self.show()

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
        shape = (number, kind, tuple(names) if kind == "same_blur_as" else len(names))
        if shape != self._built:
            self._built = shape
            self._build(number, kind, names)
        self._fill(number, kind)
        x, y = self._view.place_of(number)
        across = (
            f"left: calc({100 * x:.2f}% + 26px); right: auto"
            if x < 0.55
            else f"right: calc({100 - 100 * x:.2f}% + 26px); left: auto"
        )
        down = (
            f"top: max(8px, calc({100 * y:.2f}% - 60px)); bottom: auto"
            if y < 0.5
            else f"bottom: max(8px, calc({100 - 100 * y:.2f}% - 60px)); top: auto"
        )
        self._card.style(f"{across}; {down}")

    def _build(self, number: int, kind: str, names: list[str]) -> None:
        fields = self._fields = {}
        self._card.clear()
        with self._card:
            with ui.row().classes("fj-row"):
                fields["name"] = (
                    ui.input().props("dense borderless").classes("col").mark("name").classes("at-name")
                )
                fields["name"].on(
                    "change", lambda: self._do(lambda s: s.rename(number, fields["name"].value or ""))
                )
                fields["name"].tooltip("The wish's name")
                ui.button(icon="close", on_click=lambda: self._view.select(None)).props(
                    'flat dense round size=sm color=grey aria-label="Close the card"'
                )
            fields["told"] = ui.label().classes("fj-dim").mark("told").classes("at-told")
            fields["kind"] = (
                ui.toggle(KINDS, on_change=lambda e: self._choose(number, e))
                .props("dense no-caps unelevated size=sm spread")
                .classes("w-full")
                .mark("kind")
                .classes("at-kind")
            )
            with ui.row().classes("fj-row"):
                if kind in ("blur", "at_most", "at_least"):
                    fields["pixels"] = (
                        _number("px", 0.0, 0.5, "The blur's diameter in pixels of the picture")
                        .mark("pixels")
                        .classes("at-pixels")
                    )
                    fields["pixels"].on_value_change(
                        lambda e: self._typed(e, lambda s, v: s.wish_for(number, kind, pixels=v))
                    )
                if kind == "same_blur_as":
                    others = [name for name in names if name != names[number]]
                    fields["other"] = (
                        ui.select(others, label="as blurred as", on_change=lambda e: self._other(number, e))
                        .props("dense")
                        .classes("col")
                        .mark("other")
                        .classes("at-other")
                    )
                fields["weight"] = (
                    _number("weight", 0.0, 1.0, "How much this wish counts beside the others")
                    .mark("weight")
                    .classes("at-weight")
                )
                fields["weight"].on_value_change(
                    lambda e: self._typed(e, lambda s, v: s.set_weight(number, v))
                )
                fields["tolerance"] = (
                    _number("± px", 0.0, 0.5, "The largest miss that still counts as met")
                    .mark("tolerance")
                    .classes("at-tolerance")
                )
                fields["tolerance"].on_value_change(
                    lambda e: self._typed(e, lambda s, v: s.set_tolerance(number, v))
                )
            with ui.row().classes("fj-row"):
                fields["whole"] = (
                    ui.checkbox(
                        "whole object",
                        on_change=lambda e: self._typed(e, lambda s, v: s.spread(number, whole=v)),
                    )
                    .props("dense size=xs")
                    .mark("whole")
                    .classes("at-whole")
                )
                fields["whole"].tooltip("All of the object that shows, not this one point")
                fields["on"] = (
                    ui.checkbox("on", on_change=lambda e: self._typed(e, lambda s, v: s.switch(number, on=v)))
                    .props("dense size=xs")
                    .mark("on")
                    .classes("at-on")
                )
                fields["on"].tooltip("Off: the wish is kept, and does not count")
                ui.space()
                ui.button("Delete", on_click=lambda: self._view.delete(number)).props(
                    "flat dense no-caps size=sm color=negative"
                ).mark("delete").classes("at-delete").tooltip("Forget this wish (Delete)")

    def _fill(self, number: int, kind: str) -> None:
        """Values of the fields, without taking them for what somebody typed."""
        studio, fields = self._view.studio, self._fields
        config, answer = studio.session.config, studio.answer
        wish = config.focus[number]
        row = answer.wishes[number] if answer is not None and number < len(answer.wishes) else None
        told = "…"
        if answer is not None and number < len(answer.marks()) and answer.marks()[number] is not None:
            mark = answer.marks()[number]
            assert mark is not None
            told = answer.under(*mark).sentence()
        if row is not None and row.counts:
            told += ". Met." if row.met else f". Missed by {abs(row.residual):.1f} px."
        pixels = next(
            (
                getattr(wish, f"{each}_px")
                for each in ("blur", "at_most", "at_least")
                if getattr(wish, f"{each}_px") is not None
            ),
            None,
        )
        values: dict[str, Any] = {
            "name": called(config, number),
            "kind": kind or None,
            "pixels": pixels,
            "other": wish.same_blur_as,
            "weight": wish.weight,
            "tolerance": 1.0 if wish.tolerance_px is None else wish.tolerance_px,
            "whole": wish.object is not None and wish.triangle is None,
            "on": wish.weight > 0,
        }
        self._quiet = True
        try:
            fields["told"].text = told
            for key, value in values.items():
                if key in fields and fields[key].value != value:
                    fields[key].value = value
        finally:
            self._quiet = False

    def _choose(self, number: int, event: events.ValueChangeEventArguments[Any]) -> None:
        if self._quiet or event.value is None:
            return
        config, kind = self._view.studio.session.config, event.value
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
        wish = config.focus[number]
        known = [getattr(wish, f"{each}_px") for each in ("blur", "at_most", "at_least")]
        usual = round(_FIRST_PX * config.camera.resolution[0] / 640, 1)
        pixels = next((abs(each) for each in known if each is not None), usual)
        self._do(lambda s: s.wish_for(number, kind, pixels=pixels))

    def _other(self, number: int, event: events.ValueChangeEventArguments[Any]) -> None:
        if not self._quiet and event.value is not None:
            self._do(lambda s: s.wish_for(number, "same_blur_as", other=event.value))

    def _typed(self, event: events.ValueChangeEventArguments[Any], edit: Any) -> None:
        if not self._quiet and event.value is not None:
            self._do(lambda session: edit(session, event.value))

    def _do(self, edit: Any) -> None:
        self._view.attempt(edit)
        self.show()


def _number(label: str, least: float, step: float, help_: str) -> Any:
    """A field for a number, which waits for the end of typing."""
    field = (
        ui.number(label, min=least, step=step)
        .props("dense debounce=350")
        .classes("col")
        .style("min-width: 0")
    )
    field.tooltip(help_)
    return field
