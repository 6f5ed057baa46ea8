"""A batch in a file: a TOML file with a `[batch]` table."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, Strict, ValidationError

from focusjax.batch._grid import toml_text
from focusjax.batch._items import Item, make_items
from focusjax.config import ConfigError, Table, read_toml, sentence_for


class BatchTable(Table):
    """`[batch]`: configs, and what to change about them."""

    configs: Annotated[tuple[str, ...], Strict(False), Field(min_length=1)] = Field(
        description="configs' paths, relative to this file"
    )
    table: str | None = Field(default=None, description="a CSV file's path, relative to this file")
    grid: dict[str, Any] = Field(
        default={}, description='a [batch.grid] table with lists of values, such as "lens.f_number" = [2, 4]'
    )
    set: dict[str, Any] = Field(
        default={}, description='a [batch.set] table with values for all items, such as "render.rays" = 16'
    )


class BatchFile(Table):
    """The whole file."""

    batch: BatchTable = Field(description="a [batch] table with configs")


def is_batch_file(path: Path) -> bool:
    """Whether the TOML file at `path` describes a batch, not a run.

    Raises:
        ConfigError: a file that cannot be read.
    """
    return "batch" in read_toml(path)


def items_from_file(
    path: Path | str, overrides: tuple[str, ...] = (), *, root: Path | None = None
) -> list[Item]:
    """The items that a file with a `[batch]` table describes.

    Args:
        path: a TOML file; paths in it are relative to it.
        overrides: `key=value` texts for all items; they come after those of the file.
        root: as `make_items` takes it.

    Raises:
        ConfigError: a key or a value of the file that is wrong; and as `make_items`.
        BatchError: as `make_items`.
    """
    path = Path(path)
    try:
        table = BatchFile.model_validate(read_toml(path)).batch
    except ValidationError as error:
        raise ConfigError(sentence_for(error, BatchFile, path)) from None
    axes = dict(_dotted(table.grid))
    for key, values in axes.items():
        if not isinstance(values, list):
            raise ConfigError(
                f"{path}: batch.grid.{key} is {toml_text(values)}; expected a list of values, such as"
                f" [{toml_text(values)}]"
            )
    return make_items(
        [path.parent / config for config in table.configs],
        grid=axes,
        table=None if table.table is None else path.parent / table.table,
        overrides=[*(f"{key}={toml_text(value)}" for key, value in _dotted(table.set)), *overrides],
        root=root,
    )


def _dotted(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and values; TOML makes tables of dotted keys without quotes."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _dotted(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
