"""Functions compiled by JAX, with programs that the next process finds before it traces anything.

JAX keeps what XLA compiles in the folder `jax_compilation_cache_dir`, if it has one, and finds it by its
text. So every process traces and lowers each function again, which takes several times as long as to read its
program. Here a program is found by all that tracing depends on: the sources that its function and the classes
of its arguments are made of (`_sources.py`), versions of the packages that focusjax is built on, settings of
JAX, the processor, and the arguments but for the values of arrays. What belongs to other packages or to a
script, as a lens of its own, is not known by that: functions of it are traced as always, and so are programs
that call Python.
"""

import functools
import hashlib
import io
import os
import pickle
import platform
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, Jaxpr

from focusjax import _program_files
from focusjax._program_files import SUFFIX, Mark, Program, read, setting, write
from focusjax._sources import are_as_begun, sources_of

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Options = dict[str, Any]

_HASTE: _Options = {
    "xla_backend_optimization_level": 0,
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_parallel_codegen_split_count": 1,
}
"""Of XLA: what takes most of the time to compile, and gains a program on little data next to nothing."""
_SOONER: _Options = {"xla_backend_optimization_level": 1, "xla_cpu_use_fusion_emitters": False}
"""Of XLA: what takes a third of the time to compile, and gains all but the tracer next to nothing."""
_MUCH = 1 << 17
"""Numbers in its arguments from which on a program is compiled as always."""
_PACKAGES = ("jax", "jaxlib", "equinox", "jaxtyping", "lineax", "numpy", "optimistix")
"""What functions are traced from, by their versions; focusjax itself goes by its sources."""
_KNOWN = {"focusjax", *_PACKAGES, *sys.stdlib_module_names} - {"__main__"}
"""Modules whose functions are known, and whose classes and functions arguments may hold."""
_LEAST = "persistent_cache_min_compile_time_secs"
"""JAX's setting: seconds from which on a program is worth being kept."""
_CONTEXT = ("enable_x64", "default_matmul_precision", "numpy_dtype_promotion", "numpy_rank_promotion")
"""Settings of JAX that may be others for a while, or in one thread."""
_alone = threading.Lock()
"""Held by the thread that has changed the setting of what is worth being kept."""
_in_memory: list[dict[Any, Any]] = []
"""Of every function its programs; None for what JAX alone has to run."""
_UNSEEN: Any = object()


def forget_programs() -> None:
    """Lets go of all compiled programs of this process, as `jax.clear_caches` does; files stay."""
    for programs in _in_memory:
        programs.clear()
    _program_files.forget_what_is_ahead()
    jax.clear_caches()


def jit(function: _Function) -> _Function:
    """`equinox.filter_jit` of a function of a module, whose programs are kept where JAX keeps its own."""
    return _jitted(function, {})


def jit_in_haste(function: _Function) -> _Function:
    """`jit` of a function; on a processor and for few numbers it is compiled in a third of the time.

    JAX takes such options for a whole program only: inside another one, as in `jax.grad` or a larger `jit`,
    the function is compiled like that one. XLA changes its options from version to version: one that does not
    know these compiles as always.
    """
    return _jitted(function, _HASTE, _MUCH)


def jit_sooner(function: _Function) -> _Function:
    """`jit` of a function that takes little time to run, whatever its arguments.

    On a processor it is compiled in two thirds of the time. As of `jit_in_haste`, that holds where it is not
    part of another program, and for versions of XLA that know the options.
    """
    return _jitted(function, _SOONER, sys.maxsize)


def _jitted(function: _Function, haste: _Options, most: int = 0) -> _Function:
    """A compiled function; by the options of `haste`, if any, for arguments of `most` numbers or fewer."""
    plain = eqx.filter_jit(function)
    options: dict[str, Any] = {"compiler_options": haste}
    with_options = eqx.filter_jit(function, **options)
    programs: dict[Any, Any] = {}
    _in_memory.append(programs)

    def hasty(*arguments: Any, **named: Any) -> Any:
        # JAX takes options for a whole program only, also where something else is traced.
        with jax.ensure_compile_time_eval():
            return with_options(*arguments, **named)

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        folder = _program_files.kept_in()
        if folder is None and not haste:
            return plain(*arguments, **named)
        leaves, tree = jax.tree.flatten((arguments, named))
        arrays = [leaf for leaf in leaves if eqx.is_array(leaf)]
        if any(isinstance(leaf, Tracer) for leaf in arrays):
            return plain(*arguments, **named)
        hurried = bool(haste) and sum(leaf.size for leaf in arrays) <= most and _options_are_known()
        usual = hasty if hurried else plain
        if folder is None or not all(_is_here(leaf) for leaf in arrays):
            return usual(*arguments, **named)
        fixed = tuple(None if eqx.is_array(leaf) else leaf for leaf in leaves)
        key = folder, tree, fixed, tuple(_kind(leaf) for leaf in arrays), *map(setting, _CONTEXT)
        program = programs.get(key, _UNSEEN)
        if program is _UNSEEN:
            asked = _Asked(function, tree, fixed, haste if hurried else {})
            programs[key], results = _first(asked, folder, arrays)
            if results is not _UNSEEN:
                return results
            program = None
        return usual(*arguments, **named) if program is None else program(arrays)

    return call  # pyright: ignore[reportReturnType]


@dataclass(frozen=True)
class _Asked:
    """What is compiled.

    Attributes:
        tree: of positional and named arguments.
        fixed: leaves of it; None for arrays.
        options: of XLA.
    """

    function: Callable[..., Any]
    tree: Any
    fixed: tuple[Any, ...]
    options: _Options

    def with_arrays(self, arrays: Sequence[Any]) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Arguments, positional and named."""
        rest = iter(arrays)
        leaves = [next(rest) if leaf is None else leaf for leaf in self.fixed]
        return jax.tree.unflatten(self.tree, leaves)


def _is_here(array: Any) -> bool:
    """Whether an array is of numpy or on the default device."""
    return not isinstance(array, jax.Array) or array.devices() == {jax.devices()[0]}


def _kind(array: Any) -> tuple[Any, ...]:
    """What of an array a program depends on."""
    kind = jax.typeof(array)
    return kind.shape, kind.dtype, kind.weak_type


def _first(asked: _Asked, folder: Path, arrays: Sequence[Any]) -> tuple[Program | None, Any]:
    """A program that was kept, or is from now on, and its results; None and nothing if JAX has to run it."""
    try:
        name, modules = _name(asked, arrays)
        kept = are_as_begun(modules)
    except Exception:
        # Objects say in their own ways that they cannot be written down.
        return None, _UNSEEN
    if not kept:
        return None, _UNSEEN
    path = folder / (name + SUFFIX)
    program = read(path)
    if program is not None:
        try:
            return program, jax.block_until_ready(program(arrays))
        except jax.errors.JaxRuntimeError:
            # Parts of it may be missing, which shows when it runs.
            with suppress(OSError):
                path.unlink()
    with _alone:
        least = setting(_LEAST)
    start = time.perf_counter()
    program = _compiled(asked, arrays)
    if program is None:
        return None, _UNSEEN
    if time.perf_counter() - start >= least and are_as_begun(modules):
        write(path, program)
    return program, program(arrays)


def _name(asked: _Asked, arrays: Sequence[Any]) -> tuple[str, set[str]]:
    """What is different for different programs, and the modules that hold their functions and classes.

    Raises:
        PicklingError: something belongs to an unknown package.
    """
    text = io.BytesIO()
    described = _Described(text)
    described.fast = True
    kinds = [repr(_kind(each)) for each in arrays]
    marked = asked.with_arrays([Mark()] * len(arrays))
    function = asked.function
    if "<" in function.__qualname__ or not _is_known(function):
        raise pickle.PicklingError(f"{function!r} is not of a module of a known package")
    name = function.__module__, function.__qualname__, sorted(asked.options.items())
    described.dump((_surroundings(), _settings(), name, kinds, marked))
    modules = {function.__module__, *described.modules}
    hashed = hashlib.sha256(text.getvalue() + sources_of(modules).encode()).hexdigest()
    return f"{function.__name__.strip('_')}-{hashed[:40]}", modules


class _Described(pickle.Pickler):
    """Writes down values of known packages, equal ones alike.

    Attributes:
        modules: that hold them, their classes and functions.
    """

    def __init__(self, file: io.BytesIO):
        super().__init__(file)
        self.modules: set[str] = set()

    def persistent_id(self, obj: Any) -> Any:
        module = getattr(obj, "__module__", None)
        if isinstance(module, str):
            if not _is_known(obj):
                raise pickle.PicklingError(f"{obj!r} is of another package")
            self.modules.add(module)
        return None

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, set | frozenset):
            return sorted, (sorted(map(repr, obj)),)
        return NotImplemented


def _is_known(obj: Any) -> bool:
    return (obj.__module__ or "builtins").split(".")[0] in _KNOWN


@functools.cache
def _surroundings() -> str:
    """What tracing and compiling depend on and a process has for good."""
    device = jax.devices()[0]
    return repr(
        (
            [version(name) for name in _PACKAGES],
            sys.version,
            platform.machine(),
            _processor(),
            os.environ.get("XLA_FLAGS"),
            (device.platform, device.device_kind, device.client.platform_version),
            (os.cpu_count(), os.environ.get("NPROC")),
        )
    )


def _processor() -> list[str]:
    """Its model and instructions, where the system lists them."""
    listed = Path("/proc/cpuinfo")
    if not listed.exists():
        return [platform.processor()]
    lines = listed.read_text().splitlines()[:40]
    return [line for line in lines if line.startswith(("flags", "Features", "model"))]


def _settings() -> list[str]:
    """JAX's, but for those of its own cache and of what it says."""
    values = jax.config.values
    names = [
        name for name in sorted(values) if not any(word in name for word in ("cache", "log", "traceback"))
    ]
    return [f"{name}={getattr(jax.config, name, values[name])}" for name in names]


def _compiled(asked: _Asked, arrays: Sequence[Any]) -> Program | None:
    """The program, traced and compiled; None if it calls Python, which is not to be kept."""
    made = []

    def flat(*arrays: jax.Array) -> list[jax.Array]:
        arguments, named = asked.with_arrays(arrays)
        leaves, tree = jax.tree.flatten(asked.function(*arguments, **named))
        marked = [Mark() if eqx.is_array(leaf) else leaf for leaf in leaves]
        made[:] = [jax.tree.unflatten(tree, marked)]
        return [leaf for leaf in leaves if eqx.is_array(leaf)]

    flat.__name__ = f"kept_{asked.function.__name__.strip('_')}"
    traced = jax.jit(flat).trace(*arrays)
    if _calls_python(traced.jaxpr.jaxpr):
        return None
    lowered = traced.lower()
    # JAX is not to keep it: what XLA reads from there it writes down again without some of its functions.
    with _alone:
        least = setting(_LEAST)
        jax.config.update(f"jax_{_LEAST}", sys.float_info.max)
        try:
            return Program(lowered.compile(compiler_options=asked.options or None), made[0])
        finally:
            jax.config.update(f"jax_{_LEAST}", least)


def _calls_python(jaxpr: Jaxpr) -> bool:
    return any(
        "callback" in equation.primitive.name or any(_calls_python(each) for each in _inner(equation.params))
        for equation in jaxpr.eqns
    )


def _inner(parameters: dict[str, Any]) -> Iterator[Jaxpr]:
    for leaf in jax.tree.leaves(parameters, is_leaf=lambda each: isinstance(each, Jaxpr | ClosedJaxpr)):
        if isinstance(leaf, Jaxpr | ClosedJaxpr):
            yield leaf.jaxpr if isinstance(leaf, ClosedJaxpr) else leaf


@functools.cache
def _options_are_known() -> bool:
    """Whether programs run on a processor, by a version of XLA that knows all options."""
    if jax.default_backend() != "cpu":
        return False
    try:
        with jax.ensure_compile_time_eval():
            jax.jit(lambda: 0, compiler_options=_HASTE)()
    except jax.errors.JaxRuntimeError:
        return False
    return True
