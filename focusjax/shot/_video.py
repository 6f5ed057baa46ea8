"""Pictures as a film, by ffmpeg, which comes with imageio's extra package."""

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import imageio.v2
import imageio.v3 as iio
import numpy as np


def check_video() -> None:
    """Refuse where there is no ffmpeg to write a film with.

    Raises:
        ValueError: says what to install.
    """
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        raise ValueError(
            "an mp4 needs the package imageio-ffmpeg, which is not installed; run"
            " `pip install 'focusjax[video]'`, or leave mp4 out of the formats"
        )


def save_mp4(path: Path, pictures: Sequence[Path], fps: float) -> None:
    """Write picture files of one size as an H.264 film that every player shows.

    Players want even sides: an odd last column or row is repeated.

    Args:
        path: file to write.
        pictures: 8-bit pictures, in order.
        fps: frames per second.

    Raises:
        ValueError: as `check_video`.
    """
    check_video()
    options = {"fps": fps, "codec": "libx264", "quality": 8, "macro_block_size": 2}
    writer: Any = imageio.v2.get_writer(path, format="FFMPEG", mode="I", **options)  # type: ignore[arg-type]
    with writer:
        for picture in pictures:
            frame = np.asarray(iio.imread(picture))
            if frame.dtype == np.uint16:
                frame = (frame >> 8).astype(np.uint8)
            odd = [(0, side % 2) for side in frame.shape[:2]]
            writer.append_data(np.pad(frame, [*odd, (0, 0)], mode="edge"))
