"""The reference of config keys, from the models that check them: `docs/reference/generated/config.rst`."""

import types
import typing
from collections.abc import Iterator

import annotated_types
from public_names import write
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx

from focusjax.config import Config


def tables(model: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every table of the config, with the key path that it has in a file."""
    yield path, model
    for key, field in model.model_fields.items():
        below, many = _tables_of(field.annotation)
        for each in below:
            yield from tables(each, f"{path}.{key}".lstrip(".") + ("[]" if many else ""))


def _tables_of(kind: object) -> tuple[list[type[BaseModel]], bool]:
    """The tables that a type holds, and whether it is an array of them."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return [kind], False
    found, many = [], typing.get_origin(kind) is tuple
    for part in typing.get_args(kind):
        below, array = _tables_of(part)
        found += [each for each in below if each not in found]
        many |= array
    return found, many


def kind_of(kind: object, metadata: tuple = ()) -> str:
    """A type in the words of TOML: number, text, array, with its limits."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return kind_of(parts[0], (*metadata, *parts[1:]))
    if origin in (types.UnionType, typing.Union):
        return " or ".join(dict.fromkeys(kind_of(each) for each in parts if each is not type(None)))
    if origin is typing.Literal:
        return ", ".join(
            f"``{str(each).lower() if isinstance(each, bool) else repr(each)}``" for each in parts
        )
    if origin is tuple:
        if parts[-1] is Ellipsis:
            return f"array of {kind_of(parts[0])}"
        return f"array of {len(parts)}: {kind_of(parts[0])}"
    if origin is dict:
        return f"table of {kind_of(parts[1])}"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return "table"
    word = {bool: "true or false", int: "whole number", float: "number", str: "text"}.get(kind, "value")
    return word + _limits(metadata)


def _limits(metadata: tuple) -> str:
    signs = {
        annotated_types.Gt: ">",
        annotated_types.Ge: "≥",
        annotated_types.Lt: "<",
        annotated_types.Le: "≤",
    }
    found = []
    for each in (part for one in metadata for part in getattr(one, "metadata", [one])):
        for sort, sign in signs.items():
            if isinstance(each, sort):
                found.append(f"{sign} {getattr(each, sort.__name__.lower()):g}")
    return f" {', '.join(found)}" if found else ""


def default_of(field: FieldInfo) -> str:
    """What is taken where the key is left out."""
    if field.is_required():
        return "*needed*"
    value = field.default
    if value is None or isinstance(value, BaseModel) or value == ():
        return ""
    if isinstance(value, tuple):
        value = list(value)
    return f"``{str(value).lower() if isinstance(value, bool) else value!r}``"


def page() -> str:
    """All tables with their keys."""
    lines = ["Keys of a config", "================", ""]
    lines += ["Lengths end in ``_m`` or ``_mm``, angles in ``_deg``, blur in ``_px``; dioptres are 1/m.", ""]
    seen: dict[type[BaseModel], str] = {}
    for path, model in tables(Config):
        name = "The whole file" if not path else (f"[[{path[:-2]}]]" if path.endswith("[]") else f"[{path}]")
        name = name.replace("[].", ".")
        if model in seen:
            lines += [f".. _config {path}:", "", name, "-" * len(name), "", f"The keys of {seen[model]}.", ""]
            continue
        seen[model] = name
        text = (model.__doc__ or "").split(": ", 1)[-1].split("\n\n")[0].replace("\n", " ").replace("`", "``")
        lines += [name, "-" * len(name), "", text[:1].upper() + text[1:], ""]
        lines += [".. list-table::", "   :header-rows: 1", "   :widths: 20 22 14 44", ""]
        lines += ["   * - key", "     - type", "     - default", "     - meaning"]
        for key, field in model.model_fields.items():
            meaning = (field.description or "").replace("`", "``").replace("*", r"\*")
            kind = kind_of(field.annotation, tuple(field.metadata))
            lines += [
                f"   * - ``{key}``",
                f"     - {kind}",
                f"     - {default_of(field)}",
                f"     - {meaning}",
            ]
        lines.append("")
    return "\n".join(lines)


def setup(app: Sphinx) -> dict[str, bool]:
    """Have the page written."""
    app.connect("builder-inited", lambda _: write("config.rst", page()))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
