"""Blocks of a picture on several devices, and in several processes.

Every device has copies of what all blocks read, and takes the next block when it is done with one: blocks
cost unequally, and nothing waits as it would in one program that is sharded over all devices. Processes take
every n-th block each, and add up what they have at the end, which is all that they say to one another.
"""

import concurrent.futures
import queue
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import numpy as np
from jax.experimental import multihost_utils
from jaxtyping import Float
from scipy.sparse import csr_array, vstack

from focusjax._parallel import CORES, parts

S = TypeVar("S")
R = TypeVar("R")

_ROWS_AT_ONCE = 1 << 16


@runtime_checkable
class Device(Protocol):
    """What matters here of a JAX device, as `jax.devices()` lists them."""

    process_index: int
    platform: str


class Workforce:
    """Devices that share the blocks of a picture, those of this process among them."""

    def __init__(self, devices: Sequence[Device] | None = None) -> None:
        """The workforce of `devices`; see `render`.

        Raises:
            ValueError: no devices, one twice, or some of other processes without those of all.
        """
        if devices is None:
            devices = jax.local_devices()
        if not len(devices) or len(set(devices)) < len(devices):
            raise ValueError(
                f"devices are {list(devices)}; expected at least one, each named once, such as jax.devices()"
            )
        processes = {device.process_index for device in devices}
        if processes not in ({jax.process_index()}, set(range(jax.process_count()))):
            raise ValueError(
                f"devices are those of the processes {sorted(processes)} of {jax.process_count()}; expected"
                f" those of this one (jax.local_devices()) or some of each (jax.devices())"
            )
        # To JAX they are devices, which it does not declare as a type.
        self._devices: list[Any] = [
            device for device in devices if device.process_index == jax.process_index()
        ]
        self._processes = len(processes)

    def each(self, work: Callable[[int, S], R], count: int, shared: S) -> Iterator[tuple[R, float]]:
        """`work(number, copy)` of this process's numbers below `count`, and the share done.

        `copy` is `shared` on the device that does it.
        """
        first = jax.process_index() if self._processes > 1 else 0
        numbers = range(first, count, self._processes)
        copies = [shared]
        if len(self._devices) > 1:
            copies = [eqx.filter_shard(shared, device) for device in self._devices]
        # XLA runs one block on about one core, so a CPU is given a block per core at a time.
        on_cpu = self._devices[0].platform == "cpu"
        at_once = max(1, CORES // len(copies)) if on_cpu else 1
        free: queue.SimpleQueue[S] = queue.SimpleQueue()
        for copy in copies * at_once:
            free.put(copy)

        def one(number: int) -> R:
            copy = free.get()
            try:
                return work(number, copy)
            finally:
                free.put(copy)

        with concurrent.futures.ThreadPoolExecutor(len(copies) * at_once) as pool:
            for done, found in enumerate(pool.map(one, numbers), start=1):
                yield found, done / len(numbers)

    def total(self, sums: Float[np.ndarray, "p c"]) -> Float[np.ndarray, "p c"]:
        """The sum over all processes of what each has."""
        if self._processes == 1:
            return sums
        return np.asarray(multihost_utils.process_allgather(sums)).sum(axis=0)

    def total_of_sparse(self, sums: csr_array) -> csr_array:
        """The same of sparse matrices, of which so many rows are spread out at a time."""
        if self._processes == 1:
            return sums
        some = parts(sums.shape[0], _ROWS_AT_ONCE)  # pyright: ignore[reportOptionalSubscript]
        return csr_array(vstack([csr_array(self.total(sums[rows].toarray())) for rows in some]))
