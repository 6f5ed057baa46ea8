"""A picture's rays on several devices, and in several processes.

Everything is replicated but the list of ray groups, of which each device traces every n-th part; what they
have found is added up at the end.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import eval_jaxpr
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array

from focusjax._arguments import ArgumentError
from focusjax._at_once import at_once

T = TypeVar("T")

_AXIS = "devices"


def rays_at_once() -> int:
    """How many rays of a picture are followed together where arrays are by default."""
    return at_once(cpu=1 << 17, gpu=1 << 24)


@runtime_checkable
class Device(Protocol):
    """What matters here of a JAX device, as `jax.devices()` lists them."""

    process_index: int
    platform: str


def mesh_of(devices: Sequence[Device] | None) -> Mesh | None:
    """The mesh of `devices`; None for the default device. See `render`.

    Raises:
        ArgumentError: (a `ValueError`) no devices, what is none, one twice, or some of other processes
            without those of all.
    """
    if devices is None:
        return None
    listed = isinstance(devices, Sequence) and all(isinstance(each, Device) for each in devices)
    if not listed or not devices or len(set(devices)) < len(devices):
        raise ArgumentError(
            f"devices are {devices!r}; expected at least one, each named once, such as jax.devices()",
            "devices",
        )
    processes = {device.process_index for device in devices}
    if processes not in ({jax.process_index()}, set(range(jax.process_count()))):
        raise ArgumentError(
            f"devices are those of the processes {sorted(processes)} of {jax.process_count()}; expected"
            f" those of this one (jax.local_devices()) or some of each (jax.devices())",
            "devices",
        )
    return Mesh(np.array(devices, dtype=object), (_AXIS,))


def replicated(tree: T, mesh: Mesh) -> T:
    """Arrays with a copy on every device. Processes have to hand in the same."""
    sharding = NamedSharding(mesh, PartitionSpec())

    def put(leaf: Any) -> Any:
        if not eqx.is_array(leaf):
            return leaf
        values = np.asarray(leaf)
        return jax.make_array_from_callback(values.shape, sharding, lambda index: values[index])

    return jax.tree.map(put, tree)


def summed_over(
    add: Callable[[T, tuple[Array, ...]], tuple[T, None]],
    nothing: T,
    work: tuple[Array, ...],
    mesh: Mesh | None,
) -> T:
    """The sum that `add` makes from `nothing` of all parts of `work`, on the devices of `mesh`.

    `add` is the body of a `jax.lax.scan`, and `nothing` is zeros. Parts lie along the first axis, a multiple
    of the number of devices.
    """
    if mesh is None:
        return jax.lax.scan(add, nothing, work)[0]
    # Parts that follow one another cost about the same, so they go to different devices.
    order = np.arange(len(work[0])).reshape(-1, mesh.size).T.ravel()

    def of_device(*part: Array) -> T:
        return jax.lax.scan(add, nothing, part)[0]

    spread = tuple(column[jnp.asarray(order)] for column in work)
    part = tuple(column[: len(column) // mesh.size] for column in spread)
    # What the function refers to becomes an argument, of which each device has its copy.
    made = jax.make_jaxpr(of_device)(*part)

    def shared(constants: list[Array], *part: Array) -> T:
        leaves = jax.lax.psum(eval_jaxpr(made.jaxpr, constants, *part), _AXIS)
        return jax.tree.unflatten(jax.tree.structure(nothing), leaves)

    return jax.shard_map(
        shared,
        mesh=mesh,
        in_specs=(PartitionSpec(), *(PartitionSpec(_AXIS) for _ in work)),
        out_specs=PartitionSpec(),
        check_vma=False,
    )(made.consts, *spread)
