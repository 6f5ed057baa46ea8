"""From a config to the camera that was solved for, in a file."""

from pathlib import Path

import numpy as np

from focusjax.config import Config, build_look, refuse_close_focus
from focusjax.exchange._early import refuse_a_shot, refuse_early, refuse_tilted_glass
from focusjax.exchange._export import TARGETS, Exported, checked_stage, checked_target, write_record
from focusjax.exchange._fitting import ExportError
from focusjax.exchange._record import record_of
from focusjax.job import Progress, run
from focusjax.lens import AbstractLens


def export_config(
    config: Config,
    path: Path,
    *,
    to: str,
    shot: bool = False,
    approximate: bool = False,
    name: str | None = None,
    metres_per_unit: float = 1.0,
    up_axis: str = "Y",
    progress: Progress | None = None,
) -> Exported:
    """Solve what a config wishes, and write the camera; without wishes, as the config has it.

    Args:
        config: a checked config.
        path: the file.
        to: as `export_camera`.
        shot: solve all frames of its `[shot]`.
        approximate: as `export_camera`.
        name: what the target is to call the camera; the config's title or file when not given.
        metres_per_unit: as `export_camera`.
        up_axis: as `export_camera`.
        progress: called with the stage that runs and the share of it that is done.

    Raises:
        ExportError: what the target cannot have; before the solve, where the config says it.
        ValueError: as `run`, `solve_shot` and `export_camera`.
    """
    # Shots import the reports, which are slow to load.
    from focusjax.shot import build_shot, solve_shot

    target = checked_target(to, path)
    stage = checked_stage(to, metres_per_unit, up_axis)
    refuse_close_focus(config, "an exported camera")
    refuse_tilted_glass(config)
    if shot:
        refuse_a_shot(config)
    if not approximate:
        refuse_early(config, target, TARGETS, shot=shot)
    called = name or config.title or config.source.stem
    if shot:
        made = build_shot(config)
        solved = solve_shot(made, progress=progress)
        pairs = [solved.seen_with(number, fit=False) for number in range(1, made.count + 1)]
        lenses = [pair[1] for pair in pairs]
        assert config.shot is not None
        record = record_of([pair[0] for pair in pairs], lenses, name=called, fps=config.shot.fps)
        seen = [(float(low), float(high)) for low, high in solved.depths]
    else:
        outcome = run(config, solving=bool(config.focus), rendering=False, progress=progress)
        lens: AbstractLens = outcome.lens if outcome.glass is None else outcome.glass.exact
        if outcome.glass is None and config.lens.look:
            lens = build_look(config, outcome.camera, outcome.lens)
        record = record_of(outcome.camera, lens, name=called)
        seen = [(float(np.min(outcome.disparity)), float(np.max(outcome.disparity)))]
    try:
        return write_record(record, path, to, approximate=approximate, disparities=seen, stage=stage)
    except ExportError as error:
        raise ExportError(f"{config.source}: {error}") from None
