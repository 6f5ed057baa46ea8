"""The look that all pages share."""

from pathlib import Path

from nicegui import ui

_LOOK = Path(__file__).with_name("_look.css")
_KEYS = Path(__file__).with_name("_keys.js")


def add_style() -> None:
    """Give the page that is being built its style sheet."""
    ui.add_css(_LOOK)
    ui.tooltip.default_props("delay=700")
    ui.add_head_html(f"<script>{_KEYS.read_text()}</script>")
    ui.add_head_html('<meta name="color-scheme" content="light dark">')
