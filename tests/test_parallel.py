"""Work on several cores: in order, and by as many threads as there are cores, however it is nested."""

import threading

import pytest

from focusjax import _parallel
from focusjax._parallel import in_parallel, parts


def test_what_is_nested_is_done_by_the_thread_that_asks(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_parallel, "CORES", 3)

    def outer(number: int) -> tuple[int, list[int], set[int]]:
        def inner(part: int) -> tuple[int, int]:
            return 10 * number + part, threading.get_ident()

        found = in_parallel(inner, range(4))
        assert {thread for _, thread in found} == {threading.get_ident()}
        return threading.get_ident(), [value for value, _ in found], {thread for _, thread in found}

    found = in_parallel(outer, range(8))
    assert [values for _, values, _ in found] == [[10 * k + part for part in range(4)] for k in range(8)]
    assert threading.get_ident() not in {thread for thread, _, _ in found}
    assert len({thread for thread, _, _ in found}) <= 3


def test_one_thing_leaves_the_cores_to_what_it_does_itself(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(_parallel, "CORES", 2)
    both = threading.Barrier(2, timeout=20)

    def outer(_: str) -> list[int]:
        # Each waits until the other is there, so that one thread alone would not get past it.
        return in_parallel(lambda _: both.wait(), range(2))

    assert sorted(in_parallel(outer, ["alone"])[0]) == [0, 1]


def test_parts_make_up_the_whole():
    assert parts(7, 3) == [slice(0, 3), slice(3, 6), slice(6, 7)]
    assert parts(0, 3) == []
