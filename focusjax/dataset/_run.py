"""A data set from its spec to its manifest."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from focusjax.config import ConfigError
from focusjax.dataset._folder import (
    dataset_folder,
    layers_file,
    numbers_in,
    picture_file,
    save_arrays,
    write_manifest,
)
from focusjax.dataset._picture import make_picture
from focusjax.dataset._spec import Spec
from focusjax.layers import save_layers
from focusjax.many import Journal, Task, Workers, carry_out, check_workers, sentence

GROUP = 16
"""Pictures to a task: some ten seconds of work."""
_MOST = 1_000_000
"""Pictures, whose numbers have six digits."""


@dataclass(frozen=True)
class DatasetResults:
    """What came of a data set.

    Attributes:
        folder: where it is.
        there: pictures in the manifest.
        kept: of them, those that were there before.
        failed: sentences on groups of pictures that failed.
    """

    folder: Path
    there: int
    kept: int
    failed: tuple[str, ...]


def make_dataset(
    spec: Spec,
    count: int,
    folder: Path | str,
    *,
    workers: Workers = 1,
    resume: bool = False,
    on_done: Callable[[int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> DatasetResults:
    """Make pictures 0 to `count` - 1 of a spec, each in a file, and the manifest.

    Picture k depends on the spec and on k alone, bit for bit, whoever makes it and whatever the count. Its
    file appears whole or not at all; one that is there is never made again.

    Args:
        spec: from `load_spec` or `spec_of`.
        count: of pictures.
        folder: made if need be.
        workers: who makes them; see `focusjax.many.carry_out`.
        resume: go on with what is in the folder, which has to be of the same spec.
        on_done: called with a number of pictures that are done; first those that were there.
        on_note: called with a sentence on what a user should know.

    Raises:
        ConfigError: a count that is out of range, or a folder that cannot be used; nothing was started.
        ManyError: workers that cannot be used, or are lost.

    Example:
        >>> make_dataset(spec_of({}), 1000, "pictures", workers=2).there  # doctest: +SKIP
        1000
    """
    folder = Path(folder)
    if not 1 <= count <= _MOST:
        raise ConfigError(f"count is {count}; expected the number of pictures, from 1 to {_MOST}")
    check_workers(workers, folder)
    report = on_done or (lambda count: None)
    failed: list[str] = []
    with dataset_folder(folder, spec, resume=resume):
        there = {number for number in numbers_in(folder) if number < count}
        report(len(there))
        missing = [number for number in range(count) if number not in there]
        groups = (tuple(missing[k : k + GROUP]) for k in range(0, len(missing), GROUP))
        tasks = [Task(f"{group[0]:06}-{group[-1]:06}", group) for group in groups]
        work = MakePictures(spec, folder.absolute())
        try:
            with closing(carry_out(work, tasks, folder, workers=workers, on_note=on_note)) as ended:
                for each in ended:
                    if each.error:
                        failed.append(each.error)
                    report(len(each.task.argument))
        finally:
            total = write_manifest(folder)
    return DatasetResults(folder, total, len(there), tuple(failed))


@dataclass(frozen=True)
class MakePictures:
    """Makes pictures by their numbers, those alone that are not there yet."""

    spec: Spec
    folder: Path

    def __call__(self, task: Task, journal: Journal) -> None:
        """Make the pictures of a task; one that fails stops no other.

        Raises:
            RuntimeError: some failed.
        """
        files, failed = self.spec.mesh_files, []
        for number in task.argument:
            path = self.folder / picture_file(number)
            if path.exists():
                continue
            try:
                path.parent.mkdir(exist_ok=True)
                made = make_picture(self.spec, number, files)
                if self.spec.layers:
                    save_layers(self.folder / layers_file(number), made.layers)
                save_arrays(path, made.arrays)
            except Exception as error:
                failed.append(f"picture {number}: {sentence(error)}")
        if failed:
            more = f" (and {len(failed) - 1} more of its group)" if len(failed) > 1 else ""
            raise RuntimeError(failed[0] + more)
