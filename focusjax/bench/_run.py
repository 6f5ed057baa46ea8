"""All methods on all cases, one after another, and what came of it."""

import dataclasses
import importlib.metadata
import os
import platform
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from focusjax.bench._case import Case
from focusjax.bench._equal import Reach, time_to_reach
from focusjax.bench._makers import best_maker
from focusjax.bench._methods import ChoiceError, Method, Setting
from focusjax.bench._reference import Reference, reference_picture
from focusjax.bench._score import near_silhouettes, score
from focusjax.bench._worker import measured_apart
from focusjax.layers import disparity_map

Progress = Callable[[str, float | None], None]
"""Called with what runs and the share of all that is done."""

ANCHORS = (("mitsuba+oidn", 16), ("mitsuba", 64), ("mitsuba-scalar", 64))
"""Method and setting whose error the others are timed to; the first that was measured."""


@dataclasses.dataclass(frozen=True)
class Row:
    """One setting of one method on one case; seconds are of wall-clock time.

    Attributes:
        scene: name of the case.
        method: name of the method.
        knob: what its setting is.
        setting: its value.
        seconds: median of the calls after the first.
        best_seconds: least of them.
        compile_seconds: by how much the first call was longer than their median.
        setup_seconds: of the method's second set-up on this case.
        setup_compile_seconds: by how much the first set-up was longer.
        peak_mib: most memory that the method's process held up to the end of this setting.
        psnr: dB against the reference.
        ssim: against the reference; None for pictures below 11 pixels.
        silhouette_psnr: dB over the pixels that the blur of a jump in depth reaches; None where none is.
    """

    scene: str
    method: str
    knob: str
    setting: Setting
    seconds: float
    best_seconds: float
    compile_seconds: float
    setup_seconds: float
    setup_compile_seconds: float
    peak_mib: float
    psnr: float
    ssim: float | None
    silhouette_psnr: float | None


@dataclasses.dataclass(frozen=True)
class EqualError:
    """How long a method takes to the error that the anchor has.

    Attributes:
        method: name of the method.
        render: time without set-up.
        total: time with the method's set-up, if it is not the anchor's method.
        ratio: how many times sooner than the anchor, neither with its set-up.
        total_ratio: the same with the method's set-up counted, but not the anchor's.
    """

    method: str
    render: Reach
    total: Reach
    ratio: float
    total_ratio: float


@dataclasses.dataclass(frozen=True, eq=False)
class CaseResults:
    """Everything measured on one case.

    Attributes:
        case: the picture that was to be made.
        reference: the converged picture.
        silhouette_share: of pixels that the blur of a jump in depth reaches.
        rows: one for each setting of each method.
        pictures: by method, the setting that came nearest and its picture [h, w, 3].
        failures: by method, why it could not be measured, or not with all its settings.
    """

    case: Case
    reference: Reference
    silhouette_share: float
    rows: list[Row]
    pictures: dict[str, tuple[Setting, Float[np.ndarray, "h w 3"]]]
    failures: dict[str, str]

    def anchor(self) -> Row | None:
        """The row whose error the others are timed to."""
        for method, setting in ANCHORS:
            for row in self.rows:
                if (row.method, row.setting) == (method, setting):
                    return row
        return None

    def equal_error(self) -> list[EqualError]:
        """Every method at the anchor's error; empty where there is no anchor."""
        anchor = self.anchor()
        if anchor is None:
            return []
        out = []
        for method in dict.fromkeys(row.method for row in self.rows):
            rows = [row for row in self.rows if row.method == method]
            render = time_to_reach([(row.seconds, row.psnr) for row in rows], anchor.psnr)
            setup = 0.0 if method == anchor.method else rows[0].setup_seconds
            total = time_to_reach([(row.seconds + setup, row.psnr) for row in rows], anchor.psnr)
            ratios = (anchor.seconds / reach.seconds for reach in (render, total))
            out.append(EqualError(method, render, total, *ratios))
        return out


@dataclasses.dataclass(frozen=True, eq=False)
class Results:
    """Everything measured.

    Attributes:
        machine: what it was measured on.
        repeats: timed calls after the first.
        methods: those measured.
        cases: one for each scene.
        failures: by the name of a scene that has no reference, why.
    """

    machine: dict[str, str | int | float]
    repeats: int
    methods: tuple[Method, ...]
    cases: list[CaseResults]
    failures: dict[str, str] = dataclasses.field(default_factory=dict)


def speed_error(
    cases: Sequence[Case],
    methods: Sequence[Method],
    *,
    cache: Path,
    maker: str | None = None,
    samples: int = 2048,
    repeats: int = 3,
    progress: Progress | None = None,
) -> Results:
    """Measure every method's time and error over its settings on every case.

    Methods run one at a time, each in a process of its own. What fails, be it a setting, a method or a
    scene's reference, is named in the results and takes nothing else with it.

    Args:
        cases: pictures to make.
        methods: ways to make them.
        cache: folder of kept references.
        maker: who makes the reference, `mitsuba` or `raycast`; the first that is installed if not given.
        samples: of the reference, per pixel.
        repeats: timed calls after the first.
        progress: called with what runs and the share of all that is done.

    Raises:
        ChoiceError: no cases or methods, repeats below 1, or a maker that is unknown or not installed.
        ValueError: no scene has a reference that can be made.
    """
    if not cases or not methods:
        raise ChoiceError("there is nothing to measure; give at least one config and one method")
    if repeats < 1:
        raise ChoiceError(f"repeats is {repeats}; expected at least 1 timed call after the first")
    report: Progress = progress if progress is not None else lambda stage, share: None
    about = machine()
    chosen = maker or best_maker()
    results, failures = [], {}
    for number, case in enumerate(cases):
        steps = len(methods) + 1

        def share(step: int, number: int = number, steps: int = steps) -> float:
            return (number * steps + step) / (len(cases) * steps)

        report(f"{case.title}: reference", share(0))
        try:
            reference = reference_picture(case, maker=chosen, samples=samples, cache=cache)
        except ChoiceError:
            raise
        except (ValueError, OSError, MemoryError) as error:
            failures[case.name] = f"{case.name} has no reference: {error}"
            continue
        band = near_silhouettes(disparity_map(case.scene, case.camera), case.camera, case.lens)
        found = CaseResults(case, reference, float(band.mean()), [], {}, {})
        for step, method in enumerate(methods, start=1):
            report(f"{case.title}: {method.title}", share(step))
            _add(found, method, band, repeats)
        results.append(found)
    if not results:
        raise ValueError("; ".join(failures.values()))
    return Results(about, repeats, tuple(methods), results, failures)


def _add(found: CaseResults, method: Method, band: np.ndarray, repeats: int) -> None:
    """Measure one method and put what comes of it into `found`."""
    try:
        measured, pictures, failure = measured_apart(method, found.case, repeats=repeats)
    except (ValueError, OSError, MemoryError) as error:
        measured, pictures, failure = None, [], str(error)
    rows, shown = [], []
    for timing, picture in zip(measured.timings if measured else (), pictures, strict=True):
        try:
            scored = score(picture, found.reference.picture, band)
        except ValueError as error:
            failure = failure or f"{method.name} with {timing.setting} {method.knob}: {error}"
            continue
        assert measured is not None
        shown.append(picture)
        rows.append(
            Row(
                scene=found.case.name,
                method=method.name,
                knob=method.knob,
                setting=timing.setting,
                seconds=timing.seconds,
                best_seconds=timing.best_seconds,
                compile_seconds=max(0.0, timing.first_seconds - timing.seconds),
                setup_seconds=measured.setup_seconds,
                setup_compile_seconds=max(0.0, measured.setup_first_seconds - measured.setup_seconds),
                peak_mib=timing.peak_mib,
                **dataclasses.asdict(scored),
            )
        )
    if failure is not None:
        found.failures[method.name] = failure
    if rows:
        best = max(range(len(rows)), key=lambda k: rows[k].psnr)
        found.rows.extend(rows)
        found.pictures[method.name] = (rows[best].setting, shown[best])


def machine() -> dict[str, str | int | float]:
    """What this process runs on: processor, device, load and versions."""
    name = platform.processor() or platform.machine()
    for line in _lines(Path("/proc/cpuinfo")):
        if line.startswith("model name"):
            name = line.split(":", 1)[1].strip()
            break
    versions = {}
    for library in ("focusjax", "jax", "mitsuba", "pyoidn", "embreex"):
        try:
            versions[library] = importlib.metadata.version(library)
        except importlib.metadata.PackageNotFoundError:
            versions[library] = "not installed"
    return {
        "processor": name,
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        "load_before": os.getloadavg()[0],
        "device": jax.devices()[0].device_kind,
        "python": platform.python_version(),
        **versions,
    }


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text().splitlines()
    except OSError:
        return []
