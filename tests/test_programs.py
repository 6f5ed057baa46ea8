"""Compiled programs: wherever a function is called it gives the same, and files of it give what it would."""

import concurrent.futures
import functools
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from focusjax import _program_files, _programs, _sources
from focusjax._arguments import ArgumentError
from focusjax._programs import jit, jit_in_haste
from focusjax.lens import thin_lens
from focusjax.lens._base import AbstractLens


@jit_in_haste
def cubed(x):
    """The third power."""
    return x**3


def answers(lens: AbstractLens, factor: Any, kinds: dict[str, Any]) -> tuple[Any, ...]:
    """A lens, a number by linear algebra, and things that are no arrays."""
    matrix = jnp.eye(3, dtype=jnp.asarray(factor).dtype) * factor
    solved = jnp.linalg.solve(matrix, jnp.arange(3.0, dtype=matrix.dtype))
    return lens, jnp.sum(solved), kinds["unit"], (None, kinds["count"])


def calling(x: Any) -> Any:
    """A function whose program calls Python."""
    return eqx.error_if(2.0 * x, x < 0.0, "below zero")


@functools.cache
def named_by_focusjax() -> int:
    """What pickles as its name."""
    return 1


@pytest.fixture
def folder(tmp_path: Path):
    """JAX's folder, empty; functions of this file count as focusjax's."""
    before = _program_files.setting("compilation_cache_dir"), _program_files.setting(_programs._LEAST)
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    _programs._KNOWN.add(__name__.split(".")[0])
    _program_files.load_lapack()
    yield tmp_path
    _programs._KNOWN.discard(__name__.split(".")[0])
    jax.config.update("jax_compilation_cache_dir", before[0])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", before[1])


def events(call: Any) -> tuple[list[str], Any]:
    """JAX's events of compiling during a call, and what it returns."""
    seen = []

    def note(event: str, duration_secs: float, **details: object) -> None:
        if "/compile/" in event:
            seen.append(event.rsplit("/", 1)[1])

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        return seen, call()
    finally:
        jax.monitoring.unregister_event_duration_listener(note)


def files(folder: Path) -> list[Path]:
    """Programs that are kept."""
    return sorted(folder.glob("*" + _program_files.SUFFIX))


def arguments(factor: float = 2.0, count: int = 3) -> tuple[Any, ...]:
    """Of `answers`."""
    lens = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
    return lens, jnp.array(factor, dtype=jnp.float64), {"unit": "px", "count": count}


def test_it_is_the_function_inside_other_programs_and_alone():
    assert cubed.__doc__ == "The third power."
    np.testing.assert_allclose(cubed(jnp.array(2.0)), 8.0)
    np.testing.assert_allclose(jax.grad(cubed)(2.0), 12.0)
    np.testing.assert_allclose(jax.jit(jax.grad(cubed))(2.0), 12.0)
    np.testing.assert_allclose(jax.vmap(cubed)(jnp.arange(3.0)), [0.0, 1.0, 8.0])


def test_an_option_that_this_version_does_not_know_is_left_out(monkeypatch):
    monkeypatch.setattr(_programs, "_HASTE", {"xla_no_such_option": 1})
    _programs._options_are_known.cache_clear()
    try:
        assert not _programs._options_are_known()
        np.testing.assert_allclose(jit_in_haste(lambda x: x + 1.0)(jnp.array(1.0)), 2.0)
    finally:
        monkeypatch.undo()
        _programs._options_are_known.cache_clear()


@pytest.mark.parametrize("compiled_by", [jit, jit_in_haste])
def test_what_was_kept_is_neither_traced_nor_compiled_again(folder: Path, compiled_by: Any):
    first = compiled_by(answers)(*arguments())
    assert len(files(folder)) == 1
    # Another wrapper has nothing in memory, as another process.
    seen, second = events(lambda: compiled_by(answers)(*arguments()))
    assert "read_program_duration" in seen
    assert "jaxpr_trace_duration" not in seen
    assert "backend_compile_duration" not in seen
    assert jax.tree.structure(first) == jax.tree.structure(second)
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True):
        np.testing.assert_array_equal(one, other)
    assert second[2:] == ("px", (None, 3))


def test_other_values_use_the_same_program_and_everything_else_another(folder: Path):
    compiled = jit(answers)
    np.testing.assert_allclose(compiled(*arguments())[1], 1.5)
    np.testing.assert_allclose(compiled(*arguments(4.0))[1], 0.75)
    assert len(files(folder)) == 1
    assert compiled(*arguments(count=4))[3] == (None, 4)
    assert len(files(folder)) == 2
    lens, factor, kinds = arguments()
    compiled(lens, jnp.asarray(factor, dtype=jnp.float32), kinds)
    assert len(files(folder)) == 3
    compiled(lens, np.asarray(factor), kinds)
    assert len(files(folder)) == 3


@pytest.mark.parametrize(("changed", "programs"), [("optics", 2), ("lens", 2), ("focus", 1), ("job", 1)])
def test_other_sources_of_an_argument_are_another_program(
    folder: Path, monkeypatch: pytest.MonkeyPatch, changed: str, programs: int
):
    """Lenses are made of optics; neither is made of what solves or of commands."""
    monkeypatch.setattr(_program_files, "kept_in", lambda: folder)
    jit(answers)(*arguments())
    read = _sources._read

    def another(part: str) -> _sources._Part:
        return read(part)._replace(contents="another") if part == changed else read(part)

    monkeypatch.setattr(_sources, "_read", another)
    jit(answers)(*arguments())
    assert len(files(folder)) == programs


def test_what_changed_while_a_process_runs_is_neither_kept_nor_read(
    folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(_program_files, "kept_in", lambda: folder)
    jit(answers)(*arguments())
    (path,) = files(folder)
    path.unlink()
    monkeypatch.setattr(_sources, "BEGUN", 0.0)
    np.testing.assert_allclose(jit(answers)(*arguments())[1], 1.5)
    assert not files(folder)


def test_what_pickles_by_name_belongs_to_its_module(folder: Path):
    lens, factor, kinds = arguments()
    jit(answers)(lens, factor, kinds | {"own": named_by_focusjax})
    assert len(files(folder)) == 1
    named_by_focusjax.__module__ = "another"
    try:
        jit(answers)(lens, factor, kinds | {"own": named_by_focusjax, "count": 7})
    finally:
        named_by_focusjax.__module__ = __name__
    assert len(files(folder)) == 1


def test_other_settings_of_jax_are_another_program(folder: Path):
    compiled = jit(answers)
    compiled(*arguments())
    with jax.numpy_rank_promotion("allow"):
        compiled(*arguments())
    assert len(files(folder)) == 2
    with jax.default_device(jax.devices()[0]):
        np.testing.assert_allclose(jit(answers)(*arguments(count=7))[1], 1.5)
    assert len(files(folder)) == 2


def test_derivatives_and_larger_programs_trace_the_function(folder: Path):
    compiled = jit(answers)
    lens, factor, kinds = arguments()

    def by(factor: Any) -> Any:
        return compiled(lens, factor, kinds)[1]

    np.testing.assert_allclose(jax.grad(by)(factor), -0.75)
    np.testing.assert_allclose(jax.jit(by)(factor), 1.5)
    assert not files(folder)
    # What is known within a larger program is worked out at once.
    np.testing.assert_allclose(jax.jit(lambda x: x + by(factor))(1.0), 2.5)
    np.testing.assert_allclose(jax.jit(lambda x: x + by(factor))(1.0), 2.5)
    assert len(files(folder)) == 1


def refusing(x: Any) -> Any:
    """A function that is refused as it is traced."""
    raise ArgumentError("x is wrong; expected another", "x")


def test_what_is_refused_as_it_is_traced_is_refused_as_always(folder: Path):
    for _ in range(2):
        with pytest.raises(ArgumentError, match="x is wrong") as refused:
            jit(refusing)(jnp.array(2.0))
        assert refused.value.__context__ is None
    assert not files(folder)


def test_programs_that_call_python_are_not_kept(folder: Path):
    compiled = jit(calling)
    np.testing.assert_allclose(compiled(jnp.array(2.0)), 4.0)
    with pytest.raises(RuntimeError, match="below zero"):
        compiled(jnp.array(-1.0))
    assert not files(folder)


def test_what_belongs_to_others_is_not_kept(folder: Path):
    _programs._KNOWN.discard(__name__.split(".")[0])
    np.testing.assert_allclose(jit(answers)(*arguments())[1], 1.5)
    assert not files(folder)
    _programs._KNOWN.add(__name__.split(".")[0])
    np.testing.assert_allclose(jit(lambda x: 2.0 * x)(jnp.array(2.0)), 4.0)
    assert not files(folder)
    lens, factor, kinds = arguments()
    np.testing.assert_allclose(jit(answers)(lens, factor, {**kinds, "own": lambda: 1})[1], 1.5)
    assert not files(folder)


@pytest.mark.parametrize("content", [b"", b"no program", None])
def test_a_file_that_is_no_program_is_replaced(folder: Path, content: bytes | None):
    jit(answers)(*arguments())
    (path,) = files(folder)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    np.testing.assert_allclose(jit(answers)(*arguments())[1], 1.5)
    seen, _ = events(lambda: jit(answers)(*arguments()))
    assert "read_program_duration" in seen


def test_a_program_that_does_not_run_is_compiled_again(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_program_files, "kept_in", lambda: folder)
    jit(answers)(*arguments())
    (path,) = files(folder)

    def broken(path: Path) -> _program_files.Program | None:
        program = read(path)
        object.__setattr__(program, "compiled", fails)
        return program

    def fails(*arrays: Any) -> Any:
        raise jax.errors.JaxRuntimeError("NOT_FOUND: Function not found")

    read = _programs.read
    monkeypatch.setattr(_programs, "read", broken)
    path.touch()
    before = path.stat().st_mtime_ns
    np.testing.assert_allclose(jit(answers)(*arguments())[1], 1.5)
    assert files(folder) == [path]
    assert path.stat().st_mtime_ns > before


def test_threads_that_compile_at_once_keep_whole_programs(folder: Path):
    def one(count: int) -> Any:
        return jit(answers)(*arguments(count=count % 3))[1]

    with concurrent.futures.ThreadPoolExecutor(6) as pool:
        np.testing.assert_allclose(list(pool.map(one, range(12))), 1.5)
    assert len(files(folder)) == 3
    for count in range(3):
        seen, result = events(lambda count=count: one(count))
        np.testing.assert_allclose(result, 1.5)
        assert "backend_compile_duration" not in seen


def test_a_system_that_does_not_list_its_processor(monkeypatch: pytest.MonkeyPatch):
    assert any(line.startswith(("flags", "Features")) for line in _programs._processor())
    monkeypatch.setattr(Path, "exists", lambda path: False)
    assert _programs._processor() == [platform.processor()]


def test_a_folder_that_cannot_be_written_is_no_error(folder: Path):
    blocked = folder / "file"
    blocked.write_text("")
    jax.config.update("jax_compilation_cache_dir", str(blocked / "inside"))
    np.testing.assert_allclose(jit(answers)(*arguments())[1], 1.5)


def test_what_takes_no_time_to_compile_is_not_kept(folder: Path):
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1e6)
    np.testing.assert_allclose(jit(answers)(*arguments())[1], 1.5)
    assert not files(folder)
    assert _program_files.setting(_programs._LEAST) == 1e6


def test_the_oldest_programs_go(folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_program_files, "kept_in", lambda: folder)
    compiled = jit(answers)
    compiled(*arguments(count=1))
    (first,) = files(folder)
    os.utime(first, (1.0, 1.0))
    monkeypatch.setattr(_program_files, "_LARGEST", int(1.5 * first.stat().st_size))
    compiled(*arguments(count=2))
    (second,) = files(folder)
    assert second != first


_ANOTHER = """
import sys
from pathlib import Path
import jax
import jax.numpy as jnp
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
from focusjax import _program_files
import focusjax as fj
from focusjax.focus import ImagePoints
read = []
jax.monitoring.register_event_duration_secs_listener(lambda event, duration, **_: read.append(event))
lens = fj.thin_lens(focus_distance=1.0, f_number=2.8, focal_length=0.05)
camera = fj.look_at((0, 0.1, 0.6), (0, 0, 0), width=16, height=12, focal_length=0.05)
points = ImagePoints(
    xy=jnp.array([[3.0, 4.0], [9.0, 9.0]]),
    disparity=jnp.array([2.0, 0.5]),
    target=jnp.array([0.0, 3.0]),
    signed=jnp.array([False, False]),
    weight=jnp.ones(2),
    tolerance=jnp.full(2, 0.5),
    wish=jnp.arange(2),
    names=("near", "far"),
)
solution = fj.solve(points, camera, lens, free=("focus", "f_number"))
names = [path.name for path in Path(sys.argv[1]).glob("solve-*" + _program_files.SUFFIX)]
print(repr(float(solution.cost)), names, sum(_program_files.READ in event for event in read))
"""


def test_another_process_reads_what_one_has_kept(tmp_path: Path):
    """Names are the same in every process, and programs jump to LAPACK, which it has not loaded before."""

    def process() -> list[str]:
        run = [sys.executable, "-c", _ANOTHER, str(tmp_path)]
        return subprocess.run(run, check=True, capture_output=True, text=True).stdout.rsplit(" ", 1)

    first, second = process(), process()
    assert first[0] == second[0]
    assert int(first[1]) == 0
    assert int(second[1]) >= 1
