"""Trees of arrays as JSON and numbers: what layers, lenses and cameras are made of, kept bit for bit.

Modules and frozen dataclasses of focusjax become their name and fields, arrays become their type, shape and
place among the bytes. Reading makes nothing but those classes: no code comes out of a file.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from focusjax.layers._grid import Grid
from focusjax.layers._layers import LeftOut

_ALIGNED = 8


def written(value: Any) -> tuple[Any, bytes]:
    """`value` as what JSON holds, and the bytes of its arrays.

    Raises:
        ValueError: something in it that is no number, text, array, tuple or module of focusjax.
    """
    blocks: list[bytes] = []
    length = 0

    def encode(part: Any) -> Any:
        nonlocal length
        if part is None or isinstance(part, bool | int | str):
            return part
        if isinstance(part, float):
            return {"float": part.hex()}
        if isinstance(part, jax.Array | np.ndarray | np.generic):
            array = np.asarray(part)
            block = np.ascontiguousarray(array).tobytes()
            block += bytes(-len(block) % _ALIGNED)
            header = {"dtype": array.dtype.name, "shape": list(array.shape), "at": length}
            blocks.append(block)
            length += len(block)
            return {"array": header, "host": not isinstance(part, jax.Array)}
        if isinstance(part, tuple | list):
            return {"tuple" if isinstance(part, tuple) else "list": [encode(each) for each in part]}
        if _classes().get(type(part).__name__) is type(part):
            fields = {field.name: encode(getattr(part, field.name)) for field in dataclasses.fields(part)}
            return {"class": type(part).__name__, "fields": fields}
        raise ValueError(
            f"there is a {type(part).__name__}, which cannot be written; leave it out of the lens"
        )

    return encode(value), b"".join(blocks)


def read(said: Any, data: bytes) -> Any:
    """What `written` was given.

    Raises:
        ValueError: a class that focusjax does not have, or arrays beyond the end of `data`.
    """
    if said is None or isinstance(said, bool | int | str):
        return said
    if isinstance(said, dict):
        readers: dict[str, Callable[[Any], Any]] = {
            "float": float.fromhex,
            "tuple": lambda parts: tuple(read(each, data) for each in parts),
            "list": lambda parts: [read(each, data) for each in parts],
            "array": lambda header: _array(header, data, host=said["host"]),
            "class": lambda name: _made(name, said["fields"], data),
        }
        kind = next(iter(said), None)
        if kind in readers:
            return readers[kind](said[kind])
    raise ValueError(f"there is {said!r:.40}, which focusjax does not write")


def _array(header: dict[str, Any], data: bytes, *, host: bool) -> Any:
    dtype, shape = np.dtype(header["dtype"]), tuple(header["shape"])
    if dtype.kind not in "biuf" or not all(isinstance(n, int) and n >= 0 for n in shape):
        raise ValueError(f"there is an array of {dtype} with shape {shape}")
    array = np.frombuffer(data, dtype, count=int(np.prod(shape)), offset=header["at"]).reshape(shape)
    if host:
        return array.copy()
    found = jax.device_put(array)
    if found.dtype != dtype:
        raise ValueError(f"its numbers are of {dtype}; load it with JAX_ENABLE_X64=1, as it was saved")
    return found


def _made(name: str, fields: dict[str, Any], data: bytes) -> Any:
    kind = _classes().get(name)
    if kind is None or set(fields) != {field.name for field in dataclasses.fields(kind)}:
        raise ValueError(f"there is a {name!r} of another version of focusjax")
    made = object.__new__(kind)
    for key, value in fields.items():
        # As for a tree that is put together again: what was checked once need not be.
        object.__setattr__(made, key, read(value, data))
    return made


def _classes() -> dict[str, Any]:
    """All concrete modules of focusjax by name."""
    found: dict[str, Any] = {"Grid": Grid, "LeftOut": LeftOut}
    waiting = list(eqx.Module.__subclasses__())
    while waiting:
        kind = waiting.pop()
        waiting += kind.__subclasses__()
        if kind.__module__.startswith("focusjax."):
            found[kind.__name__] = kind
    return found
