"""A table of overrides: a CSV file whose columns are keys of the config, a row for each item."""

import csv
from dataclasses import dataclass
from pathlib import Path

from focusjax.batch._errors import BatchError
from focusjax.batch._grid import Change
from focusjax.config import toml_value

_NAME = "name"


@dataclass(frozen=True)
class Row:
    """One row of a table.

    Attributes:
        name: what the `name` column says; "" where it says nothing.
        changes: keys and values; cells left empty are not among them.
        number: of the row as a spreadsheet counts, the header being 1.
    """

    name: str
    changes: tuple[Change, ...]
    number: int


def read_table(path: Path | str) -> list[Row]:
    """The rows of the CSV file at `path`.

    The header holds dotted keys of the config and, if you like, `name`. Cells are read as `--set` reads
    values: as TOML, or as plain text. An empty cell leaves the key as the config has it.

    Raises:
        BatchError: a file that cannot be read, has no rows, has a column twice or without a key, a row with
            more cells than there are columns, or a name given twice. The message names file, row, column.
    """
    path = Path(path)
    lines = _lines(path)
    header = [cell.strip() for cell in lines[0]] if lines else []
    if not header or not any(header):
        raise BatchError(f"{path}: row 1 has no keys; expected a header such as name,lens.f_number")
    for number, key in enumerate(header, start=1):
        if not key:
            raise BatchError(f"{path}: row 1, column {number} is empty; give a key such as lens.f_number")
        if header.count(key) > 1:
            raise BatchError(f"{path}: row 1 has {header.count(key)} columns {key}; keep one of them")
    rows: list[Row] = []
    for number, line in enumerate(lines[1:], start=2):
        cells = [cell.strip() for cell in line]
        if not any(cells):
            continue
        if len(cells) > len(header):
            raise BatchError(
                f"{path}: row {number} has {len(cells)} cells for {len(header)} columns; put quotes around"
                " values that hold commas"
            )
        given = {key: cell for key, cell in zip(header, cells, strict=False) if cell}
        name = given.pop(_NAME, "")
        for earlier in rows:
            if name and earlier.name == name:
                raise BatchError(
                    f"{path}: row {number}, column {_NAME}: {name!r} is the name of row {earlier.number} too;"
                    " give another"
                )
        rows.append(Row(name, tuple((key, toml_value(cell)) for key, cell in given.items()), number))
    if not rows:
        raise BatchError(f"{path}: there are no rows below the header; add one for each item")
    return rows


def _lines(path: Path) -> list[list[str]]:
    try:
        # Spreadsheets may begin the file with a byte order mark.
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return list(csv.reader(stream, strict=True))
    except FileNotFoundError:
        raise BatchError(f"{path}: there is no such table; check the path") from None
    except OSError as error:
        raise BatchError(f"{path}: the table cannot be read ({error.strerror}); check the path") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise BatchError(f"{path}: this is no CSV file in UTF-8 ({error}); save it as one") from None
