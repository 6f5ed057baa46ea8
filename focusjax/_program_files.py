"""Files of compiled programs: written once, read by later processes, and read ahead where they are expected.

XLA takes about a second to read the program of a picture, on one core and without Python's lock. What the
same command took last time is read beside its first steps, which import modules and load meshes.
"""

import functools
import hashlib
import os
import pickle
import threading
import time
import zlib
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
from jax.experimental import serialize_executable
from jax.stages import Compiled

SUFFIX = ".focusjax"
_LARGEST = 512 << 20
"""Bytes of programs that are kept; those not used for longest go."""
_MOST_AHEAD = 4 << 20
"""Bytes of files that are read ahead: a few programs of pictures, which take much more memory when read."""
_TAKEN = ".taken"
"""Suffix of lists of programs that a command took."""
_LISTS = 1 << 20
"""Bytes of such lists that are kept."""
READ = "/jax/core/compile/read_program_duration"
"""An event of JAX's: waiting for a program counts as compiling it."""


class Mark:
    """Stands for an array."""


@dataclass(frozen=True)
class Program:
    """A program, and what it makes: a tree with marks in place of arrays."""

    compiled: Compiled
    made: Any

    def __call__(self, arrays: Sequence[Any]) -> Any:
        """What the function makes of its arguments' arrays."""
        results = iter(self.compiled(*arrays))
        return jax.tree.map(lambda leaf: next(results) if isinstance(leaf, Mark) else leaf, self.made)


_ahead: dict[Path, Future[Program | None]] = {}
"""Programs that are read, or will be, by another thread."""
_taken: dict[Path, None] = {}
"""Files that were asked for, in their order."""


def kept_in() -> Path | None:
    """The folder of programs; None where they are not kept."""
    folder = setting("compilation_cache_dir")
    if not folder or "://" in folder or not setting("enable_compilation_cache"):
        return None
    apart = setting("disable_jit") or setting("debug_nans") or setting("default_device") is not None
    return None if apart or jax.device_count() > 1 else Path(folder)


def setting(name: str) -> Any:
    """One of JAX's."""
    return getattr(jax.config, f"jax_{name}")


@contextmanager
def reading_ahead(command: str) -> Iterator[None]:
    """Programs that `command` took last time are read beside what is done within, in the order it took them.

    Args:
        command: its name, or anything that no other command has.
    """
    folder = kept_in()
    if folder is None:
        yield
        return
    listed = folder / (hashlib.sha256(os.fsencode(command)).hexdigest()[:40] + _TAKEN)
    expected = _names(listed)
    _taken.clear()
    with ThreadPoolExecutor(1) as pool:
        _ahead.update({path: pool.submit(_loaded, path) for path in _few(folder / name for name in expected)})
        try:
            yield
        finally:
            forget_what_is_ahead()
    taken = [path.name for path in list(_taken) if path.parent == folder]
    if taken and taken != expected:
        _replace(listed, "\n".join(taken).encode(), f"*{_TAKEN}", _LISTS)


def forget_what_is_ahead(function: str = "") -> None:
    """Lets go of programs that are read ahead: of one function, or all."""
    # Several threads may do so at once.
    for path in list(_ahead):
        if not function or _function(path) == function:
            future = _ahead.pop(path, None)
            if future is not None:
                future.cancel()


def _function(path: Path) -> str:
    """The name of the function of a program."""
    return path.name.split("-")[0]


def _names(listed: Path) -> list[str]:
    """Of programs in a list; none, where there is no such list."""
    try:
        return listed.read_text().splitlines()
    except (OSError, ValueError):
        return []


def _few(paths: Iterable[Path]) -> Iterator[Path]:
    """The first of those that are there, as long as they are not too large together."""
    total = 0
    for path in paths:
        with suppress(OSError, ValueError):
            total += path.stat().st_size
            if total <= _MOST_AHEAD:
                yield path


def read(path: Path) -> Program | None:
    """A program that was kept; None if there is none, or none that can be read."""
    start = time.perf_counter()
    known = path in _taken
    _taken[path] = None
    ahead = _ahead.pop(path, None)
    if ahead is None and not known:
        # Those of the same function are for what was asked last time.
        forget_what_is_ahead(_function(path))
    # What another thread has not begun is sooner read here.
    program = _loaded(path) if ahead is None or ahead.cancel() else ahead.result()
    if program is not None:
        name = f"jit(kept_{_function(path)})"
        jax.monitoring.record_event_duration_secs(READ, time.perf_counter() - start, fun_name=name)
    return program


def _loaded(path: Path) -> Program | None:
    try:
        text = path.read_bytes()
        program, inputs, made = pickle.loads(zlib.decompress(text))
        load_lapack()
        # Results have no tree but a list, whose length is that of the marks.
        marks = [leaf for leaf in jax.tree.leaves(made) if isinstance(leaf, Mark)]
        outputs = jax.tree.structure([0] * len(marks))
        inputs = jax.tree.structure(((0,) * inputs, {}))
        compiled = serialize_executable.deserialize_and_load(program, inputs, outputs)
    except Exception:
        # There is none, or a damaged one, or one of another version of JAX.
        return None
    with suppress(OSError):
        os.utime(path)
    return Program(compiled, made)


@functools.cache
def load_lapack() -> None:
    """Programs jump to LAPACK, which JAX loads when it first lowers such a function."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), jax.numpy.float32))


def write(path: Path, program: Program) -> None:
    """Keep a program, if that can be done."""
    try:
        text, inputs, _ = serialize_executable.serialize(program.compiled)
        packed = zlib.compress(pickle.dumps((text, inputs.num_leaves, program.made)), 1)
    except Exception:
        # JAX cannot write it down.
        return
    _replace(path, packed, f"*{SUFFIX}", _LARGEST)


def _replace(path: Path, content: bytes, like: str, most: int) -> None:
    """A file written whole, if that can be done; those `like` it that were not used for longest go."""
    new = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.write_bytes(content)
        os.replace(new, path)
        forget_the_oldest(path.parent, like, most)
    except OSError:
        # The disk is full, or the folder cannot be written.
        return


def forget_the_oldest(folder: Path, pattern: str, most: int) -> None:
    """Removes those files of `folder` like `pattern` that were not used for longest, but for `most` bytes."""
    files = []
    for path in folder.glob(pattern):
        with suppress(FileNotFoundError):
            files.append((path.stat(), path))
    total = 0
    for stat, path in sorted(files, key=lambda pair: -max(pair[0].st_mtime, pair[0].st_atime)):
        total += stat.st_size
        if total > most:
            path.unlink(missing_ok=True)
