"""The converged picture of a case, made once and kept in a file."""

import contextlib
import dataclasses
import math
import os
import tempfile
import time
import zipfile
from pathlib import Path

import numpy as np
from jaxtyping import Float

from focusjax.baselines import without_gaps
from focusjax.bench._case import Case
from focusjax.bench._makers import maker_named
from focusjax.bench._methods import ChoiceError
from focusjax.bench._worker import made_apart
from focusjax.metrics import psnr

_SEEDS = (1000, 500_000)


@dataclasses.dataclass(frozen=True)
class Reference:
    """A converged picture.

    Attributes:
        picture: linear radiance [h, w, 3].
        maker: who made it.
        samples: per pixel.
        dropped: how many samples were left out because they are not finite.
        floor_psnr: dB that it has itself against the truth, from how much its two halves differ; no score
            near it means anything.
        kept: whether it was at hand from an earlier run.
        seconds: that making it took, now or then.
    """

    picture: Float[np.ndarray, "h w 3"]
    maker: str
    samples: int
    dropped: int
    floor_psnr: float
    kept: bool
    seconds: float


def reference_picture(case: Case, *, maker: str, samples: int, cache: Path) -> Reference:
    """The picture of `case` with `samples` samples per pixel, from `cache` if it is there.

    It is the mean of two halves that share no samples. Samples that are not finite are left out and counted.
    The file's name holds a hash of everything that makes the picture; it is written under another name and
    then renamed, so that it is never there in part.

    Args:
        case: the picture to make.
        maker: `mitsuba` or `raycast`.
        samples: per pixel, at least 2.
        cache: folder of kept pictures, made if need be.

    Raises:
        ChoiceError: fewer than two samples, or a maker that is unknown or not installed.
        ValueError: a maker that fails, or a folder that cannot be written.
    """
    if samples < 2:
        raise ChoiceError(f"the reference is to have {samples} samples per pixel; expected at least 2")
    maker_named(maker)
    file = cache / f"{case.name}-{case.digest()}-{maker}-{samples}.npz"
    kept = _read(file, maker, samples)
    if kept is not None:
        return kept
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"the folder {cache} for references cannot be made ({error.strerror}); name another with --cache"
        ) from error
    start = time.perf_counter()
    shares = (samples // 2, samples - samples // 2)
    made = made_apart(maker, case, list(zip(shares, _SEEDS, strict=True)))
    seconds = time.perf_counter() - start
    (first, second), dropped = (half for half, _ in made), sum(count for _, count in made)
    sound = [np.isfinite(half).all(axis=-1, keepdims=True) for half in (first, second)]
    mean = (shares[0] * first + shares[1] * second) / samples
    # A half that has no sample of a pixel leaves it to the other, and to the neighbours where that has none.
    mean = np.where(sound[0] & ~sound[1], first, mean)
    mean = np.where(sound[1] & ~sound[0], second, mean)
    mean = without_gaps(mean)
    # The mean has half the variance of a half, the difference of the halves twice that.
    floor = psnr(without_gaps(first), without_gaps(second)) + 20 * math.log10(2.0)
    _write(file, picture=mean.astype(np.float32), dropped=dropped, floor_psnr=floor, seconds=seconds)
    return Reference(mean, maker, samples, dropped, floor, kept=False, seconds=seconds)


def _read(file: Path, maker: str, samples: int) -> Reference | None:
    # A file that cannot be read is made anew.
    with contextlib.suppress(OSError, ValueError, KeyError, zipfile.BadZipFile), np.load(file) as kept:
        return Reference(
            kept["picture"].astype(np.float64),
            maker,
            samples,
            int(kept["dropped"]),
            float(kept["floor_psnr"]),
            kept=True,
            seconds=float(kept["seconds"]),
        )
    return None


def _write(file: Path, *, picture: np.ndarray, dropped: int, floor_psnr: float, seconds: float) -> None:
    try:
        handle, name = tempfile.mkstemp(prefix=".unfinished-", suffix=".npz", dir=file.parent)
    except OSError as error:
        raise ValueError(
            f"the folder {file.parent} for references is not writable ({error.strerror}); name another with"
            " --cache"
        ) from error
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez_compressed(
                stream, picture=picture, dropped=dropped, floor_psnr=floor_psnr, seconds=seconds
            )
        os.replace(name, file)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
