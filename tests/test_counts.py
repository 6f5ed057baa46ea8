"""Counts are whole numbers from 1 on, whatever type they come in."""

import numpy as np
import pytest

from focusjax._arguments import ArgumentError
from focusjax._counts import later_seed, require_counts, require_seed


def test_whole_numbers_pass():
    assert require_counts(rays=1, count=np.int64(7)) is None
    assert require_seed(0) == 0
    assert later_seed(2**32 - 1, 3) == 2


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0, "0"), (-3, "-3"), (2.5, "2.5"), (2.0, "2.0"), ("4", "'4'"), (None, "None"), (True, "True")],
)
def test_everything_else_is_refused_by_name(value: object, shown: str):
    with pytest.raises(ArgumentError, match=f"rays is {shown}; expected a whole number, at least 1"):
        require_counts(layers=3, rays=value)


@pytest.mark.parametrize(("value", "shown"), [(-1, "-1"), (1.5, "1.5"), ("a", "'a'"), (None, "None")])
def test_seeds_are_whole_and_not_negative(value: object, shown: str):
    with pytest.raises(ArgumentError, match=f"seed is {shown}; expected a whole number from 0 to 4294967295"):
        require_seed(value)
