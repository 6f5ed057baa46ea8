"""A shot in the studio: its frames solved together, and each of them as an answer of its own."""

import dataclasses
from collections import OrderedDict
from functools import cached_property
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from focusjax import job
from focusjax.config import Config
from focusjax.focus import FramesSolution, SurfaceFramesSolution
from focusjax.job import Progress as Progress
from focusjax.layers import first_surfaces
from focusjax.shot import MovingScene, SolvedShot, build_shot, solve_shot
from focusjax.studio._answer import Answer
from focusjax.studio._stage import Stage

PerFrame = TypeVar("PerFrame")
_MOST_BYTES = 800 << 20
"""Of what is kept of the frames' first surfaces; the frame least recently looked at goes first."""


@dataclasses.dataclass(frozen=True, eq=False)
class Reel:
    """A solved shot.

    Attributes:
        number: of the request; later requests have larger numbers.
        config: what was asked.
        solved: the lenses of all frames.
        stages: gives what a frame shows.
    """

    number: int
    config: Config
    solved: SolvedShot
    stages: "Stages"
    _sentences: list[tuple[str, ...]] = dataclasses.field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of frames."""
        return self.solved.solution.count

    def answer(self, frame: int) -> Answer:
        """What the page shows of one frame, counted from 1."""
        solution = self.solved.solution
        camera, lens = solution.at(frame - 1)
        stage = self.stages.of(frame)
        if {"focal_length", "shift", "rise"} & set(self.config.solve.free):
            stage = stage.seen_from(camera)
        outcome = job.Outcome(
            config=self.config,
            camera=camera,
            lens=lens,
            points=_at(solution.points, frame),
            solution=None,
            disparity=stage.disparity,
            blur=np.asarray(job.blur_map(lens, camera, jnp.asarray(stage.disparity, dtype=float))),
            picture=None,
            photograph=None,
            seconds={},
            compile_seconds={},
            surface=_at(solution.surface, frame) if isinstance(solution, SurfaceFramesSolution) else None,
        )
        full = self.solved.share[frame - 1] > 0
        rows = tuple(
            row if counts else dataclasses.replace(row, weight=0.0)
            for row, counts in zip(solution.table(frame - 1), full, strict=True)
        )
        return Answer(
            self.number,
            self.config,
            stage,
            outcome,
            sentences=self._sentences[-1] if self._sentences else None,
            rows=rows,
            left_open=solution.undetermined if isinstance(solution, FramesSolution) else (),
            frame=frame,
        )

    def sentences(self) -> tuple[str, ...]:
        """Which wishes and limits stand in the way, and in which frames; this takes further solves."""
        self._sentences.append(tuple(self.solved.diagnosis.sentences))
        return self._sentences[-1]

    @cached_property
    def curves(self) -> dict[str, Float[np.ndarray, "t"]]:
        """Over the frames: focus in 1/m, f-number, and "blur 0", ...: the signed blur of each wish in px."""
        solution = self.solved.solution
        settings = solution.settings()
        tables = [solution.table(frame) for frame in range(solution.count)]
        blurs = {f"blur {k}": np.array([table[k].got for table in tables]) for k in range(len(tables[0]))}
        return {"focus": settings["focus_per_m"], "f_number": settings["f_number"], **blurs}


class Stages:
    """What the frames of a scene show, made when it is asked for and kept."""

    def __init__(self, config: Config):
        """Load what moves.

        Raises:
            ConfigError: as `build_shot`.
        """
        self.config = config
        self._shot = build_shot(config)
        self._kept: OrderedDict[int, Stage] = OrderedDict()

    @property
    def scene(self) -> MovingScene:
        """What is filmed."""
        return self._shot.scene

    def of(self, frame: int) -> Stage:
        """What a frame shows, counted from 1."""
        if frame not in self._kept:
            scene, camera = self._shot.scene.at(frame), self._shot.cameras[frame - 1]
            disparity, face = first_surfaces(scene, camera)
            self._kept[frame] = Stage(scene, camera, disparity, face.astype(np.int32))
            size = disparity.nbytes + self._kept[frame].face.nbytes
            while len(self._kept) * size > _MOST_BYTES and len(self._kept) > 1:
                self._kept.popitem(last=False)
        self._kept.move_to_end(frame)
        return self._kept[frame]

    def serve(self, config: Config) -> bool:
        """Whether the frames of `config` show the same."""
        mine, other = self.config.shot, config.shot
        assert mine is not None
        return (
            other is not None
            and (mine.frames, mine.camera, mine.objects, mine.between)
            == (other.frames, other.camera, other.objects, other.between)
            and self.config.scene == config.scene
            and self.config.camera == config.camera
            and self.config.source == config.source
        )


class ReelMaker:
    """Solves shots, and keeps what their frames show for as long as it serves."""

    def __init__(self) -> None:
        self._stages: Stages | None = None

    def reel_for(self, config: Config, number: int = 0, progress: Progress | None = None) -> Reel:
        """All frames of the shot of `config`, solved together as `focusjax shot` does.

        Raises:
            ValueError: as `build_shot` and `solve_shot`.
            RuntimeError: the solver failed.
        """
        stages = self._stages_for(config)
        shot = build_shot(config, stages.scene)
        solved = solve_shot(shot, progress=progress, disparities=lambda frame: stages.of(frame).disparity)
        return Reel(number, config, solved, stages)

    def stage(self, config: Config, frame: int) -> Stage:
        """What a frame shows.

        Raises:
            ConfigError: as `build_shot`.
        """
        return self._stages_for(config).of(frame)

    def _stages_for(self, config: Config) -> Stages:
        if self._stages is None or not self._stages.serve(config):
            self._stages = Stages(config)
        return self._stages


def _at(tree: PerFrame, frame: int) -> PerFrame:
    """What arrays of all frames hold of one; by numpy, which compiles nothing."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[frame - 1], tree)
