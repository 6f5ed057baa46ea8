"""One clear sentence out of a failed validation: file, key, value, what was expected, what to do."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from focusjax._words import nearest_name

_EXPECTED = {
    "bool_type": "true or false",
    "finite_number": "a finite number",
    "float_type": "a number",
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "int_type": "a whole number",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "dict_type": "a table",
    "model_attributes_type": "a table",
    "model_type": "a table",
    "string_type": "text in quotes",
    "too_long": "at most {max_length} entries",
    "too_short": "at least {min_length} entries",
    "tuple_type": "an array in brackets",
}


class ConfigError(ValueError):
    """A config file, or an override of one of its keys, cannot be used as it is."""


@contextmanager
def located(source: Path, key: str = "") -> Iterator[None]:
    """A `ValueError` inside becomes a `ConfigError` that names the file, and the key where one is given."""
    try:
        yield
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{source}: {key}: {error}" if key else f"{source}: {error}") from error


@contextmanager
def about_key(key: str) -> Iterator[None]:
    """A `ValueError` inside names the key."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error


def sentence_for(error: ValidationError, model: type[BaseModel], source: Path) -> str:
    """The first problem in `error`; an unknown key comes first, since it often explains a missing one."""
    details = sorted(error.errors(), key=lambda item: item["type"] != "extra_forbidden")
    first = details[0]
    # A value that may be of several kinds fails as each of them; the deepest failure knows most.
    key = key_path(_resolve(model, first["loc"])[0])
    kin = [item for item in details if key_path(_resolve(model, item["loc"])[0]).startswith(key)]
    deepest = max(kin, key=lambda item: len(_resolve(model, item["loc"])[0]))
    return f"{source}: {_describe(deepest, model)}"


def key_path(location: Sequence[str | int]) -> str:
    """A location as the dotted path that `--set` takes."""
    return ".".join(str(step) for step in location)


def _describe(detail: ErrorDetails, model: type[BaseModel]) -> str:
    location, field, siblings = _resolve(model, detail["loc"])
    key = key_path(location) or "the config"
    remedy = f"; give {field.description}" if field is not None and field.description else ""
    kind = detail["type"]
    if kind == "extra_forbidden":
        close = nearest_name(str(location[-1]), siblings)
        hint = f"did you mean {close}?" if close else f"known keys here are {', '.join(siblings)}"
        return f"unknown key {key}; {hint}"
    if kind == "missing":
        return f"{key} is missing{remedy}"
    if kind == "value_error":
        return f"{key} {detail['msg'].removeprefix('Value error, ')}"
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        context = detail.get("ctx", {})
        tag = str(context.get("discriminator", "")).strip("'")
        has = (
            f"has {tag} = {_shown(detail['input'][tag])}" if kind == "union_tag_invalid" else f"has no {tag}"
        )
        return f"{key} {has}{remedy}"
    return f"{key} is {_shown(detail['input'])}; expected {_expected(detail)}{remedy}"


def _expected(detail: ErrorDetails) -> str:
    """What pydantic wanted, in the words of a person who writes TOML."""
    template = _EXPECTED.get(detail["type"])
    if template is None:
        return detail["msg"].removeprefix("Input should be ").replace("True", "true")
    return template.format(**detail.get("ctx", {}))


def _resolve(
    model: type[BaseModel], location: tuple[int | str, ...]
) -> tuple[list[int | str], FieldInfo | None, list[str]]:
    """Follow `location` through the models: the keys a person wrote, the field, its siblings' names.

    Pydantic's locations also hold the tags of unions, which are no keys of the file.
    """
    models, field = [model], None
    written: list[int | str] = []
    siblings: list[str] = list(_fields(model))
    for position, step in enumerate(location):
        found = [_fields(m)[step] for m in models if isinstance(step, str) and step in _fields(m)]
        if found:
            siblings = [name for m in models for name in _fields(m)]
            field = found[0]
            models = [inner for each in found for inner in models_in(each.annotation)]
            written.append(step)
        elif isinstance(step, int):
            written.append(step)
        elif position == len(location) - 1 and models:
            siblings = [name for m in models for name in _fields(m)]
            field = None
            written.append(step)
        else:
            models = [m for m in models if step in _tags(m)] or models
    return written, field, siblings


def _fields(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """A model's fields by the keys of the file: `from` is none that Python can name."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """The models of tables that a field may hold, in their order."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in models_in(argument)]


def _tags(model: type[BaseModel]) -> set[str]:
    """The literal texts that identify `model` in a union."""
    arguments = [argument for field in model.model_fields.values() for argument in get_args(field.annotation)]
    return {argument for argument in arguments if isinstance(argument, str)}


def _shown(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
