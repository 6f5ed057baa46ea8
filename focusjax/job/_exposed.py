"""Focus and exposure chosen together: aperture, time and speed, with the f-number between the two."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from focusjax._settings import shutter
from focusjax.film import (
    CameraSettings,
    ChosenSettings,
    FNumbersForLight,
    camera_settings,
    choose_settings,
    magnification,
)
from focusjax.focus import F_NUMBERS, ArgumentError, ImagePoints, Solution, solve
from focusjax.geometry import Camera
from focusjax.job._widest import widest_as_good
from focusjax.lens import ThinLens, TiltShiftLens, depth_of_field

Priority: TypeAlias = Literal["focus", "exposure"]
"""What goes first where the wishes for focus and the light want different apertures."""

_ROUNDS = 16
"""At most so many solves within the light's limits, each for the light lost where the last one focused. Far
from life size two do."""

_SETTLINGS = 3
"""At most so many searches for the widest aperture: where a solve within wide limits stops early, in single
precision, the next one starts from where it should have gone."""

_NARROW = 1e-4
"""Least width of a range of f-numbers, relative."""

_STOP = 1e-3
"""Stops from which on the exposure is called wrong, as `choose_settings` does."""


class ExposedLens(eqx.Module):
    """A lens whose f-number depth of field and light were asked for.

    Attributes:
        lens: focus and f-number to use.
        camera: the camera it is for.
        wanted: f-number that focus takes, were there light enough.
        chosen: time and speed at the lens's f-number, and the f-numbers for the light.
        priority: what went first (static).
    """

    lens: ThinLens | TiltShiftLens
    camera: Camera
    wanted: Float[Array, ""]
    chosen: ChosenSettings
    priority: Priority = eqx.field(static=True)

    def stops_apart(self) -> float:
        """Stops by which the wanted f-number is beyond those for the light; 0 is no conflict.

        Above 0 it needs more light than there is, below 0 less.
        """
        wanted, light = float(self.wanted), self.chosen.f_numbers
        over = 2.0 * math.log2(wanted / float(light.narrowest))
        under = 2.0 * math.log2(wanted / float(light.widest))
        return over if over > _STOP else under if under < -_STOP else 0.0

    def sentence(self, lost: str | None = None) -> str | None:
        """What the two want, which of them gives way and by how much; None where they agree.

        Args:
            lost: what focus loses where it gives way, a clause; the depth of field that is left if None.
        """
        apart = self.stops_apart()
        if not apart:
            return None
        settings = self.chosen.settings
        light = self.chosen.f_numbers
        limit = light.narrowest if apart > 0 else light.widest
        off = float(self.chosen.stops_off)
        wrong = f"{abs(off):.1f} stops too {'dark' if off < 0 else 'bright'}"
        text = (
            f"The wishes for focus take f/{float(self.wanted):.2g}; at {shutter(float(settings.time))} and"
            f" ISO {float(settings.iso):.0f} the light is right for f/{float(limit):.2g}, {abs(apart):.1f}"
            f" stops {'wider' if apart > 0 else 'narrower'}."
        )
        if self.priority == "focus":
            return f"{text} Exposure gives way: the picture is {wrong}."
        text = f"{text} Focus gives way: {lost or self._depth_left()}."
        if abs(off) > 10 * _STOP:
            text += f" The lens goes to f/{float(settings.f_number):.2g}, where the picture is {wrong}."
        return text

    def _depth_left(self) -> str:
        sharp = depth_of_field(self.camera, self.lens)
        number = float(self.lens.f_number(self.camera))
        return f"at f/{number:.2g} it is sharp from {sharp.near:.3g} to {sharp.far:.3g} m"


class ExposedSolution(eqx.Module):
    """What `solve_exposed` found.

    Attributes:
        solution: the lens to use, and how its wishes are met.
        wished: what the wishes take, were there light enough; the same where focus goes first.
        exposed: its light, time and speed.

    Example:
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=600, height=400, focal_length=0.05)
        >>> wishes = [fj.FocusPoint(fj.AtPoint((0, 0, -z)), fj.AtMost(0.5)) for z in (2.0, 4.0)]
        >>> start = fj.thin_lens(focus_distance=9.0, f_number=1.4, focal_length=0.05)
        >>> light = {"luminance": 20.0, "iso_range": (100, 1600)}
        >>> points = fj.locate(wishes, camera)
        >>> found = fj.solve_exposed(points, camera, start, 0.18, light, priority="exposure")
        >>> wished, taken = (float(each.lens.f_number(camera)) for each in (found.wished, found.solution))
        >>> round(wished, 1), round(taken, 1)
        (10.4, 2.7)
    """

    solution: Solution
    wished: Solution
    exposed: ExposedLens

    @property
    def chosen(self) -> ChosenSettings:
        """Time and speed."""
        return self.exposed.chosen

    def sentence(self) -> str | None:
        """Which wish gives way and by how much; None where depth of field and light agree."""
        rows = [row for row in self.solution.table() if row.counts]
        worst = max(rows, key=lambda row: abs(row.residual))
        return self.exposed.sentence(f"{worst.name!r} misses its wish by {abs(worst.residual):.2g} px")


def solve_exposed(
    points: ImagePoints,
    camera: Camera,
    lens: ThinLens | TiltShiftLens,
    grey: ArrayLike,
    exposure: Mapping[str, Any],
    *,
    settings: CameraSettings | None = None,
    priority: Priority = "focus",
    free: Sequence[str] = ("focus", "f_number"),
    **options: Any,
) -> ExposedSolution:
    """Focus, aperture, time and speed for wishes of focus in a given light.

    The f-number belongs to both. `solve` finds what the wishes take; where they leave it open, as limits to
    blur do, it is the widest that meets them, as far as that lowers the speed, and else as near to the
    starting lens's as the light allows. Time and speed follow (`choose_settings`). Where the wishes want an
    f-number for which no time and speed are right, "focus" first leaves the picture too dark or too bright,
    and "exposure" first solves again within the f-numbers for the light, in which
    focus may find another place. It looks at values on the way, and is not to be traced by JAX; `solution`
    is what `solve` finds from a good start, and that can be.

    Args:
        points: located wishes.
        camera: the pinhole that frames the picture.
        lens: where to start.
        grey: radiance that is to be a grey, such as `meter` gives of the sharp view.
        exposure: keyword arguments of `choose_settings`: `luminance`, and limits.
        settings: the lens's transmittance, and time and speed that are not free; none lost if None.
        priority: what goes first where the two want different apertures.
        free: as of `solve`; with "f_number".
        options: more arguments of `solve`.

    Raises:
        ArgumentError: as `solve`; another priority; no f-number free.
        ValueError: as `choose_settings`.

    Example:
        >>> from focusjax.focus import AtMost, AtPoint, FocusPoint, locate
        >>> from focusjax.geometry import look_at
        >>> from focusjax.lens import thin_lens
        >>> camera = look_at((0, 0, 0), (0, 0, -1), width=600, height=400, focal_length=0.05)
        >>> wishes = [FocusPoint(AtPoint((0, 0, -z)), AtMost(0.5)) for z in (2.0, 4.0)]
        >>> start = thin_lens(focus_distance=9.0, f_number=1.4, focal_length=0.05)
        >>> light = {"luminance": 20.0, "iso_range": (100, 1600)}
        >>> found = solve_exposed(locate(wishes, camera), camera, start, 0.18, light, priority="exposure")
        >>> print(found.sentence())  # doctest: +NORMALIZE_WHITESPACE
        The wishes for focus take f/10; at 1/60 s and ISO 1600 the light is right for f/2.7, 3.9 stops wider.
        Focus gives way: 'point 1' misses its wish by 1.4 px.
    """
    if priority not in ("focus", "exposure"):
        raise ArgumentError(
            f"the priority is {priority!r}; expected 'focus' or 'exposure', which of them goes first",
            "priority",
        )
    if "f_number" not in free:
        raise ArgumentError(
            f"free is {list(free)!r}, without an f-number for depth of field and light to settle; add"
            " 'f_number', or use solve",
            "free",
        )
    if options.get("close_focus", "ignored") != "ignored":
        raise ArgumentError(
            f"close_focus is {options['close_focus']!r}, and light and focus share f-numbers without it; use"
            " solve and then settings_through, or leave it out",
            "close_focus",
        )
    base = camera_settings(f_number=1.0, time=1.0) if settings is None else settings
    widest, narrowest = options.pop("f_number_range", None) or F_NUMBERS

    def chosen_for(solution: Solution) -> ChosenSettings:
        return choose_settings(grey, _on(base, solution.camera, solution.lens), **exposure)

    def within(least: float, most: float, start: ThinLens | TiltShiftLens = lens) -> Solution:
        least = min(max(least, widest), narrowest * (1.0 - _NARROW))
        most = min(max(most, least * (1.0 + _NARROW)), narrowest)
        start = _stopped(start, camera, least, most)
        return solve(points, camera, start, free=free, f_number_range=(least, most), **options)

    wished = solve(points, camera, lens, free=free, f_number_range=(widest, narrowest), **options)
    if points.relation is not None or "f_number" in wished.undetermined:
        wished = _settled(within, wished, chosen_for(wished).f_numbers, widest, narrowest)
    found = wished
    for _ in range(_ROUNDS if priority == "exposure" else 0):
        light, before = chosen_for(found).f_numbers, float(found.lens.f_number(found.camera))
        found = within(float(light.widest), float(light.narrowest), wished.lens)
        if abs(2.0 * math.log2(float(found.lens.f_number(found.camera)) / before)) < 0.1 * _STOP:
            break
    exposed = ExposedLens(
        lens=found.lens,
        camera=found.camera,
        wanted=wished.lens.f_number(wished.camera),
        chosen=chosen_for(found),
        priority=priority,
    )
    return ExposedSolution(found, wished, exposed)


def _settled(
    within: Callable[..., Solution],
    wished: Solution,
    light: FNumbersForLight,
    widest: float,
    narrowest: float,
) -> Solution:
    """What the wishes leave open of the f-number, settled by the light."""
    quiet = min(max(float(light.quietest), widest), narrowest)
    for _ in range(_SETTLINGS):
        number = float(wished.lens.f_number(wished.camera))
        if number > quiet:
            start = widest_as_good(within, wished, widest, quiet, number)
        elif number < float(light.widest):
            start = within(float(light.widest), narrowest)
        else:
            break
        # From there, since a range that ends there would be reported as a limit in the way.
        wished = within(widest, narrowest, start.lens)
        if abs(2.0 * math.log2(float(wished.lens.f_number(wished.camera)) / number)) < 10 * _STOP:
            break
    return wished


def open_for_light(
    lens: ThinLens | TiltShiftLens,
    camera: Camera,
    grey: ArrayLike,
    exposure: Mapping[str, Any],
    *,
    settings: CameraSettings | None = None,
    priority: Priority = "focus",
    f_number_range: tuple[float, float] = F_NUMBERS,
) -> ExposedLens:
    """As `solve_exposed` for a lens that is focused already, such as `depth_of_field_lens` makes.

    With "exposure" first its f-number becomes the nearest one for which the light is right.

    Args:
        lens: focused, with the f-number that is wanted.
        camera: the pinhole that frames the picture.
        grey: radiance that is to be a grey.
        exposure: keyword arguments of `choose_settings`.
        settings: the lens's transmittance, and time and speed that are not free; none lost if None.
        priority: what goes first.
        f_number_range: smallest and largest f-number of the lens.

    Raises:
        ValueError: as `choose_settings`.
    """
    base = camera_settings(f_number=1.0, time=1.0) if settings is None else settings
    wanted = lens.f_number(camera)
    if priority == "exposure":
        light = choose_settings(grey, _on(base, camera, lens), **exposure).f_numbers
        lens = _stopped(_stopped(lens, camera, light.widest, light.narrowest), camera, *f_number_range)
    chosen = choose_settings(grey, _on(base, camera, lens), **exposure)
    return ExposedLens(lens, camera, wanted, chosen, priority)


def _stopped(
    lens: ThinLens | TiltShiftLens, camera: Camera, least: ArrayLike, most: ArrayLike
) -> ThinLens | TiltShiftLens:
    """The lens with the nearest f-number in a range."""
    number = lens.f_number(camera)
    radius = lens.aperture_radius * number / jnp.clip(number, least, most)
    return dataclasses.replace(lens, aperture_radius=radius)


def _on(base: CameraSettings, camera: Camera, lens: ThinLens | TiltShiftLens) -> CameraSettings:
    """Settings with the f-number of a lens, and the light that it loses where it is focused."""
    # Focused beyond infinity the lens is nearer to the film by next to nothing.
    enlarged = magnification(camera.focal_length, jnp.maximum(lens.focus_disparity, 0.0))
    return dataclasses.replace(base, f_number=lens.f_number(camera), magnification=enlarged)
