"""All hard cases, one after another."""

import functools
from collections.abc import Callable, Iterator, Sequence

from focusjax._freed import return_programs
from focusjax.hard_cases import _glass, _pictures, _wishes
from focusjax.hard_cases._check import Check

Progress = Callable[[str, float | None], None]
"""Called with the name of the case that runs, and the share of all that is done."""


_CASES: dict[str, Callable[[], Iterator[Check]]] = {
    **{case.name: functools.partial(_wishes.wish_checks, case) for case in _wishes.CASES},
    "slopes of contradictory wishes": _wishes.slope_checks,
    **{f"glass, {name}": functools.partial(_glass.glass_checks, name) for name in _glass.HEIGHTS},
    **{case.name: functools.partial(_pictures.picture_checks, case) for case in _pictures.CASES},
}

NAMES = tuple(_CASES)
"""Of all cases, in the order in which they run."""


def hard_cases(names: Sequence[str] = NAMES, progress: Progress = lambda name, share: None) -> list[Check]:
    """What is looked at in the cases `names`, in float32 and float64, and how far each is off.

    Raises:
        ValueError: there is no such case.
        RuntimeError: Embree, by which pictures are judged, is not installed.
    """
    for name in names:
        if name not in _CASES:
            raise ValueError(f"there is no case {name!r}; the cases are {', '.join(NAMES)}")
    checks = []
    for number, name in enumerate(names):
        progress(name, number / len(names))
        checks += _CASES[name]()
        return_programs()
    return checks
