"""The final picture, or all frames of a shot, made in a thread of its own while the page goes on."""

import dataclasses
import threading
from collections.abc import Callable
from pathlib import Path

from focusjax import job
from focusjax.config import Config
from focusjax.io import staged_folder
from focusjax.report import FILES, save_outcome
from focusjax.shot import film
from focusjax.studio._document import EditError
from focusjax.studio._latest import Cancelled as IsCancelled
from focusjax.studio._latest import Latest, what_failed
from focusjax.studio._painter import Cancelled

_STAGES = {
    "load": "loading",
    "meter": "metering",
    "locate": "looking for the points",
    "locate_again": "looking for the points",
    "solve": "solving",
    "solve_again": "solving",
    "glass": "tracing the glass",
    "peel": "taking the scene apart into layers",
    "plan": "planning the rays",
    "pinhole": "making the sharp view",
    "render": "tracing rays",
    "develop": "developing",
    "save": "writing files",
}


@dataclasses.dataclass(frozen=True)
class FinalState:
    """How far the final picture is.

    Attributes:
        word: "" before the first, "rendering", "rendered", "cancelled" or "failed".
        share: of a shot's frames that are rendered, 0 to 1; 0 for a still.
        detail: what is being done, or a sentence on how it ended.
    """

    word: str = ""
    share: float = 0.0
    detail: str = ""


class Final:
    """Makes final pictures, one at a time.

    Attributes:
        state: how far it is.
    """

    def __init__(self, changed: Callable[[], None]):
        """Start the thread; `changed` is called whenever there is a new state."""
        self.state = FinalState()
        self._changed = changed
        self._lock = threading.Lock()
        self._latest = Latest("focusjax final picture", self._failed)

    @property
    def busy(self) -> bool:
        """Whether one is being made."""
        return self.state.word == "rendering"

    def start(self, config: Config, folder: Path) -> None:
        """Make what `config` says, with its report, into `folder`, whatever is edited meanwhile.

        Raises:
            EditError: the folder cannot be written to.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise EditError(
                f"{folder.absolute()}: pictures cannot be written there ({error.strerror}); start the studio"
                " in a folder that can be written to"
            ) from None
        with self._lock:
            self._latest.submit(lambda cancelled: self._make(config, folder, cancelled))
            self.state = FinalState("rendering", detail="starting")
        self._changed()

    def cancel(self) -> None:
        """Stop: what is under way is left at its next stage or frame. Frames of a shot that are made stay."""
        with self._lock:
            if not self.busy:
                return
            self._latest.cancel()
            self.state = FinalState("cancelled", detail="The final picture was cancelled.")
        self._changed()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until nothing is being made; whether that came within `seconds`."""
        return self._latest.wait(seconds)

    def close(self) -> None:
        """End the thread at the next stage."""
        self._latest.close()

    def _make(self, config: Config, folder: Path, cancelled: IsCancelled) -> None:
        def say(state: FinalState) -> None:
            # What was cancelled meanwhile says nothing more.
            with self._lock:
                if cancelled():
                    raise Cancelled
                self.state = state
            self._changed()

        def report(stage: str, share: float | None) -> None:
            known = share if stage == "render" and share is not None else 0.0
            say(FinalState("rendering", known, _STAGES.get(stage, stage)))

        try:
            if config.shot is not None and config.focus:
                film(config, folder, progress=report)
            else:
                with staged_folder(folder, owned=FILES) as made:
                    outcome = job.run(config, solving=bool(config.focus), progress=report)
                    report("save", None)
                    save_outcome(made, outcome)
                    report("save", None)
            say(FinalState("rendered", 1.0, f"Report: {folder / 'report.html'}"))
        except Exception:
            if not cancelled():
                raise

    def _failed(self, error: Exception) -> None:
        with self._lock:
            self.state = FinalState("failed", detail=what_failed(error))
        self._changed()
