"""A stack from its config to its pictures and its table."""

import csv
import io
import shutil
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from focusjax import job
from focusjax.config import (
    Config,
    ConfigError,
    build_camera,
    build_focus_points,
    build_scene,
    refusals_located,
    refuse_close_focus,
)
from focusjax.io import json_text, load_exr, save_exr, save_png, staged_folder
from focusjax.many import Journal, Task, Workers, carry_out, check_workers, finished_folder
from focusjax.report import save_outcome
from focusjax.stack._merge import merge
from focusjax.stack._plan import StackPlan, plan_stack

FILES = ("stack.csv", "stack.json", "merged.png", "merged.exr")
"""Every file that a stack leaves in its folder, beside the folder `shots`."""
_SHOTS = "shots"
_SINGLE = "single"


def take_stack(
    config: Config,
    folder: Path,
    *,
    f_number: float | None = None,
    rendering: bool = True,
    workers: Workers = 1,
    on_note: Callable[[str], None] | None = None,
) -> StackPlan:
    """Plan a stack for a config's sharp wishes, and make its pictures.

    The folder gets `stack.csv`, a table to take to the camera, and `stack.json`; with pictures `shots/01`,
    `shots/02`, ... as `focusjax render` leaves them, nearest first, `merged.png` and `.exr`, the picture made
    of them, and `shots/single`, what one shot at the smallest aperture gives.

    Args:
        config: with wishes that are to be sharp, and a thin lens that is not turned.
        folder: made if need be.
        f_number: of all shots; None for the widest one that takes no more shots than the smallest aperture.
        rendering: make the pictures.
        workers: who makes them; see `focusjax.many.carry_out`.
        on_note: called with a sentence on what a user should know.

    Raises:
        ConfigError: a config with a lens for which there is no plan, or without sharp wishes.
        RuntimeError: a picture that failed.
    """
    plan = _planned(config, f_number)
    if rendering:
        check_workers(workers, folder)
    with staged_folder(folder, owned=FILES) as stage:
        (stage / "stack.csv").write_text(table(plan), encoding="utf-8", newline="")
        (stage / "stack.json").write_text(json_text(asdict(plan)), encoding="utf-8")
        if not rendering:
            return plan
        shots = folder / _SHOTS
        shutil.rmtree(shots, ignore_errors=True)
        shots.mkdir()
        tasks = [
            Task(f"{number:02}", _focused(config, shot.focus_distance, plan.f_number))
            for number, shot in enumerate(plan.shots, start=1)
        ]
        names = [task.name for task in tasks]
        tasks.append(Task(_SINGLE, _focused(config, plan.single_focus, plan.single_f_number)))
        for ended in carry_out(take, tasks, shots, workers=workers, on_note=on_note):
            if ended.error:
                raise RuntimeError(f"shot {ended.task.name}: {ended.error}")
        channels = [load_exr(shots / name / "image.exr") for name in names]
        pictures = [np.stack([each[name] for name in "RGB"], axis=-1) for each in channels]
        merged = merge(pictures, [each["blur"] for each in channels], plan.circle_px)
        save_exr(stage / "merged.exr", merged.astype(np.float32))
        save_png(stage / "merged.png", merged, exposure=config.render.exposure, bits=config.render.png_bits)
    return plan


def take(task: Task, journal: Journal) -> None:
    """One shot: the picture of a config whose lens is as it says."""
    with finished_folder(journal, task.name) as stage:
        save_outcome(stage, job.run(task.argument, solving=False))


def table(plan: StackPlan) -> str:
    """The plan as a CSV file."""
    stream = io.StringIO()
    writer = csv.writer(stream)
    head = (
        "shot",
        "focus_distance_m",
        "f_number",
        "near_m",
        "far_m",
        "overlap_per_m",
        "worst_blur_px",
        "sharp",
    )
    writer.writerow(head)
    for number, (shot, overlap) in enumerate(zip(plan.shots, (*plan.overlaps(), ""), strict=True), start=1):
        ends = (shot.focus_distance, plan.f_number, shot.near, shot.far)
        writer.writerow([number, *ends, overlap, shot.worst_px, "; ".join(shot.names)])
    return stream.getvalue()


def _planned(config: Config, f_number: float | None) -> StackPlan:
    refuse_close_focus(config, "a plan of shots")
    lens = config.lens
    for key in ("tilt_deg", "swing_deg", "focal_surface", "prescription", "height_field"):
        if getattr(lens, key):
            raise ConfigError(
                f"{config.source}: there is lens.{key}, and stacks are planned for a thin lens that is not"
                " turned; leave it out"
            )
    if f_number is not None and not 0.1 <= f_number <= 1000:
        raise ConfigError(f"--f-number is {f_number:g}; expected a number such as 8")
    camera, scene = build_camera(config), build_scene(config)
    wishes = build_focus_points(config, scene)
    if not wishes:
        raise ConfigError(f"{config.source}: there are no wishes; give [[focus]] tables with sharp = true")
    solve = config.solve
    with refusals_located(config):
        points = job.find_points(wishes, scene, camera)
    try:
        return plan_stack(
            points,
            camera,
            f_number=f_number,
            f_number_range=(solve.f_number_min, solve.f_number_max),
            min_focus_distance=solve.min_focus_distance_m or 0.0,
        )
    except ValueError as error:
        raise ConfigError(f"{config.source}: {error}") from None


def _focused(config: Config, distance: float, f_number: float) -> Config:
    """The config with its lens set by hand."""
    changes = {
        "focus_distance_m": distance,
        "f_number": f_number,
        "aperture_radius_mm": None,
        "sharp_from_m": None,
        "sharp_to_m": None,
    }
    return config.anywhere().model_copy(update={"lens": config.lens.model_copy(update=changes)})
