"""The lens beside the picture: each setting free within limits, or fixed and set by hand."""

import functools
import math
from typing import Any

from nicegui import ui

from focusjax._settings import angle, f_number, metres
from focusjax.studio._answer import Answer
from focusjax.studio._aperture_view import aperture_svg
from focusjax.studio._elements import Attempt, Quiet, named, number_field
from focusjax.studio._lens_settings import SETTINGS, Setting, is_free, limits
from focusjax.studio._studio import Studio

_FARTHEST = 1000.0
"""Metres, to which the slider of the focus distance goes."""
_BESIDE_SURFACE = ("f_number", "focal_length")
"""Settings that a lens with a focal surface has."""
_LEAST_UNCERTAINTY = 0.005
"""Share of a value below which its uncertainty is not worth a word."""


class LensPanel:
    """Five settings with what was solved for them, and from where to where the picture is sharp."""

    def __init__(self, studio: Studio, attempt: Attempt):
        """Build it where NiceGUI is at; `attempt` makes a change to the session."""
        self._studio, self._attempt = studio, attempt
        self._quiet = Quiet()
        self._built: dict[str, object] = {}
        self._fields: dict[str, dict[str, Any]] = {}
        ui.label("Lens").classes("fj-head")
        self._rows = {
            name: named(ui.column().classes("w-full").style("gap: 0"), f"setting-{name}") for name in SETTINGS
        }
        with ui.row().classes("fj-row"):
            self._opening = named(ui.html("", sanitize=False), "opening")
            self._opening.tooltip("The shape of the opening, in which lights out of focus are drawn")
            self._sharp = named(ui.label().classes("fj-dim"), "sharp")

    def show(self) -> None:
        """Show what is new."""
        answer, config = self._studio.answer, self._studio.session.document.config
        if answer is None or config is None:
            return
        values = answer.values()
        surface = config.lens.focal_surface is not None
        for name, setting in SETTINGS.items():
            free, ends = is_free(config, name), limits(config, name)
            shape = (free, bool(config.focus) and not surface)
            self._rows[name].set_visibility(not surface or name in _BESIDE_SURFACE)
            if self._built.get(name) != shape:
                self._built[name] = shape
                self._build(setting, *shape)
            self._fill(setting, answer, values.get(name), ends)
        self._opening.content = aperture_svg(answer)
        depth = answer.depth_of_field()
        self._sharp.set_visibility(depth is not None and not surface)
        if depth is not None:
            self._sharp.text = (
                f"Sharp from {metres(depth.near)} to {metres(depth.far)}"
                f" (circle of confusion {depth.circle_px:.1f} px)"
            )

    def _build(self, setting: Setting, free: bool, may_be_free: bool) -> None:
        name, fields = setting.name, {}
        self._fields[name] = fields
        self._rows[name].clear()
        with self._rows[name]:
            with ui.row().classes("fj-row"):
                ui.label(setting.label).style("width: 96px; font-size: 13px").tooltip(setting.help)
                value = ui.label().classes("fj-num col").style("font-weight: 600; font-size: 14px")
                fields["value"] = named(value, f"value-{name}")
                if may_be_free:
                    self._build_lock(name, free)
            with ui.row().classes("fj-row").style("padding-left: 12px"):
                if free:
                    self._build_limits(setting, fields)
                else:
                    self._build_value(setting, fields)

    def _build_lock(self, name: str, free: bool) -> None:
        lock = ui.button("free" if free else "fixed", icon="lock_open" if free else "lock")
        named(lock, f"lock-{name}").on_click(lambda: self._toggle(name, free)).style("width: 74px")
        lock.props(f"flat dense no-caps size=sm color={'primary' if free else 'grey'}")
        lock.tooltip(
            "Free: the wishes decide it. Click to keep it as it is."
            if free
            else "Fixed: you decide it. Click to let the wishes decide."
        )

    def _build_limits(self, setting: Setting, fields: dict[str, Any]) -> None:
        help_ = f"The limit to the {setting.label.lower()}; empty for the usual one"
        for end, sign, words in (("low", "≥", "at least"), ("high", "≤", "at most")):
            act = functools.partial(self._limit, setting.name, end)
            field = number_field(
                f"{end}-{setting.name}", help_, act, props="clearable", prefix=sign, step=0.1
            )
            field.props["aria-label"] = f"{setting.label} {words}"
            fields[end] = field

    def _build_value(self, setting: Setting, fields: dict[str, Any]) -> None:
        name = setting.name
        slider = named(ui.slider(min=0.0, max=1.0, step=0.002), f"slider-{name}").classes("col")
        slider.on("update:model-value", lambda e: self._slid(setting, e.args), throttle=0.06)
        slider.on("change", lambda: self._studio.session.end_drag())
        slider.props(f'dense aria-label="{setting.label}"').tooltip(setting.help)
        # Its arrow keys do not nudge points, too.
        slider.on("keydown", js_handler="(event) => event.stopPropagation()")
        help_ = f"{setting.label} in {setting.unit}" if setting.unit else setting.label
        act = functools.partial(self._set, name)
        fixed = number_field(f"fixed-{name}", help_, act, width="92px", step=0.1)
        fixed.props["aria-label"] = setting.label
        fields |= {"slider": slider, "fixed": fixed}

    def _fill(
        self, setting: Setting, answer: Answer, value: float | None, ends: tuple[float | None, float | None]
    ) -> None:
        name, fields = setting.name, self._fields[setting.name]
        text = "-" if value is None else _shown(name, value)
        doubt = answer.uncertainty.get(name, 0.0)
        if name in answer.uncertain():
            text += " (open)"
        elif value is not None and math.isfinite(doubt) and doubt > _LEAST_UNCERTAINTY * abs(value):
            text += f" ± {_difference(name, doubt)}"
        fields["value"].text = text
        with self._quiet:
            for key, limit in zip(("low", "high"), ends, strict=True):
                if key in fields:
                    fields[key].value = limit if limit is None or math.isfinite(limit) else None
            if "slider" in fields and value is not None and math.isfinite(value):
                fields["slider"].value = _to_share(self._studio, name, value)
                fields["fixed"].value = float(f"{value:.4g}")

    def _toggle(self, name: str, free: bool) -> None:
        self._attempt(lambda session: session.fix(name) if free else session.free(name))
        self.show()

    def _limit(self, name: str, end: str, value: float | None) -> None:
        if not self._quiet:
            self._attempt(lambda session: session.limit(name, end, value))

    def _set(self, name: str, value: float | None) -> None:
        if not self._quiet and value is not None:
            self._attempt(lambda session: session.fix(name, value))

    def _slid(self, setting: Setting, share: Any) -> None:
        if isinstance(share, int | float):
            value = _from_share(self._studio, setting.name, float(share))
            self._attempt(lambda session: session.fix(setting.name, value))


def _shown(name: str, value: float) -> str:
    if name == "focal_length":
        return f"{value:.4g} mm"
    return metres(value) if name == "focus" else f_number(value) if name == "f_number" else angle(value)


def _difference(name: str, value: float) -> str:
    unit = {"f_number": "", "focal_length": " mm"}.get(name, "°")
    return metres(value) if name == "focus" else f"{value:.2g}{unit}"


def _ends(studio: Studio, name: str) -> tuple[float, float]:
    """Where a setting's slider starts and ends, in a scale along which equal steps look alike."""
    if name == "focus":
        config = studio.session.config
        length = 0.05 if studio.answer is None else float(studio.answer.stage.camera.focal_length)
        nearest = config.solve.min_focus_distance_m or 2.5 * length
        return 1.0 / nearest, 1.0 / _FARTHEST
    if name == "focal_length":
        return math.log2(12.0), math.log2(400.0)
    return (0.0, 5.0) if name == "f_number" else (-20.0, 20.0)


def _to_share(studio: Studio, name: str, value: float) -> float:
    low, high = _ends(studio, name)
    by_halves = name in ("f_number", "focal_length")
    scaled = 1.0 / value if name == "focus" else math.log2(max(value, 1e-3)) if by_halves else value
    return min(max((scaled - low) / (high - low), 0.0), 1.0)


def _from_share(studio: Studio, name: str, share: float) -> float:
    low, high = _ends(studio, name)
    scaled = low + share * (high - low)
    by_halves = name in ("f_number", "focal_length")
    return 1.0 / scaled if name == "focus" else 2.0**scaled if by_halves else scaled
