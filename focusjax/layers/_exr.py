"""Layers in OpenEXR files: pictures that other programs show, and all numbers bit for bit.

A part for each layer, the nearest first, has R, G, B (linear, multiplied by A), A (the share that is covered)
and Z (distance along the view axis in metres, infinite where nothing is), on the samples of the frame. They
are pictures for compositing. The last part, `focusjax`, has the layers themselves: the bytes of all arrays as
whole numbers of 32 bits, and in its header what they are. It is what is read.

In that header modules and frozen dataclasses of focusjax are their name and fields, arrays are their type,
shape and place among the bytes. Reading makes nothing but those classes: no code comes out of a file.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import OpenEXR

from focusjax._arguments import require_kind
from focusjax._quiet_exr import open_exr
from focusjax.layers._grid import Grid
from focusjax.layers._layers import Layers, LeftOut

_PART, _CHANNEL, _HEADER = "focusjax", "bits", "focusjax:layers"
_COLUMNS = 4096
_FORMAT = 1
_ALIGNED = 8
"""Bytes: arrays begin at multiples of so many."""


def save_layers(path: str | Path, layers: Layers) -> None:
    """Write `layers` to a multi-part OpenEXR file, from which `load_layers` reads them bit for bit.

    Other programs see a part for each layer, named `layer1` (the nearest), `layer2`, ..., with the channels
    R, G, B, A (premultiplied) and Z (metres along the view axis) of the frame. Gloss that every ray works
    out for itself is not in R, G and B.

    Args:
        path: file to write; its name ends in .exr.
        layers: what `peel` or `decompose` made.

    Raises:
        ValueError: another ending, or a folder that cannot be written to.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> fj.save_layers("wall.exr", layers)
        >>> picture = fj.render_pinhole(fj.load_layers("wall.exr"))
        >>> picture.shape
        (6, 8, 3)
    """
    path = Path(path)
    require_kind(layers, Layers, "save_layers(path, layers)", "`peel` and `decompose` make them", "layers")
    if path.suffix.lower() != ".exr":
        raise ValueError(f"{path}: layers are written to OpenEXR files; give a name that ends in .exr")
    said, data = written(layers)
    header = {"format": _FORMAT, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest(), "tree": said}
    rows = max(1, -(-len(data) // (4 * _COLUMNS)))
    words = np.zeros((rows, _COLUMNS), dtype=np.uint32)
    words.view(np.uint8).reshape(-1)[: len(data)] = np.frombuffer(data, np.uint8)
    pictures = _pictures(layers)
    size = pictures[0]["Z"].shape
    parts = [OpenEXR.Part(_head(f"layer{k + 1}", size), planes) for k, planes in enumerate(pictures)]
    parts.append(OpenEXR.Part({**_head(_PART, size), _HEADER: json.dumps(header)}, {_CHANNEL: words}))
    new = path.with_name(f".{path.name}.new")
    try:
        with OpenEXR.File(parts) as file:
            file.write(str(new))
        new.replace(path)
    except (OSError, RuntimeError) as error:
        new.unlink(missing_ok=True)
        raise ValueError(f"{path}: cannot be written ({error}); choose another place") from error


def load_layers(path: str | Path) -> Layers:
    """The layers of a file that `save_layers` wrote, all arrays and settings as they were.

    Raises:
        ValueError: no such file, another OpenEXR file, one that was changed, or of another version; numbers
            of 64 bits where JAX has 32.

    Example:
        >>> wall = fj.make_object("wall", [(-9, -9, -2), (9, -9, -2), (0, 9, -2)], [(0, 1, 2)])
        >>> camera = fj.look_at((0, 0, 0), (0, 0, -1), width=8, height=6, focal_length=0.05)
        >>> lens = fj.thin_lens(focus_distance=2, f_number=2, focal_length=0.05)
        >>> layers = fj.peel(fj.make_scene([wall], unlit=True), camera, lens)
        >>> fj.save_layers("wall.exr", layers)
        >>> bool((fj.load_layers("wall.exr").disparity == layers.disparity).all())
        True
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file of layers; check the path")
    try:
        with open_exr(path, header_only=True) as file:
            names = [each.name() for each in file.parts]
        with open_exr(path) as file:
            part = next((each for each in file.parts if each.name() == _PART), None)
            text = None if part is None else part.header.get(_HEADER)
            words = None if part is None else np.ascontiguousarray(part.channels[_CHANNEL].pixels)
    except Exception as error:
        raise ValueError(
            f"{path}: this OpenEXR file cannot be read ({error}); save the layers again"
        ) from error
    if not names or (part is None and _PART in names):
        raise ValueError(f"{path}: is cut off or damaged; copy it again, or save the layers again")
    if text is None or words is None:
        raise ValueError(
            f"{path}: has no part {_PART!r} with layers; colours and depth of another renderer are a scene:"
            " give the file to load_photo"
        )
    try:
        header = json.loads(text)
        data = words.tobytes()[: header["bytes"]]
        if hashlib.sha256(data).hexdigest() != header["sha256"]:
            raise ValueError("it was changed since")
        found: Any = read(header["tree"], data) if header["format"] == _FORMAT else None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{path}: its layers cannot be read back ({error}); save them again with this version"
        ) from error
    if not isinstance(found, Layers):
        raise ValueError(f"{path}: holds layers of another version of focusjax; save them again")
    return found


def _head(name: str, size: tuple[int, int]) -> dict[str, Any]:
    # All parts of a file have one display window, whatever they hold.
    window = np.array([0, 0], np.int32), np.array([size[1] - 1, size[0] - 1], np.int32)
    return {
        "name": name,
        "type": OpenEXR.scanlineimage,
        "compression": OpenEXR.ZIP_COMPRESSION,
        "displayWindow": window,
    }


def _pictures(layers: Layers) -> list[dict[str, np.ndarray]]:
    """The channels of each layer that holds anything, without the margin."""
    grid = layers.grid
    frame = np.s_[
        grid.margin : grid.margin + grid.height * grid.supersampling,
        grid.margin : grid.margin + grid.width * grid.supersampling,
    ]
    disparity, radiance = np.asarray(layers.disparity), np.asarray(layers.radiance)
    opacity = None if layers.opacity is None else np.asarray(layers.opacity)
    found = []
    for k in range(layers.filled):
        w = disparity[k][frame]
        there = np.asarray(layers.cells[k])[frame] > 0
        share = np.where(there, 1.0 if opacity is None else opacity[k][frame], 0.0)
        with np.errstate(divide="ignore"):
            planes = {"Z": np.where(there & (w > 0), 1.0 / w, np.inf), "A": share}
        planes |= {name: share * radiance[k][frame][..., c] for c, name in enumerate("RGB")}
        found.append({name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()})
    return found


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
