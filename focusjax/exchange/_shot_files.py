"""Formats that hold one frame: a numbered file for each frame of a shot."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

from focusjax.exchange._record import Record


def each_frame(record: Record, path: Path, write: Callable[[Record, Path], object]) -> tuple[Path, ...]:
    """Write `path`, or `name.0001.ending` and so on for the frames of a shot.

    Args:
        record: the camera.
        path: of the file of a single frame.
        write: writes a record of one frame to a file.
    """
    if not record.is_shot:
        write(record, path)
        return (path,)
    files = []
    for index, frame in enumerate(record.frames):
        files.append(path.with_name(f"{path.stem}.{index + 1:04d}{path.suffix}"))
        one = dataclasses.replace(
            record, frames=(frame,), lenses=(record.lenses[index],), cameras=(record.cameras[index],)
        )
        write(one, files[-1])
    return tuple(files)
