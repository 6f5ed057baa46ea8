"""What `run`, `solve`, `render`, `refocus` and `shot` do, from a config to an exit status."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console

from focusjax import job
from focusjax._console import (
    BAD_INPUT,
    FAILED,
    INTERRUPTED,
    MISSED,
    Talk,
    fail,
    fail_inside,
    say,
    warnings_printed,
)
from focusjax._program_files import reading_ahead
from focusjax._progress import progress
from focusjax._summary import print_outcome, print_shot
from focusjax.config import Config, ConfigError
from focusjax.io import staged_folder
from focusjax.many import ManyError, chosen_workers
from focusjax.report import FILES, import_drawing, save_outcome
from focusjax.shot import film


@contextmanager
def _failures(
    errors: Console,
    folder: Path,
    talk: Talk,
    *,
    go_on: str = "begins anew",
    reword: Callable[[str], str] = str,
) -> Iterator[None]:
    """What is raised within becomes a sentence and an exit status.

    Args:
        errors: where it is said.
        folder: for the results.
        talk: how much to say.
        go_on: what the command does next time.
        reword: puts what is wrong with the input into the words of the command.
    """
    try:
        yield
    except (ConfigError, ManyError) as error:
        fail(errors, ConfigError(reword(str(error))), BAD_INPUT)
    except KeyboardInterrupt:
        fail(errors, RuntimeError(f"interrupted; the same command {go_on}"), INTERRUPTED)
    except (ValueError, RuntimeError, OSError, MemoryError) as error:
        fail(errors, error, FAILED, folder)
    except Exception as error:
        fail_inside(errors, error, talk)


def carry_out(
    read: Callable[[], Config],
    folder: Path,
    *,
    solving: bool,
    rendering: bool,
    talk: Talk,
    reword: Callable[[str], str] = str,
) -> None:
    """What a config asks for, into `folder`, to exit status; `reword` is for what is wrong with the input."""
    console, errors = Console(), Console(stderr=True)

    def begun(stage: str, share: float | None) -> None:
        report(stage, share)
        if stage == "render":
            threading.Thread(target=import_drawing).start()

    with _failures(errors, folder, talk, reword=reword):
        config = read()
        with (
            staged_folder(folder, owned=FILES) as stage,
            progress(errors, talk) as report,
            warnings_printed(errors),
            reading_ahead(f"{config.source.resolve()} {solving} {rendering}"),
        ):
            outcome = job.run(config, solving=solving, rendering=rendering, progress=begun)
            report("save", None)
            save_outcome(stage, outcome)
    if talk is not Talk.QUIET:
        print_outcome(console, outcome, folder)
    if outcome.solution is not None and not all(
        row.met or not row.counts for row in outcome.solution.table()
    ):
        raise typer.Exit(MISSED)


def carry_out_shot(
    read: Callable[[], Config],
    folder: Path,
    *,
    rendering: bool,
    frames: str | None,
    jobs: int,
    scheduler: str | None,
    talk: Talk,
) -> None:
    """All frames of a config's shot, into `folder`, to exit status.

    Args:
        read: makes the config.
        folder: for the results.
        rendering: make the pictures.
        frames: numbers such as "1,24" of the pictures to make; all when None.
        jobs: processes that make them.
        scheduler: of Dask, whose workers make them.
        talk: how much to say.
    """
    console, errors = Console(), Console(stderr=True)
    with _failures(errors, folder, talk, go_on="goes on with the frames that are left"):
        workers = chosen_workers(errors, jobs, scheduler)
        config = read()
        chosen = None if frames is None else _frames(frames)
        with (
            progress(errors, talk) as report,
            warnings_printed(errors),
            reading_ahead(f"{config.source.resolve()} shot {rendering}"),
        ):
            solved, _ = film(
                config,
                folder,
                rendering=rendering,
                frames=chosen,
                workers=workers,
                progress=report,
                on_note=lambda text: say(errors, f"Note: {text}"),
            )
    if talk is not Talk.QUIET:
        print_shot(console, solved)
        say(console, f"Report: {folder / 'report.html'}")
    if solved.missed():
        raise typer.Exit(MISSED)


def _frames(text: str) -> list[int]:
    """Frame numbers from text such as 1,24,48."""
    parts = text.split(",")
    if not all(part.strip().isdecimal() for part in parts):
        raise ConfigError(f"--frames is {text}; expected frame numbers such as 1,24,48")
    return [int(part) for part in parts]
