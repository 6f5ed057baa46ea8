"""The focal surface beside the picture: on or off, its shape, and its control points."""

import functools
from typing import Any

from nicegui import ui

from focusjax._settings import metres
from focusjax.studio._answer import Control
from focusjax.studio._elements import Attempt, Quiet, list_line, named, number_field, show_chosen
from focusjax.studio._picture_view import PictureView
from focusjax.studio._studio import Studio
from focusjax.studio._surface_edits import BASES, KERNELS, kernel_size

_FIELDS = (
    ("blur_px", "blur px", 1.0, "Blur here before the wishes are solved for; below 0 in front of the focus"),
    ("aperture_scale", "aperture", 0.1, "Size of the aperture here: 0.5 halves all blur around the point"),
    ("weight", "weight", 0.5, "How widely the point rules its neighbourhood"),
)


class SurfacePanel:
    """A switch between a plane and a surface, and a line for each control point of a surface."""

    def __init__(self, studio: Studio, view: PictureView, attempt: Attempt):
        """Build it where NiceGUI is at.

        Args:
            studio: what is shown.
            view: where control points are chosen.
            attempt: makes a change to the session.
        """
        self._studio, self._view, self._attempt = studio, view, attempt
        self._quiet = Quiet()
        self._built: object = None
        self._shape: dict[str, Any] = {}
        self._fields: dict[str, Any] = {}
        self._lines: list[tuple[Any, Any, Any]] = []
        self._switch = ui.checkbox("Focus from place to place", on_change=lambda e: self._turn(e.value))
        named(self._switch, "surface").props("dense size=xs")
        self._switch.tooltip("A focal surface through control points, in place of one plane in focus")
        with named(ui.column().classes("w-full").style("gap: 2px"), "controls") as self._box:
            self._build_shape()
            ui.label("Each new point has a control point; Shift and click sets one alone.").classes("fj-dim")
            self._rows = ui.column().classes("w-full").style("gap: 0")

    def show(self) -> None:
        """Show what is new."""
        answer, config = self._studio.answer, self._studio.session.document.config
        if answer is None or config is None:
            return
        table = config.lens.focal_surface
        self._box.set_visibility(table is not None)
        with self._quiet:
            self._switch.value = table is not None
            if table is None:
                return
            size = kernel_size(config)
            values = {
                "basis": table.basis, "kernel": table.kernel.kind, "exponent": table.kernel.exponent,
                "size": size, "smoothness": table.smoothness,
            }  # fmt: skip
            for key, value in values.items():
                self._shape[key].value = value
        self._shape["size"].set_visibility(size is not None)
        controls = answer.controls()
        # The text may be ahead of the answer.
        if len(controls) == len(table.points):
            self._show_points(controls)

    def _show_points(self, controls: tuple[Control, ...]) -> None:
        chosen = self._view.control
        built = len(controls), chosen
        if built != self._built:
            self._built = built
            self._build(len(controls), chosen)
        for number, (line, name, distance) in enumerate(self._lines):
            show_chosen(line, number == chosen)
            name.text = controls[number].name
            where = controls[number].distance
            distance.text = "" if where is None else metres(where)
        table = self._studio.session.config.lens.focal_surface
        if chosen is None or table is None:
            return
        with self._quiet:
            for key, field in self._fields.items():
                field.value = getattr(table.points[chosen], key)

    def _build_shape(self) -> None:
        with ui.row().classes("fj-row"):
            self._choice("basis", BASES, "shape", "How the surface goes on between and beyond its points")
            self._choice("kernel", KERNELS, "points are felt", "How far a control point is felt")
        with ui.row().classes("fj-row"):
            for key, label, step, help_ in (
                ("exponent", "exponent", 0.5, "How quickly influence falls with distance, 0.5 to 4"),
                ("size", "px", 10.0, "Pixels over which influence fades or ends"),
                ("smoothness", "smoothness", 0.001, "Weight of an even blur against the wishes"),
            ):
                act = functools.partial(self._set, key)
                self._shape[key] = number_field(f"surface-{key}", help_, act, label=label, step=step)

    def _choice(self, key: str, words: dict[str, str], label: str, help_: str) -> None:
        field = ui.select(words, label=label, on_change=lambda e: self._set(key, e.value))
        field.props("dense options-dense").classes("col").style("min-width: 0").tooltip(help_)
        self._shape[key] = named(field, f"surface-{key}")

    def _build(self, count: int, chosen: int | None) -> None:
        self._rows.clear()
        self._lines, self._fields = [], {}
        with self._rows:
            for number in range(count):
                self._lines.append(self._line(number))
                if number == chosen:
                    with ui.row().classes("fj-row").style("padding-left: 24px"):
                        self._build_fields(number)

    def _line(self, number: int) -> tuple[Any, Any, Any]:
        line = list_line(f"control point {number + 1}", lambda: self._view.select_control(number))
        with line.classes("at-control").mark(f"control-{number}"):
            ui.label("◇").style("width: 18px")
            name = ui.label().style("flex: 1; min-width: 0; overflow: hidden; text-overflow: ellipsis")
            distance = ui.label().classes("fj-num").tooltip("The focus distance here")
        return line, name, distance

    def _build_fields(self, number: int) -> None:
        for key, label, step, help_ in _FIELDS:
            act = functools.partial(self._change, number, key)
            self._fields[key] = number_field(f"surface-{key}", help_, act, label=label, step=step)
        delete = ui.button(icon="delete", on_click=lambda: self._view.delete_control(number))
        delete.props('flat dense size=sm color=grey aria-label="Forget this control point"')
        delete.tooltip("Forget this control point (Delete)").mark("control-delete")

    def _turn(self, on: bool | None) -> None:
        if not self._quiet:
            self._view.select(None)
            self._attempt(lambda session: session.use_surface() if on else session.use_plane())
            self.show()

    def _set(self, key: str, value: Any) -> None:
        config = self._studio.session.document.config
        if self._quiet or value is None or config is None or config.lens.focal_surface is None:
            return
        kind = config.lens.focal_surface.kernel.kind
        if key in ("basis", "smoothness"):
            self._attempt(lambda session: session.set_surface(key, value))
        elif key == "kernel":
            self._attempt(lambda session: session.set_kernel(value))
        else:
            self._attempt(lambda session: session.set_kernel(kind, **{key: value}))
        self.show()

    def _change(self, number: int, key: str, value: Any) -> None:
        if not self._quiet and value is not None:
            self._attempt(lambda session: session.set_control(number, key, value))
            self.show()
