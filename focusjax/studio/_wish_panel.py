"""The table of wishes, and what stands in their way."""

from typing import Any

from nicegui import ui

from focusjax.focus import wish_rows
from focusjax.studio._elements import list_line, named, show_chosen
from focusjax.studio._marks import SIGNS
from focusjax.studio._picture_view import PictureView
from focusjax.studio._studio import Studio
from focusjax.studio._wishes import called, kind_of


class WishPanel:
    """A line for each wish: wished, got, missed by, and whether it is met, as the report has it."""

    def __init__(self, studio: Studio, view: PictureView):
        """Build it where NiceGUI is at; a click on a line opens the wish's card in `view`."""
        self._studio, self._view = studio, view
        self._names: tuple[str, ...] | None = None
        self._lines: list[tuple[Any, ...]] = []
        ui.label("Wishes").classes("fj-head")
        with named(ui.column().classes("w-full").style("gap: 0"), "wishes") as self._rows:
            self._empty = ui.label("Click on the picture, on what should be sharp.").classes("fj-dim")
            with ui.row().classes("fj-wish fj-dim").style("cursor: default") as self._head:
                for text, style in zip(("", "wish", "wished", "got px", "off px", ""), _WIDTHS, strict=True):
                    ui.label(text).style(style)
            self._head.set_visibility(False)
        self._way = named(ui.column().classes("w-full").style("gap: 4px"), "way")
        self._sentences: tuple[str, ...] | None = ()

    def show(self) -> None:
        """Show what is new."""
        answer = self._studio.answer
        if answer is None:
            return
        names = tuple(called(answer.config, number) for number in range(len(answer.config.focus)))
        if names != self._names:
            self._names = names
            self._build(names)
        rows = answer.wishes
        texts = wish_rows(rows)
        for number, (line, sign, _, wished, got, off, verdict) in enumerate(self._lines):
            show_chosen(line, number == self._view.selected)
            sign.text = f"{number + 1} {SIGNS[kind_of(answer.config, number)]}"
            if number >= len(rows):
                continue
            _, *said, word = texts[number]
            for label, text in zip((wished, got, off), said, strict=True):
                label.text = _short(text.removesuffix(" px"))
            met = word == "met"
            verdict.text = "✓ met" if met else "✗ missed" if word == "missed" else _short(word)
            verdict.classes(
                replace="fj-num " + ("fj-met" if met else "fj-missed" if word == "missed" else "fj-dim")
            )
        if answer.sentences is not None and answer.sentences != self._sentences:
            self._sentences = answer.sentences
            self._way.clear()
            with self._way:
                if answer.sentences:
                    ui.label("In the way").classes("fj-head")
                for sentence in answer.sentences:
                    ui.label(sentence).classes("fj-way")

    def _build(self, names: tuple[str, ...]) -> None:
        """As many lines as there are names: only those that are missing are made."""
        self._empty.set_visibility(not names)
        self._head.set_visibility(bool(names))
        while len(self._lines) > len(names):
            self._lines.pop()[0].delete()
        with self._rows:
            while len(self._lines) < len(names):
                self._lines.append(self._line(len(self._lines)))
        for name, (_, _, label, *_) in zip(names, self._lines, strict=True):
            label.text = name

    def _line(self, number: int) -> tuple[Any, ...]:
        with list_line(f"wish {number + 1}", lambda: self._view.select(number)) as line:
            labels = [ui.label().style(style) for style in _WIDTHS]
        for label in labels[2:]:
            label.classes("fj-num")
        return line, *labels


def _short(text: str) -> str:
    """A wish, or why it does not count, in the table's narrow columns."""
    for words, sign in (
        ("at most ", "≤ "),
        ("at least ", "≥ "),
        ("as blurred as ", "= "),
        ("not counted", "off"),
    ):
        text = text.replace(words, sign)
    return text


_CUT = "overflow: hidden; text-overflow: ellipsis; white-space: nowrap"
_WIDTHS = (
    "width: 28px; white-space: nowrap",
    f"flex: 1; min-width: 0; {_CUT}",
    f"width: 68px; text-align: right; {_CUT}",
    "width: 50px; text-align: right",
    "width: 42px; text-align: right",
    f"width: 58px; text-align: right; {_CUT}",
)
