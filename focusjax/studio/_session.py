"""One config being worked on: its text, wishes, lens and history, without any page."""

from pathlib import Path
from typing import Any

from focusjax.config import Config
from focusjax.studio import _lens_settings as lens_settings
from focusjax.studio import _surface_edits as surface
from focusjax.studio import _timing as timing
from focusjax.studio import _wishes as wishes
from focusjax.studio._answer import Answer, Under, answer
from focusjax.studio._document import Change, Document, EditError, set_value, together
from focusjax.studio._reel import Progress, Reel, ReelMaker
from focusjax.studio._stage import StageMaker

_LIMITS_OF = {"time": ("longest_time", "shortest_time"), "iso": ("iso_min", "iso_max")}


class Session:
    """Edits a config and solves it: everything that the page does, for any other program to do.

    Edits change the text at once. `solve` is what takes time, and may be called from one other thread.

    Attributes:
        document: the text with its history; save it with `document.save()`.
        number: of the latest edit; answers carry it.

    Example:
        >>> session = Session(Path("configs/still_life.toml"))  # doctest: +SKIP
        >>> cow = session.add_point(300, 260)  # doctest: +SKIP
        >>> session.wish_for(cow, "at_most", pixels=2)  # doctest: +SKIP
        >>> print(session.solve().outcome.solution)  # doctest: +SKIP
    """

    def __init__(self, path: Path | str, *, root: Path | None = None, text: str | None = None):
        """Open the config at `path`, also where it has errors: `document.problem` names them.

        Args:
            path: a TOML file.
            root: the folder below which its files lie; the config's own by default.
            text: of a new config, which is not written to `path` before it is saved.

        Raises:
            ConfigError: the file cannot be read as text.
        """
        self.document = Document(Path(path), root=root, text=text)
        self.number = 0
        self._maker = StageMaker()
        self._reels = ReelMaker()
        self._answer: Answer | None = None
        self._weights: dict[str, tuple[float, dict[float, float]]] = {}
        self._pixels: dict[str, tuple[float, float]] = {}

    @property
    def config(self) -> Config:
        """What the text says.

        Raises:
            EditError: it cannot be used.
        """
        if self.document.config is None:
            raise EditError(self.document.problem)
        return self.document.config

    def solve(self, config: Config | None = None, number: int | None = None) -> Answer:
        """The lens for the config as it is now, as `focusjax run` finds it, without a picture.

        Args:
            config: another config of the session, such as that of the edit `number`.
            number: for the answer to carry.

        Raises:
            EditError: the text is no usable config.
            ConfigError: a mesh or a camera that cannot be used.
        """
        config = self.config if config is None else config
        number = self.number if number is None else number
        self._answer = answer(config, self._maker.stage_for(config), number)
        return self._answer

    def solve_shot(
        self, config: Config | None = None, number: int | None = None, progress: Progress | None = None
    ) -> Reel:
        """The lenses of all frames of the config's shot, as `focusjax shot` finds them.

        Arguments are those of `solve`, and `progress` is called with the stage that runs and its share done.

        Raises:
            EditError: the text is no usable config.
            ValueError: a shot that cannot be built or solved.
            RuntimeError: the solver failed.
        """
        config = self.config if config is None else config
        return self._reels.reel_for(config, self.number if number is None else number, progress)

    def before_shot(self, config: Config, frame: int, number: int, problem: str = "") -> Answer:
        """What a frame shows before the shot is solved, or where that fails."""
        self._answer = Answer(number, config, self._reels.stage(config, frame), None, problem, frame=frame)
        return self._answer

    def frame_of(self, reel: Reel, frame: int) -> Answer:
        """A frame of a shot as an answer, to which `under` refers from then on."""
        self._answer = reel.answer(frame)
        return self._answer

    def under(self, x: float, y: float) -> Under:
        """What the last answer has at pixel position (`x`, `y`)."""
        return (self._answer or self.solve()).under(x, y)

    def add_point(self, x: float, y: float) -> int:
        """Wish that what is under (`x`, `y`) is sharp; the number of the new wish."""
        config = self.config
        name = wishes.name_for(config, self.under(x, y).object)
        self._edit(together(wishes.new_wish(name, x, y), surface.control_with(config, name, x, y)))
        return len(self.config.focus) - 1

    def move_point(self, number: int, x: float, y: float, *, drag: str = "") -> None:
        """Move a wish to what is under (`x`, `y`); moves with the same `drag` are undone together."""
        x, y = self._inside(x, y)
        follows = surface.control_follows(self.config, number, wishes.pixel_row(x, y))
        self._edit(together(wishes.move(number, x, y), follows), f"move {number} {drag}" if drag else "")

    def end_drag(self) -> None:
        """The next move is undone by itself."""
        self.document.end_label()

    def delete_point(self, number: int) -> None:
        """Forget a wish, and its track in a shot."""
        config = self.config
        follow = timing.delete_track(config, number), surface.control_deleted(config, number)
        self._edit(together(*follow, wishes.delete_wish(number)))

    def wish_for(self, number: int, kind: str, *, pixels: float = 0.0, other: str = "") -> None:
        """Change what is wished; see `wish_for` of the wishes.

        Keyframes of its blur go where they would mean something else.
        """
        config = self.config
        change = wishes.wish_for(number, kind, pixels=pixels, other=other)
        if wishes.pixels_of(config.focus[number]) is None or kind not in wishes.MEASURED:
            change = together(timing.without_keys(config, number, "blur"), change)
        rows = () if self._answer is None else self._answer.wishes
        before = number < len(rows) and rows[number].got < 0
        blur = 0.0 if kind == "sharp" else -pixels if before else pixels
        self._edit(together(change, surface.control_blurred(config, number, blur)))

    def rename(self, number: int, name: str) -> None:
        """Call a wish something else."""
        config = self.config
        renamed, called = wishes.rename(config, number, name), name.strip()
        follow = timing.rename_track(config, number, called), surface.control_renamed(config, number, called)
        self._edit(together(*follow, renamed))

    def set_weight(self, number: int, weight: float, frame: int = 0) -> None:
        """How much a wish counts: at a frame of a shot, where that has keyframes."""
        if frame and timing.keys_of(self.config, number, "weight"):
            self.set_key(number, frame, "weight", weight)
        else:
            self._edit(wishes.set_number(number, "weight", weight))

    def set_pixels(self, number: int, pixels: float, frame: int = 0) -> None:
        """The diameter that is wished for: at a frame of a shot, where that has keyframes."""
        if frame and timing.keys_of(self.config, number, "blur"):
            self.set_key(number, frame, "blur", pixels)
        else:
            self.wish_for(number, wishes.kind_of(self.config, number), pixels=pixels)

    def set_tolerance(self, number: int, pixels: float | None) -> None:
        """The largest miss in pixels that still counts as met; None for the usual."""
        self._edit(wishes.set_number(number, "tolerance_px", pixels))

    def switch(self, number: int, *, on: bool) -> None:
        """Let a wish count, as much as before it was switched off, or not."""
        config = self.config
        name, weight = wishes.called(config, number), config.focus[number].weight
        if on == (weight > 0):
            return
        if not on:
            # Keyframes of its weight would let it count all the same.
            self._weights[name] = weight, timing.keys_of(config, number, "weight")
            off = wishes.set_number(number, "weight", 0.0)
            self._edit(together(timing.without_keys(config, number, "weight"), off))
            return
        weight, keys = self._weights.get(name, (1.0, {}))
        again = [timing.set_key(config, number, int(frame), "weight", value) for frame, value in keys.items()]
        self._edit(together(wishes.set_number(number, "weight", weight), *again))

    def spread(self, number: int, *, whole: bool) -> None:
        """Let a wish be about the whole object that it is on, or about one point of it.

        Raises:
            EditError: there is no object under it.
        """
        wish, name = self.config.focus[number], wishes.called(self.config, number)
        if whole == (wish.object is not None and wish.triangle is None):
            return
        marks = (self._answer or self.solve()).marks()
        # That of a new wish is where it was set, until the answer comes.
        mark = marks[number] if number < len(marks) else wish.pixel
        if mark is None:
            raise EditError(f"{name!r} is nowhere in the picture; move it there first")
        if not whole:
            self.move_point(number, *self._pixels.get(name, mark))
            return
        found = self.under(*mark).object
        if not found:
            raise EditError(f"{name!r} is on the background, which is no object; move it onto one")
        self._pixels[name] = mark
        follows = surface.control_follows(self.config, number, {"object": found})
        self._edit(together(wishes.whole_object(number, found), follows))

    def act(self, number: int, end: str, frame: int | None) -> None:
        """Let a wish of a shot act "from" or "to" a frame; None for the shot's first or last."""
        self._edit(timing.set_span(self.config, number, end, frame))

    def value_at(self, number: int, frame: int, what: str) -> float:
        """The "blur" or the "weight" of a wish at a frame of the shot."""
        return timing.value_at(self.config, number, frame, what)

    def set_key(self, number: int, frame: int, what: str, value: float) -> None:
        """Give the "blur" (in the unit of the wish) or the "weight" of a wish a keyframe."""
        self._edit(timing.set_key(self.config, number, frame, what, value))

    def delete_key(self, number: int, frame: int) -> None:
        """Take a keyframe of a wish away."""
        self._edit(timing.delete_key(self.config, number, frame))

    def free(self, name: str) -> None:
        """Let the wishes decide a setting of the lens."""
        self._edit(lens_settings.free(self.config, name))

    def fix(self, name: str, value: float | None = None) -> None:
        """Keep a setting of the lens at `value`, or at what the last answer says."""
        if value is None:
            value = (self._answer or self.solve()).values().get(name)
        if value is None:
            raise EditError(f"there is no {lens_settings.SETTINGS[name].label} yet to keep; give a value")
        self._edit(lens_settings.fix(self.config, name, value), f"fix {name}")

    def limit(self, name: str, end: str, value: float | None) -> None:
        """Set the "low" or "high" limit of a free setting; None for the usual one."""
        self._edit(lens_settings.limit(self.config, name, end, value))

    def use_surface(self) -> None:
        """Let the focus differ from place to place, with a control point for every wish that counts.

        Control points that are called as a wish move, and go, with it.
        """
        answer = self._answer or self.solve()
        self._edit(surface.use_surface(self.config, answer.wishes, answer.values()))

    def use_plane(self) -> None:
        """Focus on a plane again, at the distance that the surface has in the picture's middle."""
        self._edit(surface.use_plane((self._answer or self.solve()).values()))

    def add_control(self, x: float, y: float) -> int:
        """A control point of the focal surface at what is under (`x`, `y`); its number."""
        x, y = self._inside(x, y)
        self._edit(surface.add_control(self.config, self.under(x, y).object or "background", x, y))
        table = self.config.lens.focal_surface
        assert table is not None
        return len(table.points) - 1

    def move_control(self, number: int, x: float, y: float, *, drag: str = "") -> None:
        """Move a control point to what is under (`x`, `y`); `drag` as for `move_point`."""
        move = surface.move_control(number, *self._inside(x, y))
        self._edit(move, f"move control {number} {drag}" if drag else "")

    def set_control(self, number: int, key: str, value: Any) -> None:
        """Set the "blur_px", "aperture_scale" or "weight" of a control point."""
        self._edit(surface.set_control(number, key, value), f"control {number} {key}")

    def delete_control(self, number: int) -> None:
        """Forget a control point."""
        self._edit(surface.delete_control(self.config, number))

    def set_surface(self, key: str, value: Any) -> None:
        """Set the "basis" or the "smoothness" of the focal surface."""
        self._edit(surface.set_surface(key, value))

    def set_kernel(self, kind: str, *, exponent: float | None = None, size: float | None = None) -> None:
        """How far control points are felt; see `set_kernel` of the focal surface's edits."""
        self._edit(surface.set_kernel(self.config, kind, exponent=exponent, size=size))

    def set_exposure(self, table: str, key: str, value: Any) -> None:
        """Set a key of "exposure" or "film"; None removes it.

        Limits to what is given by hand go, and the priority where both time and ISO are.
        """
        idle = list(_LIMITS_OF.get(key, ()) if value is not None else ())
        exposure, other = self.config.exposure, {"time": "iso", "iso": "time"}.get(key, "")
        if value is not None and exposure is not None and getattr(exposure, other, None) is not None:
            # Nothing is left to choose.
            idle.append("priority")
        removed = (set_value(table, each, value=None) for each in idle)
        self._edit(together(*removed, set_value(table, key, value=value)))

    def set_text(self, text: str) -> None:
        """Take a whole text."""
        self.document.replace(text)
        self.number += 1

    def undo(self) -> None:
        """Take the last edit back."""
        self.document.undo()
        self.number += 1

    def redo(self) -> None:
        """Do again what was taken back."""
        self.document.redo()
        self.number += 1

    def _inside(self, x: float, y: float) -> tuple[float, float]:
        """The place in the picture that is nearest."""
        width, height = self.config.camera.resolution
        return min(max(x, 0.0), width), min(max(y, 0.0), height)

    def _edit(self, change: Change, label: str = "") -> None:
        self.document.edit(change, label)
        self.number += 1
