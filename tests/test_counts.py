"""Counts are whole numbers from 1 on, whatever type they come in."""

import numpy as np
import pytest

from focusjax._counts import require_counts


def test_whole_numbers_and_what_was_not_given_pass():
    assert require_counts(rays=1, count=np.int64(7), levels=None) is None


@pytest.mark.parametrize(("value", "shown"), [(0, "0"), (-3, "-3"), (2.5, "2.5"), (2.0, "2.0"), ("4", "'4'")])
def test_everything_else_is_refused_by_name(value: object, shown: str):
    with pytest.raises(ValueError, match=f"rays is {shown}; expected a whole number, at least 1"):
        require_counts(layers=3, rays=value)
