"""Reading a data set."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np

from focusjax.dataset._folder import MANIFEST


class Dataset(Sequence[dict[str, np.ndarray]]):
    """The pictures of a folder, each read when it is asked for.

    Each is a dictionary of arrays: `defocused` and `sharp` [h, w, 3], linear light; `depth_m` [h, w], metres
    along the view axis; `coc_px` [h, w], signed diameter of the circle of confusion in pixels, positive
    behind the plane in focus; and the numbers `focus_distance_m`, `f_number`, `focal_length_m`,
    `sensor_width_m`, `seed` and `number`. Pictures are float32 here, and float16 in their files.

    Attributes:
        folder: where it is.
        lines: of the manifest, a dictionary for each picture.
    """

    def __init__(self, folder: Path, lines: list[dict[str, Any]]):
        self.folder = folder
        self.lines = lines

    def __len__(self) -> int:
        return len(self.lines)

    def __repr__(self) -> str:
        return f"Dataset({len(self)} pictures in {self.folder})"

    @overload
    def __getitem__(self, index: int) -> dict[str, np.ndarray]: ...
    @overload
    def __getitem__(self, index: slice) -> "Dataset": ...
    def __getitem__(self, index: int | slice) -> "dict[str, np.ndarray] | Dataset":
        if isinstance(index, slice):
            return Dataset(self.folder, self.lines[index])
        with np.load(self.folder / self.lines[index]["file"]) as stored:
            found = {name: stored[name] for name in stored.files}
        return found | {name: found[name].astype(np.float32) for name in ("defocused", "sharp")}

    def __iter__(self) -> Iterator[dict[str, np.ndarray]]:
        return (self[number] for number in range(len(self)))


def load_dataset(folder: Path | str) -> Dataset:
    """The data set that `focusjax dataset` left in a folder.

    Raises:
        ValueError: there is no manifest, or a broken one.

    Example:
        >>> for picture in load_dataset("pictures"):  # doctest: +SKIP
        ...     blurred, truth = picture["defocused"], picture["coc_px"]
    """
    folder = Path(folder)
    try:
        text = (folder / MANIFEST).read_text(encoding="utf-8")
        return Dataset(folder, [json.loads(line) for line in text.splitlines()])
    except OSError:
        raise ValueError(
            f"{folder} holds no {MANIFEST}; expected a folder that `focusjax dataset` made"
        ) from None
    except ValueError:
        raise ValueError(
            f"{folder / MANIFEST} is broken; `focusjax dataset --resume` writes it anew"
        ) from None
