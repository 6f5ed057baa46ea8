"""One run from a config with a `[shot]` to a folder of frames, a film and a report."""

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from focusjax._stopwatch import Stopwatch
from focusjax.config import Config, refusals_located
from focusjax.io import save_exr, staged_folder
from focusjax.job import Progress
from focusjax.many import Workers, check_workers
from focusjax.shot._build import build_settings, build_shot
from focusjax.shot._frame import save_frame
from focusjax.shot._frame_files import exposed_together
from focusjax.shot._render import RenderedFrames, render_frames
from focusjax.shot._report import REPORT_FILES, left_out_of_frames, save_report
from focusjax.shot._settings import FrameSettings
from focusjax.shot._solve import SolvedShot, solve_shot
from focusjax.shot._video import check_video, save_mp4


def film(
    config: Config,
    folder: Path,
    *,
    rendering: bool = True,
    frames: Sequence[int] | None = None,
    workers: Workers = 1,
    progress: Progress | None = None,
    on_note: Callable[[str], None] | None = None,
) -> tuple[SolvedShot, dict[str, Any]]:
    """Solve a config's shot, and write its frames, film and report.

    Frames go to the folder `frames` inside `folder` as they are made, and those that are there already
    from the same input are kept; all else appears when everything is done. A long exposure is of the frames
    that are rendered, and needs them as OpenEXR files.

    Args:
        config: a checked config with a `[shot]` table.
        folder: where results go; made when it is not there.
        rendering: make the pictures.
        frames: numbers of the frames to render, from 1; all when None. Always all are solved, and a film
            is made only of all.
        workers: who makes the frames; see `focusjax.many.carry_out`. All see the folder.
        progress: called with the stage that runs and the share of it that is done.
        on_note: called with a sentence on what a user should know.

    Returns:
        The solved shot, and what report.json holds.

    Raises:
        ValueError: something in the config turns out impossible; one sentence says what and what to do.
        ManyError: workers that cannot be used, or are lost.
        RuntimeError: frames that failed; all others were made.
    """
    report: Progress = progress if progress is not None else lambda stage, share: None
    watch = Stopwatch(on_stage=lambda stage: report(stage, None))
    formats = () if config.shot is None or not rendering else config.shot.formats
    wants_film = "mp4" in formats and frames is None
    if wants_film:
        check_video()
    with watch.stage("load"):
        shot = build_shot(config)
    assert config.shot is not None
    with staged_folder(folder, owned=REPORT_FILES) as stage:
        if rendering:
            pictures = folder / "frames"
            check_workers(workers, pictures)
            pictures.mkdir(exist_ok=True)
        with watch.stage("solve"), refusals_located(config):
            solved = solve_shot(shot, progress=report)
        rendered: RenderedFrames | None = None
        if rendering:
            settings = build_settings(config)
            if config.shot.long_exposure:
                formats = (*formats, "exr")
            with watch.stage("render"):
                rendered = render_frames(
                    solved,
                    pictures,
                    settings,
                    formats=formats,
                    frames=frames,
                    workers=workers,
                    progress=report,
                    on_note=on_note,
                )
            if (missing := left_out_of_frames(config, rendered)) is not None:
                warnings.warn(missing, stacklevel=2)
            if config.shot.long_exposure:
                with watch.stage("expose"):
                    _save_long_exposure(stage, solved, rendered, settings)
        if wants_film:
            assert rendered is not None
            with watch.stage("film"):
                save_mp4(stage / "shot.mp4", [files[0] for files in rendered.files], config.shot.fps)
        report("save", None)
        facts = save_report(stage, config, solved, rendered, watch.seconds, watch.compile_seconds)
    return solved, facts


def _save_long_exposure(
    folder: Path, solved: SolvedShot, rendered: RenderedFrames, settings: FrameSettings
) -> None:
    """All frames in one picture, taken with the camera of the first."""
    picture = np.asarray(exposed_together([files[-1] for files in rendered.files]).picture)
    save_exr(folder / "long_exposure.exr", picture)
    save_frame(folder / "long_exposure.png", picture, solved, rendered.frames[0], settings)
