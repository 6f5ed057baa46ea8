"""What pages are built of: the look that all share, and elements that several of their parts have."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from nicegui import ui
from nicegui.element import Element

from focusjax.studio._session import Session

_LOOK = Path(__file__).with_name("_look.css")
_KEYS = Path(__file__).with_name("_keys.js")

Attempt: TypeAlias = Callable[[Callable[[Session], object]], object]
"""Makes a change to the session and returns what the change does, or says why it is refused."""
E = TypeVar("E", bound=Element)


def add_style() -> None:
    """Give the page that is being built its style sheet."""
    ui.add_css(_LOOK)
    ui.tooltip.default_props("delay=700")
    ui.add_head_html(f"<script>{_KEYS.read_text()}</script>")
    ui.add_head_html('<meta name="color-scheme" content="light dark">')


def named(element: E, name: str) -> E:
    """The element with a mark for tests in Python, and the class at-NAME for browsers."""
    return element.mark(name).classes(f"at-{name}")


class Quiet:
    """True while the page itself gives values to fields, which nobody has typed."""

    def __init__(self) -> None:
        self._on = False

    def __bool__(self) -> bool:
        return self._on

    def __enter__(self) -> None:
        self._on = True

    def __exit__(self, *_: object) -> None:
        self._on = False


def number_field(
    name: str,
    help_: str,
    act: Callable[[Any], object],
    *,
    wait_ms: int = 400,
    width: str = "",
    props: str = "",
    **number: Any,
) -> ui.number:
    """A field for a number, which waits for the end of typing.

    Args:
        name: see `named`.
        help_: the tooltip.
        act: called with the number; None for an empty field.
        wait_ms: after the last key.
        width: in CSS; as much as there is where it is empty.
        props: more of Quasar's properties.
        number: other arguments of `ui.number`.
    """
    field = ui.number(**number, on_change=lambda event: act(event.value)).tooltip(help_)
    field.props(f"dense debounce={wait_ms} hide-bottom-space {props}")
    if width:
        field.style(f"width: {width}")
    else:
        field.classes("col").style("min-width: 0")
    return named(field, name)


def problem_label(name: str) -> ui.label:
    """A sentence on what is wrong, which is hidden while there is none."""
    label = named(ui.label().classes("fj-way").props('role="alert"'), name)
    return label.bind_visibility_from(label, "text", backward=bool)


def list_line(label: str, choose: Callable[[], object]) -> ui.row:
    """A line of a list that a click or the Enter key chooses."""
    line = ui.row().classes("fj-wish").props(f'tabindex=0 role="button" aria-label="{label}"')
    return line.on("click", choose).on("keydown.enter", choose)


def show_chosen(line: ui.row, chosen: bool) -> None:
    """Let a line look chosen, or not."""
    if chosen:
        line.classes(add="chosen")
    else:
        line.classes(remove="chosen")
