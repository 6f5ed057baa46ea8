"""Programs that are read ahead are those that would be read, and nothing depends on them."""

import concurrent.futures
import os
import sys
import threading
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from focusjax import _program_files, _programs
from focusjax._program_files import SUFFIX, Program, reading_ahead
from focusjax.lens import thin_lens
from focusjax.lens._base import AbstractLens


def twice(lens: AbstractLens, factor: Any) -> Any:
    """A function of a lens."""
    return lens, 2.0 * factor


def thrice(lens: AbstractLens, factor: Any) -> Any:
    """Another."""
    return lens, 3.0 * factor


@pytest.fixture
def readers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The names of files, and whether the main thread read them; as if this file were focusjax's."""
    monkeypatch.setattr(_program_files, "kept_in", lambda: tmp_path)
    monkeypatch.setattr(_programs, "_KNOWN", _programs._KNOWN | {__name__.split(".")[0]})
    loaded, seen = _program_files._loaded, []

    def note(path: Path) -> Program | None:
        program = loaded(path)
        here = threading.current_thread() is threading.main_thread()
        seen.append((path.name.split("-")[0], program is not None, "here" if here else "ahead"))
        return program

    monkeypatch.setattr(_program_files, "_loaded", note)
    return seen


def run(*functions: Any, command: str = "a") -> None:
    """The command, as a process that has nothing in memory does it, after some other work."""
    with reading_ahead(command):
        for future in list(_program_files._ahead.values()):
            future.result()
        for function in functions:
            lens = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
            factor = {twice: 2.0, thrice: 3.0}[function]
            np.testing.assert_allclose(_programs.jit(function)(lens, jnp.array(5.0))[1], 5.0 * factor)


def test_what_a_command_took_last_time_is_read_ahead(readers: list[Any]):
    run(twice, thrice)
    assert readers == [("twice", False, "here"), ("thrice", False, "here")]
    readers.clear()
    run(twice, thrice)
    assert readers == [("twice", True, "ahead"), ("thrice", True, "ahead")]
    readers.clear()
    # What another command took is its own affair.
    run(thrice, command="b")
    assert readers == [("thrice", True, "here")]
    readers.clear()
    # What is not taken is not expected the time after.
    run(thrice)
    assert [(name, where) for name, _, where in readers] == [("twice", "ahead"), ("thrice", "ahead")]
    readers.clear()
    run(thrice)
    assert readers == [("thrice", True, "ahead")]


def test_what_another_thread_has_not_begun_is_read_at_once(readers: list[Any]):
    run(twice, thrice)
    readers.clear()
    begun, go_on = threading.Event(), threading.Event()
    note = _program_files._loaded

    def waiting(path: Path) -> Program | None:
        if threading.current_thread() is not threading.main_thread():
            begun.set()
            assert go_on.wait(60.0)
        return note(path)

    _program_files._loaded = waiting
    with reading_ahead("a"):
        assert begun.wait(60.0)
        lens = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
        _programs.jit(thrice)(lens, jnp.array(5.0))
        assert readers == [("thrice", True, "here")]
        go_on.set()
        _programs.jit(twice)(lens, jnp.array(5.0))
    assert readers[1:] == [("twice", True, "ahead")]


@pytest.mark.parametrize("damage", ["programs", b"\xff\n..", b"\0\0\n\0", "folder"])
def test_damaged_files_are_no_error(readers: list[Any], tmp_path: Path, damage: str | bytes):
    run(twice)
    (listed,) = tmp_path.glob("*" + _program_files._TAKEN)
    if damage == "programs":
        for path in tmp_path.glob("*" + SUFFIX):
            path.write_bytes(b"no program")
    elif isinstance(damage, bytes):
        listed.write_bytes(damage)
    else:
        for path in tmp_path.iterdir():
            path.unlink()
        tmp_path.rmdir()
    run(twice)
    run(twice)
    assert readers[-1] == ("twice", True, "ahead")


def test_without_a_folder_nothing_is_read(readers: list[Any], monkeypatch: pytest.MonkeyPatch):
    run(twice)
    monkeypatch.setattr(_program_files, "kept_in", lambda: None)
    with reading_ahead("a"):
        assert not _program_files._ahead


def test_what_ends_early_does_not_change_what_is_expected(readers: list[Any]):
    run(twice)
    readers.clear()
    with pytest.raises(KeyError, match="own"), reading_ahead("a"):
        raise KeyError("own")
    assert not _program_files._ahead
    run(twice)
    assert readers[-1] == ("twice", True, "ahead")


def test_a_program_for_what_was_asked_last_time_is_let_go(readers: list[Any]):
    run(twice, thrice)
    lens = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
    with reading_ahead("a"):
        np.testing.assert_allclose(_programs.jit(twice)(lens, jnp.arange(3.0))[1], [0.0, 2.0, 4.0])
        assert [path.name.split("-")[0] for path in _program_files._ahead] == ["thrice"]
        _programs.forget_programs()
        assert not _program_files._ahead


def test_what_is_asked_for_twice_lets_go_of_nothing(readers: list[Any]):
    lens = thin_lens(focus_distance=2.0, f_number=2.8, focal_length=0.05)
    one, three = jnp.array(5.0), jnp.arange(3.0)
    for _ in range(2):
        readers.clear()
        with reading_ahead("a"):
            for future in list(_program_files._ahead.values()):
                future.result()
            for factor in (one, one, three):
                _programs.jit(twice)(lens, factor)
    assert readers == [("twice", True, "ahead"), ("twice", True, "ahead"), ("twice", True, "here")]


def test_threads_that_read_at_once_let_go_at_once(tmp_path: Path):
    """As layers are made: several threads ask for what is not there."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(20):
            with reading_ahead("nothing"), concurrent.futures.ThreadPoolExecutor(4) as pool:
                none: concurrent.futures.Future[Any] = concurrent.futures.Future()
                _program_files._ahead.update({tmp_path / f"cover-{number}": none for number in range(100)})
                list(pool.map(_program_files.read, [tmp_path / "cover-x"] * 4))
                assert not _program_files._ahead
    finally:
        sys.setswitchinterval(before)


def test_no_more_than_so_much_is_read_ahead(readers: list[Any], monkeypatch: pytest.MonkeyPatch):
    run(twice, thrice)
    (path,) = _program_files.kept_in().glob("twice*")
    monkeypatch.setattr(_program_files, "_MOST_AHEAD", path.stat().st_size)
    readers.clear()
    run(twice, thrice)
    assert readers == [("twice", True, "ahead"), ("thrice", True, "here")]


def test_names_of_commands_are_those_of_files(readers: list[Any]):
    run(twice, command=os.fsdecode(b"out\xff"))
    run(twice, command=os.fsdecode(b"out\xff"))
    assert readers[-1] == ("twice", True, "ahead")
