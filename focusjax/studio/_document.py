"""The text of a config while it is edited: comments and unknown order kept, with undo and redo."""

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Array, InlineTable

from focusjax._whole_file import replace_file
from focusjax.config import Config, ConfigError, parse_config, refuse_close_focus
from focusjax.studio._files_named import name_files_from
from focusjax.studio._kept import keep_text, kept_file, kept_text

Change = Callable[[tomlkit.TOMLDocument], None]


class EditError(ValueError):
    """An edit that would leave no usable config; the config stays as it was."""


class Document:
    """A config's text and its history.

    Every text in the history but the first is a config that can be used.

    Attributes:
        path: the file it is read from and saved to; relative paths in it start there.
        new: whether there is no such file yet.
        recovered: whether the text is one that was not saved before the program ended.
        text: as it is now.
        config: what the text says; None where it cannot be used.
        problem: why it cannot be used, in one sentence; empty where it can.
    """

    def __init__(self, path: Path, *, root: Path | None = None, text: str | None = None):
        """Read the config at `path`, whose files lie below `root` (see `load_config`).

        What was kept of changes that were never saved is taken up again: one `undo` goes back to the file.

        Args:
            path: a file.
            root: the folder below which its files lie.
            text: of a new config, for which there is no file yet.

        Raises:
            ConfigError: the file cannot be read as text.
        """
        self.path, self._root = path, root
        self.new = text is not None
        self.text = self._on_disk = _read(path) if text is None else text
        self._done: list[str] = []
        self._undone: list[str] = []
        self._label = ""
        self.config: Config | None = None
        self.problem = ""
        kept = kept_text(path)
        self.recovered = kept is not None and kept != self.text
        if kept is not None and self.recovered:
            self._done.append(self.text)
            self.text = kept
        self._look_at_text()

    @property
    def unsaved(self) -> bool:
        """Whether the text differs from the file as it was last read or written."""
        return self.new or self.text != self._on_disk

    def keep(self) -> None:
        """Keep the text for the next time `path` is opened, should the program end before it is saved.

        Raises:
            EditError: the folder cannot be written to.
        """
        try:
            keep_text(self.path, self.text if self.text != self._on_disk else None)
        except OSError as error:
            raise EditError(
                f"{kept_file(self.path)}: changes cannot be kept there ({error.strerror}); save them to"
                " another folder before you stop the command"
            ) from None

    @property
    def can_undo(self) -> bool:
        """Whether there is an edit to take back."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether there is an edit that was taken back."""
        return bool(self._undone)

    def edit(self, change: Change, label: str = "") -> None:
        """Apply `change` to the tables; comments, order and unknown keys stay as they are.

        Args:
            change: changes the tables in place.
            label: edits in a row with the same label, such as those of one drag, are undone together.

        Raises:
            EditError: there would be no usable config afterwards; nothing is changed.
        """
        try:
            tables = tomlkit.parse(self.text)
            change(tables)
            text = tomlkit.dumps(tables)
            kept = tomllib.loads(text) == tables.unwrap()
        except (TOMLKitError, ValueError, LookupError) as error:
            raise EditError(
                f"{self.path}: this edit cannot be written as TOML ({error}); write inline tables, such as"
                " lens = {...}, as tables of their own, such as [lens]"
            ) from None
        if not kept:
            raise EditError(
                f"{self.path}: the order of its tables leaves this edit no place; put all [[focus]] tables"
                " together, and all of [lens] and of [solve]"
            )
        self.replace(text, label)

    def replace(self, text: str, label: str = "") -> None:
        """Take another text as a whole.

        Raises:
            EditError: it is no usable config; nothing is changed.
        """
        try:
            config = self._usable(text)
        except ConfigError as error:
            raise EditError(str(error)) from None
        if text == self.text:
            return
        if not (label and label == self._label):
            self._done.append(self.text)
        self._label = label
        self._undone.clear()
        self.text, self.config, self.problem = text, config, ""

    def end_label(self) -> None:
        """The next edit is undone by itself, whatever its label."""
        self._label = ""

    def undo(self) -> None:
        """Take the last edit back; nothing happens where there is none."""
        self._step(self._done, self._undone)

    def redo(self) -> None:
        """Do again what was taken back; nothing happens where there is nothing."""
        self._step(self._undone, self._done)

    def save(self, *, even_if_changed: bool = False) -> None:
        """Write the text to the file, which has all of the old or all of the new text at any time.

        Args:
            even_if_changed: write over what someone else wrote to the file meanwhile.

        Raises:
            EditError: the file has changed since it was read, or cannot be written, or there is no usable
                config to write.
        """
        if self.config is None:
            raise EditError(self.problem)
        try:
            changed = self.path.exists() and (self.new or _read(self.path) != self._on_disk)
            if not even_if_changed and changed:
                raise EditError(
                    f"{self.path}: the file was changed by something else since it was opened; save again to"
                    " write over it, or open it anew"
                )
            replace_file(self.path, self.text)
            keep_text(self.path, None)
        except OSError as error:
            raise EditError(
                f"{self.path}: the file cannot be written ({error.strerror}); save it somewhere else"
            ) from None
        self._on_disk, self.new = self.text, False

    def save_as(self, path: Path, *, even_if_there: bool = False) -> None:
        """Save to another file, which is the document's from then on; the files it names stay where they are.

        Args:
            path: of the config; the suffix .toml is added where there is none.
            even_if_there: write over a file that is there.

        Raises:
            EditError: there is a file of that name, the config could not name its files from there, or it
                cannot be written; the document stays as it was.
        """
        path = path if path.suffix == ".toml" else path.with_name(f"{path.name}.toml")
        if self.config is None:
            raise EditError(self.problem)
        if path.resolve() == self.path.resolve():
            self.save(even_if_changed=even_if_there)
            return
        if path.exists() and not even_if_there:
            raise EditError(
                f"{path}: there is a file of that name; choose another, or save again to replace it"
            )
        if not path.parent.is_dir():
            raise EditError(f"{path}: there is no folder {path.parent}; make it, or choose another")
        tables = tomlkit.parse(self.text)
        root = path.parent if self._root is None else self._root
        outside = name_files_from(tables, self.path.parent, path.parent, root)
        if outside:
            raise EditError(
                f"{path}: a config there may not name {outside}, which lies outside {root}; save it beside or"
                " above its files, or start the studio with --root DIR"
            )
        old = self.path, self.text, self._on_disk, self.new
        self.path, self.text, self.new = path, tomlkit.dumps(tables), False
        try:
            self._look_at_text()
            self.save(even_if_changed=True)
        except EditError:
            self.path, self.text, self._on_disk, self.new = old
            self._look_at_text()
            raise
        keep_text(old[0], None)
        self._done.clear()
        self._undone.clear()

    def _step(self, source: list[str], target: list[str]) -> None:
        if source:
            target.append(self.text)
            self.text, self._label = source.pop(), ""
            self._look_at_text()

    def _usable(self, text: str) -> Config:
        config = parse_config(text, self.path, root=self._root)
        refuse_close_focus(config, "the studio")
        return config

    def _look_at_text(self) -> None:
        try:
            self.config, self.problem = self._usable(self.text), ""
        except ConfigError as error:
            self.config, self.problem = None, str(error)


def set_value(*keys: str, value: Any) -> Change:
    """A change that sets one value, making the tables on the way; None removes it."""

    def change(tables: tomlkit.TOMLDocument) -> None:
        place: Any = tables
        for key in keys[:-1]:
            if key not in place:
                if value is None:
                    return
                place[key] = tomlkit.table()
            place = place[key]
        put(place, keys[-1], value)

    return change


def together(*changes: Change) -> Change:
    """Several changes as one."""

    def change(tables: tomlkit.TOMLDocument) -> None:
        for each in changes:
            each(tables)

    return change


def add_row(*keys: str, row: dict[str, Any]) -> Change:
    """A change that adds a table after the others of an array, such as "focus" for `[[focus]]`."""

    def change(tables: tomlkit.TOMLDocument) -> None:
        *outer, last = keys
        place = _at(tables, outer)
        rows: Any = place.get(last)
        if isinstance(rows, Array):
            rows.append(inline_table(row))
            return
        table = tomlkit.table()
        for key, value in row.items():
            table.add(key, value)
        if rows is None or not isinstance(rows, AoT):
            place.add(tomlkit.nl())
            place[last] = rows = tomlkit.aot()
        else:
            blank_line_after(rows)
        table.add(tomlkit.nl())
        rows.append(table)

    return change


def change_row(*keys: str, number: int, row: dict[str, Any], without: Sequence[str] = ()) -> Change:
    """A change of one table of an array: keys to set, None to remove, and others to remove."""

    def change(tables: tomlkit.TOMLDocument) -> None:
        table = _at(tables, keys)[number]
        for key, value in (dict.fromkeys(without) | row).items():
            put(table, key, value)

    return change


def delete_row(*keys: str, number: int) -> Change:
    """A change that removes one table of an array."""

    def change(tables: tomlkit.TOMLDocument) -> None:
        *outer, last = keys
        place = _at(tables, outer)
        del place[last][number]
        if not len(place[last]):
            del place[last]

    return change


def inline_table(row: dict[str, Any]) -> InlineTable:
    """The table in braces, such as `{frame = 1, blur = 2.0}`."""
    table = tomlkit.inline_table()
    table.update(row)
    return table


def blank_line_after(rows: AoT) -> None:
    """A table that follows the others of an array does so after a blank line."""
    last = rows[-1]
    if not last.as_string().endswith("\n\n"):
        last.add(tomlkit.nl())


def put(table: Any, key: str, value: Any) -> None:
    """Set a key; None removes it."""
    if value is not None:
        table[key] = value
    elif key in table:
        del table[key]


def _at(tables: tomlkit.TOMLDocument, keys: Sequence[str]) -> Any:
    place: Any = tables
    for key in keys:
        place = place[key]
    return place


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such config file; check the path") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: this is not text in UTF-8; give a TOML file") from None
    except OSError as error:
        raise ConfigError(f"{path}: the config cannot be read ({error.strerror}); check the path") from None
