"""Workers of Dask: this machine's own, or those of a cluster that is there, looked over before work."""

import json
import logging
import uuid
from collections.abc import Callable, Collection, Iterator
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
_PROFILE = "distributed.worker.profile.enabled"
"""By it Dask looks a hundred times a second at what each process is at."""
_PATIENCE = "5s"
"""For a scheduler to answer."""
_WORKERS_PATIENCE = 30.0
"""Seconds for the workers to answer."""
_PROTOCOLS = ("tcp", "tls", "ws", "wss", "ucx", "inproc")
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
        _prepare(workers, folder)
        yield workers
    elif isinstance(workers, int):
        with _local_cluster(min(workers, tasks)) as cluster, distributed.Client(cluster) as client:
            client.register_plugin(_SetUp(Settings.here(local=True)))
            yield client
    else:
        with _client_of(str(workers)) as client:
            _prepare(client, folder)
            yield client


@contextmanager
def _local_cluster(count: int) -> Iterator[distributed.LocalCluster]:
    # We report a process that ends in the middle of its work, so that Dask need not.
    silent = {"silence_logs": logging.CRITICAL + 1, "scheduler_kwargs": {"dashboard": False}}
    spawned = {name: value for name, value in dask.config.get(_SPAWNED).items() if name != _RETURNED}
    try:
        with dask.config.set({_SPAWNED: spawned, _PROFILE: False}):
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                memory_limit=0,
                # The usual port may be another run's.
                dashboard_address="127.0.0.1:0",
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
    address = place if "://" in place else _address_in(Path(place))
    protocol = address.partition("://")[0]
    if protocol not in _PROTOCOLS:
        raise ManyError(
            f"--scheduler {place} has the protocol {protocol!r}; expected an address such as"
            f" tcp://127.0.0.1:8786, with one of {', '.join(_PROTOCOLS)}"
        )
    try:
        return distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ManyError(
            f"there is no scheduler at {place} ({' '.join(str(error).split())[:200]}); start one with"
            " `dask scheduler`, or check the address"
        ) from None


def _address_in(file: Path) -> str:
    """The address that a scheduler file has.

    Raises:
        ManyError: there is no such file, or it is no scheduler file.
    """
    expected = "expected the address of a scheduler, such as tcp://127.0.0.1:8786, or its scheduler file"
    try:
        return str(json.loads(file.read_text(encoding="utf-8"))["address"])
    except OSError as error:
        raise ManyError(f"--scheduler {file}: {expected}; {error.strerror}") from None
    except (ValueError, KeyError, TypeError):
        raise ManyError(f"--scheduler {file}: {expected}; the file has no address") from None


def _prepare(client: distributed.Client, folder: Path) -> None:
    """Look at the workers that are there, and set them up.

    Raises:
        ManyError: see `connected`.
    """
    if not client.nthreads():
        raise ManyError(
            f"the scheduler at {address_of(client)} has no workers; start some with"
            f" `dask worker {address_of(client)} --nthreads 1`"
        )
    for complaint in complaints(client, folder).values():
        raise ManyError(complaint)
    client.register_plugin(_SetUp(Settings.here(local=False)))


def complaints(
    client: distributed.Client, folder: Path, addresses: Collection[str] | None = None
) -> dict[str, str]:
    """Why workers cannot be used, by their addresses; those that can be are not in it.

    Args:
        client: of their scheduler.
        folder: that they have to see.
        addresses: of the workers to look at; all when None.

    Raises:
        ManyError: they do not answer.
    """
    found: dict[str, str] = {}
    ours = versions()
    for address, theirs in _answers(client, versions, addresses).items():
        if isinstance(theirs, Exception):
            found[address] = (
                f"the worker at {address} cannot use focusjax ({type(theirs).__name__}: {theirs}); install"
                f" focusjax {ours['focusjax']} there"
            )
            continue
        for name in _CHECKED:
            if theirs[name] != ours[name]:
                found[address] = (
                    f"the worker at {address} has {name} {theirs[name]}, and this process {ours[name]};"
                    " install the same there, so that all results are alike"
                )
                break
    return found or _unseen(client, folder, addresses)


def _unseen(client: distributed.Client, folder: Path, addresses: Collection[str] | None) -> dict[str, str]:
    """Complaints on workers that do not see the folder: each writes a file, which is read back here."""
    found, token = {}, uuid.uuid4().hex[:12]
    remedy = "choose a folder with --out that this machine and all workers see"
    for address, answer in _answers(client, write_probe, addresses, folder, token).items():
        if isinstance(answer, Exception):
            found[address] = f"the worker at {address} cannot write to {folder} ({answer}); {remedy}"
        elif not (folder / answer).exists():
            found[address] = f"what the worker at {address} wrote to {folder} is not seen here; {remedy}"
    for path in folder.glob(f".probe-{token}-*"):
        path.unlink(missing_ok=True)
    return found


def _answers(
    client: distributed.Client, function: Callable[..., Any], addresses: Collection[str] | None, *args: Any
) -> dict[str, Any]:
    """What workers return from a function, or raise, by their addresses.

    Raises:
        ManyError: some do not answer.
    """
    workers = None if addresses is None else list(addresses)
    try:
        # `Client.run` itself waits for ever.
        answers: Any = client.sync(
            client._run,
            function,
            *args,
            workers=workers,
            on_error="return",
            callback_timeout=_WORKERS_PATIENCE,
        )
        return answers
    except TimeoutError:
        raise ManyError(
            f"workers of the scheduler at {address_of(client)} do not answer within {_WORKERS_PATIENCE:.0f}"
            " seconds; end those that hang"
        ) from None


def address_of(client: distributed.Client) -> str:
    """The address of a client's scheduler."""
    scheduler: Any = client.scheduler
    return "?" if scheduler is None else scheduler.addr
