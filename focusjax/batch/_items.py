"""The items of a batch: what each is called, and what it changes about its config."""

import hashlib
import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from focusjax.batch._errors import BatchError
from focusjax.batch._folder import SUMMARY_FILES
from focusjax.batch._grid import Change, check_grid, shown, toml_text
from focusjax.batch._table import Row, read_table
from focusjax.config import Config, ConfigError, load_config

_LONGEST = 120
"""Bytes; file systems allow 255, and temporary names need some."""
_TAKEN = {"", *SUMMARY_FILES}


@dataclass(frozen=True)
class Item:
    """One thing to do.

    Attributes:
        name: of its folder; no two items of a batch have the same.
        config: checked, with everything changed that is to be changed.
        changes: what the grid and the table changed, in this order: table, grid.
    """

    name: str
    config: Config
    changes: tuple[Change, ...] = ()


@dataclass(frozen=True)
class _Plan:
    """An item before its config is read.

    Attributes:
        path: of the config.
        changes: keys and values.
        origins: where each change was asked for, as messages name it.
        label: the name it would like to have.
    """

    path: Path
    changes: tuple[Change, ...]
    origins: tuple[str, ...]
    label: str


def make_items(
    configs: Sequence[Path | str],
    *,
    grid: Mapping[str, Sequence[Any]] | None = None,
    table: Path | str | None = None,
    overrides: Sequence[str] = (),
    root: Path | None = None,
) -> list[Item]:
    """Every config with every row of the table and every point of the grid, all of them checked.

    An item is named after its config and what it changes, `still_life,lens.f_number=2`, or as the table's
    `name` column says. Names stay the same when other items come or go.

    Args:
        configs: TOML files.
        grid: values for each of some dotted config keys; all combinations are made.
        table: a CSV file, see `read_table`.
        overrides: `key=value` texts that go for all items, as `load_config` takes them.
        root: the folder below which files must lie that the configs name; see `load_config`.

    Raises:
        ConfigError: a config, or an override for all items, that is wrong by itself.
        BatchError: a cell, a row or a grid value that is wrong; or two items that are the same.

    Example:
        >>> items = make_items(["configs/still_life.toml"], grid={"focus.1.blur_px": [10, 20]})
        >>> [item.name for item in items]
        ['still_life,focus.1.blur_px=10', 'still_life,focus.1.blur_px=20']
    """
    if not configs:
        raise BatchError("there are no configs; give at least one TOML file")
    axes = dict(grid or {})
    check_grid(axes)
    rows = [Row("", (), 0)] if table is None else read_table(table)
    for row in rows:
        for key, _ in row.changes:
            if key in axes:
                raise BatchError(
                    f"{table}: column {key} is also in the grid; give the key in one of the two places"
                )
    paths = [Path(path) for path in configs]
    plans = [
        _plan(path, row, point, table, several=len(paths) > 1)
        for path in paths
        for row in rows
        for point in itertools.product(*([(key, value) for value in axes[key]] for key in axes))
    ]
    names = safe_names([plan.label for plan in plans], [_identity(plan) for plan in plans])
    _refuse_twins(names, plans)
    return [
        Item(name, _load(plan, overrides, root), plan.changes)
        for name, plan in zip(names, plans, strict=True)
    ]


def _plan(
    path: Path, row: Row, point: tuple[Change, ...], table: Path | str | None, *, several: bool
) -> _Plan:
    parts = [path.stem] if several or not row.name else []
    parts += [row.name] if row.name else [_part(change) for change in row.changes]
    parts += [_part(change) for change in point]
    origins = [f"{table}: row {row.number}, column {key}" for key, _ in row.changes]
    origins += [f"--grid {key}={toml_text(value)}" for key, value in point]
    return _Plan(path, (*row.changes, *point), tuple(origins), ",".join(parts))


def _part(change: Change) -> str:
    """A change as part of a name, where commas stand between changes."""
    key, value = change
    return f"{key}={shown(value)}" if isinstance(value, str) else f"{key}={_plain(toml_text(value))}"


def _plain(text: str) -> str:
    """`[0, 2]` as `0_2`."""
    return "_".join(re.findall(r"[^][{}\", ]+", text))


def _identity(plan: _Plan) -> str:
    """A text that identifies a plan, wherever it is asked for."""
    return "\n".join([str(plan.path.resolve()), plan.label, *map(_override, plan.changes)])


def _override(change: Change) -> str:
    return f"{change[0]}={toml_text(change[1])}"


def safe_names(wanted: Sequence[str], identities: Sequence[str]) -> list[str]:
    """A folder name for each of the `wanted` names, like it if possible.

    What not every file system takes becomes "_". A name that is too long, that is like another's, or of
    which nothing is left, ends in eight digits of a hash of its identity. So a name depends on nothing but
    the item itself, unless two items want the same.

    Args:
        wanted: one name per item.
        identities: what makes each item what it is.

    Example:
        >>> safe_names(["town,lens.f_number=2", "a b?"], ["1", "2"])
        ['town,lens.f_number=2', 'a_b']
    """
    cleaned = [re.sub(r"[^\w.,=+-]+", "_", name).strip("._-, ") for name in wanted]
    # Some file systems do not distinguish capitals from small letters.
    times = Counter(name.casefold() for name in cleaned)
    return [
        name
        if times[name.casefold()] == 1 and name.casefold() not in _TAKEN and len(name.encode()) <= _LONGEST
        else _hashed(name, identity)
        for name, identity in zip(cleaned, identities, strict=True)
    ]


def _hashed(name: str, identity: str) -> str:
    digits = hashlib.sha256(identity.encode()).hexdigest()[:8]
    head = name.encode()[: _LONGEST - 9].decode(errors="ignore").rstrip("._-, ")
    return f"{head}-{digits}" if head else digits


def _refuse_twins(names: Sequence[str], plans: Sequence[_Plan]) -> None:
    first: dict[str, _Plan] = {}
    for name, plan in zip(names, plans, strict=True):
        twin = first.setdefault(name.casefold(), plan)
        if twin is not plan:
            where = " and ".join(_where(each) for each in (twin, plan))
            raise BatchError(f"two items are the same, {name}: {where}; leave one of them out")


def _where(plan: _Plan) -> str:
    """The place a plan comes from: the row of the table if there is one, or else the config."""
    return plan.origins[0].split(", column ")[0] if plan.origins else str(plan.path)


def _load(plan: _Plan, overrides: Sequence[str], root: Path | None) -> Config:
    """The config of `plan`; the message of an error names what is to blame for it."""
    changes = [_override(change) for change in plan.changes]

    def attempt(count: int) -> Config:
        return load_config(plan.path, [*overrides, *changes[:count]], root=root)

    try:
        return attempt(len(changes))
    except ConfigError as failure:
        error = earlier = failure
    # The change to blame is the first after which there is no way back to a config that is right.
    for count in reversed(range(len(changes))):
        try:
            attempt(count)
        except ConfigError as failure:
            earlier = failure
        else:
            text = str(error).removeprefix(f"--set {changes[count]}: ")
            raise BatchError(f"{plan.origins[count]}: {text}")
    # Without any change it is wrong as well: either in itself, or for want of what the changes give.
    if str(earlier) == str(error):
        raise error
    raise BatchError(f"{_where(plan)}: {error}")
