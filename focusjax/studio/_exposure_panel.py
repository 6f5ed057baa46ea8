"""Exposure and film beside the picture, where the config has them."""

from typing import Any

from nicegui import ui

from focusjax.film import film_names
from focusjax.studio._elements import Attempt, Quiet, named
from focusjax.studio._studio import Studio

_FIELDS = (
    ("light_ev", "light EV", "Exposure value of the light at ISO 100: sun 15, overcast 12, a room 7"),
    ("time", "time s", "Shutter time, such as 1/60; empty to have it chosen"),
    ("iso", "ISO", "Speed; empty to have it chosen"),
    ("compensation", "± stops", "By how many stops a chosen exposure is to be brighter"),
)


class ExposurePanel:
    """Fields for `[exposure]` and `[film]`, and what the camera was set to."""

    def __init__(self, studio: Studio, attempt: Attempt):
        """Build it where NiceGUI is at; `attempt` makes a change to the session."""
        self._studio, self._attempt = studio, attempt
        self._quiet = Quiet()
        self._fields: dict[str, Any] = {}
        with named(ui.column().classes("w-full").style("gap: 2px"), "exposure") as self._box:
            ui.label("Exposure and film").classes("fj-head")
            with ui.row().classes("fj-row") as self._exposure:
                for key, label, help_ in _FIELDS:
                    self._fields[key] = self._field(key, label, help_)
            self._film = named(ui.select(["", *film_names()], label="film"), "film").classes("w-full")
            self._film.props("dense options-dense").tooltip("The film that the light falls on")
            self._film.on_value_change(lambda e: self._set("film", "preset", e.value or None))
            self._summary = named(ui.label().classes("fj-dim"), "exposed")

    def show(self) -> None:
        """Show what is new."""
        config = self._studio.session.document.config
        exposure, film = (None, None) if config is None else (config.exposure, config.film)
        self._box.set_visibility(exposure is not None or film is not None)
        if config is None or (exposure is None and film is None):
            return
        self._exposure.set_visibility(exposure is not None)
        self._film.set_visibility(film is not None and film.curve is None)
        with self._quiet:
            for key, field in self._fields.items():
                field.value = _written(key, getattr(exposure, key, None))
            self._film.value = "" if film is None else film.preset or ""
        taken = self._studio.painter.taken
        settings = None if taken is None else taken.settings
        numbers = "" if settings is None else f"{_seconds(settings.time)}, ISO {settings.iso:.0f}. "
        self._summary.text = numbers + ("" if taken is None else taken.sentence() or "")

    def _field(self, key: str, label: str, help_: str) -> ui.input:
        field = named(ui.input(label), key).classes("col").style("min-width: 0").tooltip(help_)
        field.props("dense hide-bottom-space")
        field.on("change", lambda: self._set("exposure", key, _read(field.value)))
        return field

    def _set(self, table: str, key: str, value: Any) -> None:
        if not self._quiet:
            self._attempt(lambda session: session.set_exposure(table, key, value))
            self.show()


def _written(key: str, value: Any) -> str:
    if value is None:
        return ""
    return _seconds(value).removesuffix(" s") if key == "time" else f"{value:g}"


def _read(text: str | None) -> Any:
    """What was typed, for the config; text that is no number is left to the config to refuse."""
    text = (text or "").strip()
    if not text:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def _seconds(value: Any) -> str:
    value = float(value)
    return f"1/{1 / value:.4g} s" if 0 < value < 0.4 else f"{value:.3g} s"
