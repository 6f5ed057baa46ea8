"""What a config's wishes lead to: the lens, how each wish is met, and what is under a pixel."""

import dataclasses

import numpy as np

from focusjax import job
from focusjax._console import sentence
from focusjax._settings import metres
from focusjax.config import Config
from focusjax.focus import Solution, SurfaceSolution, WishResult, diagnose
from focusjax.lens import DepthOfField, depth_of_field
from focusjax.report import movements
from focusjax.studio._stage import Stage

_DEGREE = float(np.degrees(1.0))
NO_WISH = "Nothing is wished for yet. Click on what should be sharp."


@dataclasses.dataclass(frozen=True)
class Under:
    """What is under a point of the picture.

    Attributes:
        object: its name; empty on the background.
        distance: metres along the view axis; infinite on the background.
        blur: signed circle-of-confusion diameter in pixels, positive behind the focus; None without a lens.
    """

    object: str
    distance: float
    blur: float | None

    def sentence(self) -> str:
        """For a person who points at it."""
        name = self.object or "background"
        text = f"{name}, {metres(self.distance)} away" if np.isfinite(self.distance) else name
        if self.blur is None:
            return text
        side = "" if abs(self.blur) < 0.05 else " behind the focus" if self.blur > 0 else " before the focus"
        return f"{text}, blur {abs(self.blur):.1f} px{side}"


@dataclasses.dataclass(frozen=True)
class Control:
    """A control point of the focal surface.

    Attributes:
        name: as the config has it, or a number.
        mark: where it is in the picture in pixels; None where that is not known.
        distance: metres to which the lens is focused there, infinite beyond infinity, too; None without one.
    """

    name: str
    mark: tuple[float, float] | None
    distance: float | None


@dataclasses.dataclass(frozen=True, eq=False)
class Answer:
    """The lens for one text of a config.

    Attributes:
        number: of the request; later requests have larger numbers.
        config: what was asked.
        stage: what the camera sees, with the solved framing.
        outcome: of the run without a picture; None where there is no lens.
        problem: why there is none; empty otherwise.
        sentences: which wishes and limits stand in the way; None where they are not worked out yet.
        uncertainty: by how much settings would change if blurs were uncertain by the wishes' tolerances, in
            the units of `values`; empty where that is not worked out.
        frame: of a shot, counted from 1; 0 for a still.
        rows: the wishes' lines, of a frame; None where the outcome has them.
        left_open: settings that the wishes of all frames together leave open.
    """

    number: int
    config: Config
    stage: Stage
    outcome: job.Outcome | None
    problem: str = ""
    sentences: tuple[str, ...] | None = None
    uncertainty: dict[str, float] = dataclasses.field(default_factory=dict)
    frame: int = 0
    rows: tuple[WishResult, ...] | None = None
    left_open: tuple[str, ...] = ()

    @property
    def wishes(self) -> tuple[WishResult, ...]:
        """A line for each wish, in the config's order; empty where nothing was solved."""
        if self.rows is not None:
            return self.rows
        solution = None if self.outcome is None else self.outcome.solution
        return () if solution is None else solution.table()

    def marks(self) -> list[tuple[float, float] | None]:
        """Where each wish is in the picture in pixels; None where that is not known.

        Of an object with many samples, the one in their middle.
        """
        points = None if self.outcome is None else self.outcome.points
        if points is None:
            return [wish.pixel for wish in self.config.focus]
        xy, wish = np.asarray(points.xy, dtype=float), np.asarray(points.wish)
        seen = np.asarray(points.weight) > 0
        found: list[tuple[float, float] | None] = []
        for number in range(len(points.names)):
            both = (wish == number) & seen
            mine = xy[both if both.any() else wish == number]
            if not len(mine):
                found.append(None)
                continue
            best = mine[np.argmin(np.linalg.norm(mine - mine.mean(axis=0), axis=1))]
            found.append((float(best[0]), float(best[1])))
        return found

    def mark(self, number: int) -> tuple[float, float] | None:
        """Where a wish is in the picture; None where that is not known, or there is no such wish yet."""
        marks = self.marks()
        return marks[number] if number < len(marks) else None

    def controls(self) -> tuple[Control, ...]:
        """The control points of the focal surface, in the config's order; none where the focus is a plane."""
        table = self.config.lens.focal_surface
        if table is None:
            return ()
        names = [each.name or each.object or f"point {k + 1}" for k, each in enumerate(table.points)]
        surface = None if self.outcome is None else self.outcome.surface
        if surface is None:
            return tuple(
                Control(name, each.pixel, None) for name, each in zip(names, table.points, strict=True)
            )
        xy, disparity = np.asarray(surface.xy, dtype=float), np.asarray(surface.focus_disparity, dtype=float)
        return tuple(
            Control(name, (float(place[0]), float(place[1])), 1.0 / w if w > 0 else np.inf)
            for name, place, w in zip(names, xy, disparity.tolist(), strict=True)
        )

    def under(self, x: float, y: float) -> Under:
        """What is at pixel position (`x`, `y`), which is moved into the frame."""
        rows, columns = self.stage.disparity.shape
        column, row = (int(np.clip(v, 0, n - 1)) for v, n in ((x, columns), (y, rows)))
        disparity = float(self.stage.disparity[row, column])
        blur = None if self.outcome is None else float(self.outcome.blur[row, column])
        return Under(
            object=self.stage.object_at(column, row) if disparity > 0 else "",
            distance=1.0 / disparity if disparity > 0 else np.inf,
            blur=blur,
        )

    def depth_of_field(self) -> DepthOfField | None:
        """From where to where the picture's middle is sharp; None without a lens."""
        if self.outcome is None:
            return None
        return depth_of_field(self.outcome.camera, self.outcome.middle_lens)

    def values(self) -> dict[str, float]:
        """Settings of the lens by name: metres, f-number, degrees, mm; empty without a lens."""
        if self.outcome is None:
            return {}
        lens, camera = self.outcome.middle_lens, self.outcome.camera
        moved = movements(self.outcome)
        return {
            "focus": float(lens.focus_distance()),
            "f_number": float(lens.f_number(camera)),
            "tilt": moved["tilt_deg"],
            "swing": moved["swing_deg"],
            "focal_length": 1000 * float(camera.focal_length),
        }

    def uncertain(self) -> tuple[str, ...]:
        """Names of settings that the wishes leave open."""
        solution = None if self.outcome is None else self.outcome.solution
        return solution.undetermined if isinstance(solution, Solution) else self.left_open

    def with_sentences(self) -> "Answer":
        """The same with what stands in the way, which takes further solves."""
        solution = None if self.outcome is None else self.outcome.solution
        if isinstance(solution, Solution):
            found = diagnose(solution)
            return dataclasses.replace(
                self, sentences=found.sentences, uncertainty=self._in_units(found.standard_errors)
            )
        if isinstance(solution, SurfaceSolution):
            names = [control.name for control in self.controls()]
            return dataclasses.replace(self, sentences=diagnose(solution, controls=names).sentences)
        return dataclasses.replace(self, sentences=())

    def _in_units(self, errors: dict[str, float]) -> dict[str, float]:
        """Standard errors of a diagnosis (dioptres, f-numbers, radians) in the units of `values`."""
        factors = {
            "focus": self.values()["focus"] ** 2, "f_number": 1.0, "tilt": _DEGREE, "swing": _DEGREE,
            "focal_length": 1000.0,
        }  # fmt: skip
        return {name: error * factors[name] for name, error in errors.items() if name in factors}


def answer(config: Config, stage: Stage, number: int = 0) -> Answer:
    """The lens that `focusjax run` finds for `config`; without wishes, the config's own.

    `Answer.problem` says what cannot be solved.
    """
    solving = bool(config.focus)
    has_focus = config.lens.focus_distance_m is not None or config.lens.sharp_from_m is not None
    if not solving and not has_focus and config.lens.focal_surface is None:
        return Answer(number, config, stage, None, NO_WISH)
    try:
        outcome = job.run(
            config, solving=solving, rendering=False, scene=stage.scene, disparity=stage.disparity
        )
    except (ValueError, RuntimeError) as error:
        return Answer(number, config, stage, None, sentence(error))
    if {"focal_length", "shift", "rise"} & set(config.solve.free):
        stage = stage.seen_from(outcome.camera)
    return Answer(number, config, stage, outcome)
