"""From a config to the camera that was solved for, in a file; what no solve can mend is refused before."""

from pathlib import Path

import numpy as np

from focusjax.config import Config, ConfigError, build_camera, build_lens, build_look, refuse_close_focus
from focusjax.exchange._export import TARGETS, Exported, checked_stage, checked_target, write_record
from focusjax.exchange._fitting import ExportError, Target, features, refusal
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
    _refuse_tilted_glass(config)
    if shot:
        _refuse_a_shot(config)
    if not approximate:
        _refuse_early(config, target, shot=shot)
    called = name or config.title or config.source.stem
    if shot:
        made = build_shot(config)
        solved = solve_shot(made, progress=progress)
        pairs = [solved.seen_with(number, fit=False) for number in range(1, made.count + 1)]
        cameras, lenses = [camera for camera, _ in pairs], [lens for _, lens in pairs]
        assert config.shot is not None
        record = record_of(cameras, lenses, name=called, fps=config.shot.fps)
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


def _refuse_a_shot(config: Config) -> None:
    """Refuse the frames of a lens with a focal surface and of a real one, exported for single pictures."""
    single = {
        "lens.focal_surface": (config.lens.focal_surface, "a focal surface"),
        f"lens.{config.lens.real}": (config.lens.real, "a real lens"),
    }
    for key, (given, what) in single.items():
        if given is not None and config.shot is not None and config.shot.frames > 1:
            raise ExportError(
                f"{config.source}: has {key}, and {what} is exported for a single picture, not for a shot;"
                " leave out --shot (shot=False), or the [shot] table"
            )


def _refuse_tilted_glass(config: Config) -> None:
    """Refuse a real lens that is turned, or may be by what is solved for."""
    turned = [f"lens.{key}" for key in ("tilt_deg", "swing_deg") if getattr(config.lens, key)]
    if config.focus:
        turned += [f"{name!r} in solve.free" for name in ("tilt", "swing") if name in config.solve.free]
    if config.lens.real is not None and turned:
        glass = f"lens.{config.lens.real}"
        raise ExportError(
            f"{config.source}: has {glass} and {turned[0]}, and no target has a real lens that is tilted;"
            f" leave out {glass} for the ideal lens of these settings, or {turned[0]}"
        )


def _early_features(config: Config, *, shot: bool) -> dict[str, str]:
    """Those `features` of a config's camera that a solve leaves as they are, as the config has them."""
    found: dict[str, str] = {}
    if config.lens.height_field is not None:
        found["odd glass"] = "a real lens with a height field"
    elif config.lens.prescription is not None:
        found["glass"] = f"a real lens ({config.lens.prescription})"
    if config.lens.focal_surface is not None:
        found["surface"] = "a focal surface"
    try:
        camera = build_camera(config)
        lens = build_lens(config, camera, solved=True)
        seen = lens if found or not config.lens.look else build_look(config, camera, lens)
    except ConfigError:
        # Keyframes may give what is missing here; if not, the solve says so.
        return found
    changing = set(config.solve.free) if config.focus else set()
    if shot and config.shot is not None:
        changing |= {key.rpartition("_")[0] for each in config.shot.lens for key in each.model_fields_set}
        # The sensor grows then, and with it what a pixel is.
        changing |= {"focal_length"} if config.shot.keep_field_of_view else set()
    may_change = {
        "tilt": {"tilt", "swing"},
        "shift": {"shift", "rise"},
        "fine shift": {"shift", "rise", "focal_length"},
    }
    known = features(record_of(camera, seen))
    return found | {key: words for key, words in known.items() if not changing & may_change.get(key, set())}


def _refuse_early(config: Config, target: Target, *, shot: bool) -> None:
    """Refuse what the target cannot have whatever is solved for."""
    found = _early_features(config, shot=shot)
    if found.keys() - set(target.has):
        raise ExportError(f"{config.source}: {refusal(found, target, TARGETS)}")
