"""Edits by chance, as a person makes them on the studio's page."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from focusjax.config import ConfigError, load_config
from focusjax.studio import EditError, Session
from focusjax.studio._surface_edits import KERNELS
from focusjax.studio._wishes import KINDS as WISHES


def edit(path: str, seed: str) -> int:
    """Up to eight edits of a config, each solved or refused; then it is saved, and says the same when read.

    Returns:
        the exit status that a command would have: 0, or 2 if every edit was refused.
    """
    rng = np.random.default_rng(int(seed))
    session = Session(path)
    taken = 0
    for _ in range(rng.integers(1, 9)):
        try:
            _one_edit(session, rng)
            answer = session.solve()
        except (EditError, ConfigError):
            continue
        taken += 1
        if answer.outcome is not None and not np.isfinite(np.asarray(answer.outcome.blur)).all():
            raise ArithmeticError("the blur of an answer is not finite")
        answer.with_sentences()
    session.document.save()
    if session.document.config is not None and load_config(Path(path)) != session.config:
        raise AssertionError("what was saved is not what was edited")
    return 0 if taken else 2


def _one_edit(session: Session, rng: np.random.Generator) -> None:
    """A click, a drag, a number typed, or a step back."""
    number = int(rng.integers(max(1, len(session.config.focus))))
    at = rng.uniform(-2, 18), rng.uniform(-2, 14)
    setting = str(rng.choice(["focus", "f_number", "tilt", "swing"]))
    typed = float(rng.choice([0, 1, 2, -1, 1e-6, 1e6, 1e39, math.nan, math.inf, rng.normal(0, 10)]))
    acts: tuple[Callable[[], object], ...] = (
        lambda: session.add_point(*at),
        lambda: session.move_point(number, *at, drag="d"),
        lambda: session.delete_point(number),
        lambda: session.wish_for(
            number,
            str(rng.choice(sorted(WISHES))),
            pixels=typed,
            other=str(rng.choice(["front", "far", ""])),
        ),
        lambda: session.rename(number, str(rng.choice(["", "front", "far", "[/b]", "a" * 400]))),
        lambda: session.set_weight(number, typed),
        lambda: session.set_tolerance(number, typed),
        lambda: session.switch(number, on=bool(rng.integers(2))),
        lambda: session.spread(number, whole=bool(rng.integers(2))),
        lambda: session.free(setting),
        lambda: session.fix(setting, None if rng.random() < 0.5 else typed),
        lambda: session.limit(setting, str(rng.choice(["low", "high"])), typed),
        lambda: session.use_surface(),
        lambda: session.use_plane(),
        lambda: session.add_control(*at),
        lambda: session.move_control(number, *at, drag="d"),
        lambda: session.set_control(
            number, str(rng.choice(["name", "blur_px", "aperture_scale", "weight"])), typed
        ),
        lambda: session.delete_control(number),
        lambda: session.set_surface(str(rng.choice(["basis", "smoothness"])), typed),
        lambda: session.set_kernel(str(rng.choice(sorted(KERNELS))), exponent=typed, size=typed),
        lambda: session.undo(),
        lambda: session.redo(),
    )
    if session.config.focus or rng.random() < 0.5:
        acts[rng.integers(len(acts))]()
    else:
        acts[0]()
