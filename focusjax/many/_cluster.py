"""Workers of Dask: this machine's own, or those of a cluster that is there, looked over before work."""

import logging
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask.config
import distributed
from distributed.diagnostics.plugin import WorkerPlugin

from focusjax.many._carry_out import Workers
from focusjax.many._task import ManyError
from focusjax.many._worker import ENVIRONMENT, Settings, versions, write_probe

_SPAWNED = "distributed.nanny.pre-spawn-environ"
_RETURNED = "MALLOC_TRIM_THRESHOLD_"
"""By it Dask has processes return memory at every chance: a solve then takes half as long again."""
_PATIENCE = "5s"
"""For a scheduler to answer."""
_CHECKED = ("focusjax", "jax", "jaxlib", "Python")


class _SetUp(WorkerPlugin):
    """Sets up every worker that is there or joins later."""

    name = "focusjax"

    def __init__(self, settings: Settings):
        self._settings = settings

    def setup(self, worker: Any) -> None:
        self._settings.apply(worker.name if isinstance(worker.name, int) else 0)


@contextmanager
def connected(workers: Workers, tasks: int, folder: Path) -> Iterator[distributed.Client]:
    """A client whose workers are ready for tasks.

    Args:
        workers: processes of this machine, an address, a scheduler file or a client.
        tasks: how many there will be; no more processes are started.
        folder: that all workers have to see.

    Raises:
        ManyError: a scheduler that is not there or has no workers, workers with other versions than this
            process, or that do not see the folder.
    """
    if isinstance(workers, distributed.Client):
        _prepare(workers, folder, local=False)
        yield workers
    elif isinstance(workers, int):
        with _local_cluster(min(workers, tasks)) as cluster, distributed.Client(cluster) as client:
            client.register_plugin(_SetUp(Settings.here(local=True)))
            yield client
    else:
        with _client_of(str(workers)) as client:
            _prepare(client, folder, local=False)
            yield client


@contextmanager
def _local_cluster(count: int) -> Iterator[distributed.LocalCluster]:
    # What ends in the middle of its work is told by us.
    silent = {"silence_logs": logging.CRITICAL + 1, "dashboard_address": None}
    spawned = {name: value for name, value in dask.config.get(_SPAWNED).items() if name != _RETURNED}
    try:
        with dask.config.set({_SPAWNED: spawned}):
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                memory_limit=0,
                env=ENVIRONMENT,
                **silent,
            )
    except (RuntimeError, OSError, TimeoutError) as error:
        raise ManyError(
            f"processes for the work could not be started ({' '.join(str(error).split())}); a script that"
            ' does so has to do it under `if __name__ == "__main__":`'
        ) from None
    with cluster:
        yield cluster


def _client_of(place: str) -> distributed.Client:
    file = Path(place)
    where: dict[str, Any] = {"scheduler_file": place} if "://" not in place else {"address": place}
    if "://" not in place and not file.is_file():
        raise ManyError(
            f"--scheduler {place}: expected the address of a scheduler, such as tcp://127.0.0.1:8786, or its"
            " scheduler file; there is no such file"
        )
    try:
        return distributed.Client(**where, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ManyError(
            f"there is no scheduler at {place} ({' '.join(str(error).split())[:200]}); start one with"
            " `dask scheduler`, or check the address"
        ) from None


def _prepare(client: distributed.Client, folder: Path, *, local: bool) -> None:
    """Look at the workers that are there, and set them up.

    Raises:
        ManyError: see `connected`.
    """
    if not client.nthreads():
        raise ManyError(
            f"the scheduler at {address_of(client)} has no workers; start some with"
            f" `dask worker {address_of(client)} --nthreads 1`"
        )
    _check_versions(client)
    _check_folder(client, folder)
    client.register_plugin(_SetUp(Settings.here(local=local)))


def _check_versions(client: distributed.Client) -> None:
    """Refuse workers whose results would not be those of this process."""
    ours = versions()
    answers: Any = client.run(versions, on_error="return")
    for address, theirs in answers.items():
        if isinstance(theirs, Exception):
            raise ManyError(
                f"the worker at {address} cannot use focusjax ({type(theirs).__name__}: {theirs}); install"
                f" focusjax {ours['focusjax']} there"
            )
        for name in _CHECKED:
            if theirs[name] != ours[name]:
                raise ManyError(
                    f"the worker at {address} has {name} {theirs[name]}, and this process {ours[name]};"
                    " install the same there, so that all results are alike"
                )


def _check_folder(client: distributed.Client, folder: Path) -> None:
    """Refuse workers that do not see the folder: each writes a file, which is read back here."""
    token = uuid.uuid4().hex[:12]
    answers: Any = client.run(write_probe, folder, token, on_error="return")
    found = list(folder.glob(f".probe-{token}-*"))
    for path in found:
        path.unlink(missing_ok=True)
    for address, answer in answers.items():
        if answer:
            raise ManyError(
                f"the worker at {address} cannot write to {folder} ({answer}); choose a folder with --out"
                " that this machine and all workers see"
            )
    if len(found) < len(answers):
        raise ManyError(
            f"what {len(answers)} workers wrote to {folder} is seen here {len(found)} times; choose a folder"
            " with --out that this machine and all workers share"
        )


def address_of(client: distributed.Client) -> str:
    """The address of a client's scheduler."""
    scheduler: Any = client.scheduler
    return "?" if scheduler is None else scheduler.addr
