"""A session with its pictures: edits at once, numbers in one thread, pictures in another."""

import contextlib
import dataclasses
import functools
import threading
import time
from collections.abc import Callable
from pathlib import Path

from focusjax._console import sentence
from focusjax.config import Config
from focusjax.exchange import export_config, target_named
from focusjax.studio._answer import Answer, answer
from focusjax.studio._final import Final
from focusjax.studio._kept_pictures import keep_picture, kept_picture
from focusjax.studio._latest import Cancelled as IsCancelled
from focusjax.studio._latest import Latest, what_failed
from focusjax.studio._overlays import blur_overlay, depth_overlay, jpeg, layers_overlay, shown_size, webp
from focusjax.studio._painter import Cancelled, Painter
from focusjax.studio._reel import Reel
from focusjax.studio._session import Session
from focusjax.studio._warm_up import OTHERS

_FIRST_NUMBERS_S = 0.04
"""Seconds that the page has to show marker and numbers, before a draft takes all of the processor."""
_AFTER_DRAFT_S = 0.3
"""Seconds before it is worked out what stands in the way, so that the draft is not held up."""
_STILL_S = 0.7
"""Seconds for which a frame is looked at before its picture is refined."""
_IDLE_S = 8.0
"""Seconds without a change after which programs are compiled that may be asked for next."""
KINDS = ("picture", "sharp", "blur", "depth", "layers")
"""Pictures that the studio has."""


@dataclasses.dataclass(frozen=True)
class Shown:
    """A picture as bytes for a browser.

    Attributes:
        number: of the picture; every picture of a studio has its own.
        answer: number of the answer that it shows.
        media: its media type.
        make: makes its bytes.
    """

    number: int
    answer: int
    media: str
    make: Callable[[], bytes]

    @functools.cached_property
    def data(self) -> bytes:
        """Its bytes, made when they are first asked for."""
        return self.make()


@dataclasses.dataclass(frozen=True)
class State:
    """What the picture is at the moment.

    Attributes:
        word: "starting", "solving", "solving the shot", "draft", "refining", "refined", "no lens" or
            "problem".
        share: how far refining is, 0 to 1.
        detail: a sentence, of a problem.
    """

    word: str
    share: float = 0.0
    detail: str = ""


class Studio:
    """What the page shows.

    Attributes:
        session: the config; change it by `apply`.
        answer: the latest that is worked out.
        state: what the picture is.
        shown: the latest picture of each kind.
        version: rises with every change of these, for pages that look at it.
        drafts: how many drafts were made.
        frame: of the shot, counted from 1; 0 for a still.
        reel: the solved shot; None for a still, or before it is solved.
        final: makes the final picture.
        warning: why changes cannot be kept before they are saved; empty where they can.
    """

    def __init__(self, session: Session, *, pictures: Path | None = None):
        """Start working on the config as it is.

        Args:
            session: the config.
            pictures: keeps the last picture of a scene, to be shown first the next time; None keeps none.
        """
        self.session = session
        self.answer: Answer | None = None
        self.state = State("starting")
        self.shown: dict[str, Shown] = {}
        self.version = 0
        self.drafts = 0
        self.warning = ""
        self.frame = 0
        self.reel: Reel | None = None
        self._drafts: tuple[Reel | None, dict[int, bytes]] = (None, {})
        self.painter = Painter()
        self.final = Final(self._final_changed)
        self._lock = threading.Lock()
        self._pictures = 0
        self._numbers = Latest("focusjax numbers", self._failed)
        self._painting = Latest("focusjax pictures", self._failed)
        self._keeping = Latest("focusjax unsaved", self._unkept)
        self._closed = False
        self._kept_in = pictures
        self._sharp_of: object = None
        self._layers_of = 0
        self._show_last()
        self.refresh()

    def apply(self, edit: Callable[[Session], object]) -> object:
        """Change the session and work the change out; what `edit` returns.

        Raises:
            EditError: there would be no usable config; nothing is changed.
        """
        before = self.session.number
        result = edit(self.session)
        if self.session.number != before:
            self._keeping.submit(lambda cancelled: self.session.document.keep())
            self.refresh()
        return result

    def refresh(self) -> None:
        """Work out the config as it is."""
        config = self.session.document.config
        if config is None:
            # First what would paint its answer.
            self._numbers.cancel()
            self._painting.cancel()
            self._set(state=State("problem", detail=self.session.document.problem))
            return
        self._painting.cancel()
        shot = config.shot if config.focus else None
        self.frame = 0 if shot is None else min(max(self.frame, 1), shot.frames)
        self._set(state=State("solving" if self.answer else "starting"))
        solve = self._solve if shot is None else self._solve_shot
        self._numbers.submit(functools.partial(solve, config, self.session.number))

    def show_frame(self, frame: int) -> None:
        """Show a frame of the shot, which is moved into its range; a draft first, and more when it stays."""
        reel = self.reel
        if reel is None:
            return
        self.frame = min(max(frame, 1), reel.count)
        self._painting.cancel()
        if reel.number == self.session.number:
            self._numbers.submit(functools.partial(self._show_frame, reel))

    def warm_up(self) -> None:
        """Compile, in a thread of its own, what other wishes and a tilt need, so that the first is quick."""
        threading.Thread(target=self._warm_up, name="focusjax warm-up", daemon=True).start()

    def render(self, folder: Path) -> None:
        """Make the picture at full quality with its report, as `focusjax run` does, into `folder`.

        Raises:
            EditError: there is no usable config, or the folder cannot be written to.
        """
        self.final.start(self.session.config, folder)
        self._paint_again()

    def export(self, to: str, folder: Path) -> tuple[str, ...]:
        """Write the camera for another program into `folder`, as `focusjax export` does; what it says.

        Raises:
            ValueError: as `export_config`.
        """
        config = self.session.config
        file = folder / f"{self.session.document.path.stem}{target_named(to).suffix}"
        has_shot = config.shot is not None and bool(config.focus)
        return export_config(config, file, to=to, shot=has_shot, approximate=True).sentences

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until numbers and pictures are done; whether that came within `seconds` each."""
        return all(each.wait(seconds) for each in (self.final, self._numbers, self._painting))

    def close(self) -> None:
        """End the threads; what is not saved is kept."""
        self._closed = True
        self._keeping.wait()
        self._keeping.close()
        self.final.close()
        self._numbers.close()
        self._painting.close()

    def _solve(self, config: Config, number: int, cancelled: IsCancelled) -> None:
        answer = self.session.solve(config, number)
        self.reel = None
        self._take(answer)
        if not self._numbers.overtaken(cancelled, _AFTER_DRAFT_S):
            explained = answer.with_sentences()
            if not cancelled():
                self._set(answer=explained)

    def _solve_shot(self, config: Config, number: int, cancelled: IsCancelled) -> None:
        def report(stage: str, share: float | None) -> None:
            if cancelled():
                raise Cancelled
            self._set(state=State("solving the shot", share or 0.0))

        if self.answer is None or self.answer.config.scene != config.scene:
            self._take(self.session.before_shot(config, self.frame, number))
        try:
            reel = self.session.solve_shot(config, number, report)
        except Cancelled:
            return
        except (ValueError, RuntimeError) as error:
            unsolved = self.session.before_shot(config, self.frame, number, sentence(error))
            self.reel = None
            self._take(unsolved)
            return
        self.reel = reel
        self._show_frame(reel, cancelled)
        if not cancelled():
            sentences = reel.sentences()
            if not cancelled() and self.answer is not None:
                self._set(answer=dataclasses.replace(self.answer, sentences=sentences))

    def _show_frame(self, reel: Reel, cancelled: IsCancelled) -> None:
        answer = self.session.frame_of(reel, self.frame)
        if not cancelled():
            self._take(answer, self._drafts[1].get(answer.frame) if self._drafts[0] is reel else None)

    def _take(self, answer: Answer, draft: bytes | None = None) -> None:
        """Show a new answer with its blur, and a draft that is there already; then have it painted."""
        self._set(answer=answer)
        outcome, sharp = answer.outcome, answer.depth_of_field()
        if outcome is not None and sharp is not None:
            size = shown_size(answer.config.camera.resolution)
            self._show("blur", answer, lambda: webp(blur_overlay(outcome.blur, sharp.circle_px), size))
        if draft is not None:
            self._show("picture", answer, lambda: draft)
            self._set(state=State("draft"))
        self._painting.submit(functools.partial(self._paint, answer))

    def _warm_up(self) -> None:
        self._numbers.wait()
        for number, change in enumerate(OTHERS):
            if number:
                # What is asked for less often waits for a time when nothing else is to be done.
                self._wait_until_still(_IDLE_S)
            now = self.answer
            if self._closed or now is None or now.frame:
                return
            config = change(now.config)
            if config is not None:
                answer(config, now.stage)

    def _wait_until_still(self, seconds: float) -> None:
        """Wait until nothing has changed for so long, or all is closed."""
        version, since = self.version, time.monotonic()
        while not self._closed and time.monotonic() - since < seconds:
            time.sleep(0.2)
            working = self.final.busy or self.state.word not in ("refined", "no lens", "problem")
            if working or self.version != version:
                version, since = self.version, time.monotonic()

    def _paint(self, answer: Answer, cancelled: IsCancelled) -> None:
        size = shown_size(answer.config.camera.resolution)
        if self._painting.overtaken(cancelled, _FIRST_NUMBERS_S):
            return
        reel, drafts = self._drafts
        if answer.frame and reel is not self.reel:
            self._drafts = reel, drafts = self.reel, {}
        if not (answer.frame in drafts and answer.outcome is not None):
            data = jpeg(self.painter.draft(answer).pixels, size)
            self.drafts += 1
            self._show("picture", answer, lambda: data)
            if answer.frame and answer.outcome is not None:
                drafts[answer.frame] = data
        if answer.outcome is None:
            if answer.problem and not cancelled():
                self._set(state=State("no lens", detail=answer.problem))
            self._extras(answer, size)
            return
        if cancelled():
            return
        self._set(state=State("draft"))
        if answer.frame and self._painting.overtaken(cancelled, _STILL_S):
            # The next frame is looked at.
            return
        self._extras(answer, size)
        if self.final.busy:
            # It has the processor; what is looked at is refined after it.
            return
        try:
            for painted in self.painter.refined(answer, cancelled):
                if cancelled():
                    return
                self._lay_layers(answer, size)
                data = jpeg(painted.pixels, size)
                self._show("picture", answer, lambda data=data: data)
                done = painted.share >= 1.0
                if done and answer.frame <= 1:
                    self._keep_last(answer.config, data)
                self._set(state=State("refined" if done else "refining", painted.share))
        except Cancelled:
            return

    def _show_last(self) -> None:
        """What the scene looked like the last time, until there is something newer."""
        config = self.session.document.config
        if self._kept_in is None or config is None:
            return
        last = kept_picture(self._kept_in, config, "picture")
        if last is not None:
            self._pictures += 1
            self.shown = {"picture": Shown(self._pictures, 0, "image/jpeg", lambda: last)}

    def _keep_last(self, config: Config, data: bytes) -> None:
        if self._kept_in is not None:
            # Without it the next start shows nothing for a few seconds more.
            with contextlib.suppress(OSError):
                keep_picture(self._kept_in, config, "picture", data)

    def _lay_layers(self, answer: Answer, size: tuple[int, int]) -> None:
        """The number of layers, once for each time that they are peeled."""
        if self._layers_of != self.painter.peels:
            self._layers_of = self.painter.peels
            counts = self.painter.layer_counts()
            if counts is not None:
                self._show("layers", answer, lambda: webp(layers_overlay(counts), size))

    def _extras(self, answer: Answer, size: tuple[int, int]) -> None:
        """The sharp view and depth, once for each stage."""
        if self._sharp_of is not answer.stage:
            sharp = jpeg(self.painter.sharp(answer), size)
            self._show("sharp", answer, lambda: sharp)
            self._show("depth", answer, lambda: webp(depth_overlay(answer.stage.disparity), size))
            self._sharp_of = answer.stage

    def _final_changed(self) -> None:
        with self._lock:
            self.version += 1
        if not self.final.busy:
            self._paint_again()

    def _paint_again(self) -> None:
        """Go on with the picture of the latest answer, unless a newer one is on its way."""

        def paint(cancelled: IsCancelled) -> None:
            answer, config = self.answer, self.session.document.config
            if answer is not None and config is not None and answer.number == self.session.number:
                self._paint(answer, cancelled)

        self._painting.submit(paint)

    def _show(self, kind: str, answer: Answer, make: Callable[[], bytes]) -> None:
        media = "image/jpeg" if kind in ("picture", "sharp") else "image/webp"
        with self._lock:
            self._pictures += 1
            self.shown = {**self.shown, kind: Shown(self._pictures, answer.number, media, make)}
            self.version += 1

    def _set(self, *, answer: Answer | None = None, state: State | None = None) -> None:
        with self._lock:
            self.answer = self.answer if answer is None else answer
            self.state = self.state if state is None else state
            self.version += 1

    def _unkept(self, error: Exception) -> None:
        """Say once that changes cannot be kept."""
        with self._lock:
            self.warning = self.warning or str(error)
            self.version += 1

    def _failed(self, error: Exception) -> None:
        self._set(state=State("problem", detail=what_failed(error)))
