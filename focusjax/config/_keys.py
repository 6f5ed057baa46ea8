"""Every key that a config may have, from the models that check it."""

import dataclasses
import json
import math
import re
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, BeforeValidator
from pydantic.fields import FieldInfo

from focusjax._words import did_you_mean
from focusjax.config._errors import ConfigError, models_in
from focusjax.config._load import Config
from focusjax.config._values import seconds_of

_ENDINGS = {
    "_per_m": "1/m",
    "_cd_m2": "cd/m²",
    "_35mm": "mm",
    "_mm": "mm",
    "_um2": "µm²",
    "_um": "µm",
    "_nm": "nm",
    "_waves": "waves",
    "_m": "m",
    "_px": "px",
    "_deg": "°",
    "_height": "image heights",
    "_stops": "stops",
    "_ev": "EV",
}
_PHRASES = {
    "in metres": "m",
    "in pixels": "px",
    "in px": "px",
    "pixels": "px",
    "in mm": "mm",
    "degrees": "°",
    "in seconds": "s",
    "longest time": "s",
    "shortest time": "s",
    "seconds": "s",
    "in stops": "stops",
    "how many stops": "stops",
    "dioptres": "1/m",
    "in electrons": "electrons",
    "the electrons": "electrons",
}
"""Of descriptions of numbers whose keys do not end in their unit; the first that is found counts."""
_KIND = "which kind of table it is"
"""What keys without a description are: each says which table of several it is in."""
_OF_FILES = {"shot.frames"}
"""Keys that must be there when all is read, but that the stage of an empty table gives."""
_WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text"}


@dataclasses.dataclass(frozen=True)
class ConfigKey:
    """A key of a config.

    Attributes:
        table: the dotted path of its table, such as "lens.aperture"; "" for the config itself.
        heading: how the table is written, such as "[lens.aperture]" or "[[focus]]".
        variant: of tables that are of several kinds the key that says which, such as 'shape = "disk"'; or "".
        about: what the table is for.
        name: the key.
        type: what its value may be, such as "number > 0" or '"png" or "exr"'.
        unit: of its numbers; "" where they have none.
        required: whether it has to be given.
        default: the value as TOML when it is left out; "" where there is none.
        meaning: what it is.
    """

    table: str
    heading: str
    variant: str
    about: str
    name: str
    type: str
    unit: str
    required: bool
    default: str
    meaning: str

    @property
    def path(self) -> str:
        """The dotted path of the key, such as "lens.aperture.blades"."""
        return f"{self.table}.{self.name}" if self.table else self.name


def config_keys(path: str = "") -> list[ConfigKey]:
    """The keys of a table and of the tables in it, or one key; all of a config's by default.

    Args:
        path: a table's or key's dotted path, with or without its brackets, such as "lens" or "focus.blur_px".

    Raises:
        ConfigError: nothing has that path.

    Example:
        >>> [key.name for key in config_keys("lens.aperture") if key.required]
        ['shape', 'shape', 'blades', 'shape', 'file']
        >>> (key,) = config_keys("lens.focus_distance_m")
        >>> key.type, key.unit, key.default
        ('number > 0', 'm', '')
    """
    wanted = path.strip().strip("[]")
    keys = list(_keys_of(Config, "", "", ""))
    if not wanted:
        return keys
    found = [key for key in keys if f"{key.table}.".startswith(f"{wanted}.")]
    found = found or [key for key in keys if key.path == wanted]
    if not found:
        tables = list(dict.fromkeys(key.table for key in keys if key.table))
        near = did_you_mean(wanted, [*tables, *(key.path for key in keys)], "")
        known = near or f"there are {', '.join(dict.fromkeys(name.split('.')[0] for name in tables))}"
        raise ConfigError(f"no table or key of a config is called {wanted}; {known}")
    return found


def _keys_of(model: type[BaseModel], table: str, heading: str, variant: str) -> Iterator[ConfigKey]:
    """The keys of one table, and then those of the tables in it."""
    about = " ".join((model.__doc__ or "").split("\n\n")[0].split())
    inner: list[tuple[str, FieldInfo]] = []
    for python_name, field in model.model_fields.items():
        # `from` is none that Python can name.
        name = field.alias or python_name
        if models_in(field.annotation):
            inner.append((name, field))
        yield ConfigKey(
            table=table,
            heading=heading or "the top of the config",
            variant=variant,
            about=about,
            name=name,
            type=_type_text(field.annotation, field.metadata),
            unit=_unit(name, field),
            required=field.is_required() and f"{table}.{name}" not in _OF_FILES,
            default=_default(field),
            meaning=field.description or _KIND,
        )
    for name, field in inner:
        path = f"{table}.{name}" if table else name
        models = models_in(field.annotation)
        several = _holds(field.annotation, tuple)
        for each in models:
            kind = _variant(each) if len(models) > 1 else ""
            yield from _keys_of(each, path, f"[[{path}]]" if several else f"[{path}]", kind)


def _holds(annotation: Any, kind: type) -> bool:
    return get_origin(annotation) is kind or any(_holds(each, kind) for each in get_args(annotation))


def _variant(model: type[BaseModel]) -> str:
    """The key and value by which a table of several kinds is known."""
    for name, field in model.model_fields.items():
        if get_origin(field.annotation) is Literal:
            return f"{name} = {json.dumps(get_args(field.annotation)[0])}"
    return ""


def _type_text(annotation: Any, metadata: Any = ()) -> str:
    """What a value may be, in words."""
    limits = _limits(metadata)
    if any(isinstance(each, BeforeValidator) and each.func is seconds_of for each in metadata):
        return f'number{limits} or text such as "1/60"'
    origin, arguments = get_origin(annotation), get_args(annotation)
    if annotation in _WORDS:
        return _WORDS[annotation] + limits
    if origin is Literal:
        return " or ".join(json.dumps(each) for each in arguments)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "table"
    if hasattr(annotation, "__metadata__"):
        return _type_text(arguments[0], [*annotation.__metadata__, *metadata])
    if origin is tuple:
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            of = _type_text(arguments[0])
            return "tables" if set(of.split(" or ")) == {"table"} else f"array of: {of}"
        of = [_type_text(each) for each in arguments]
        return f"array of {len(of)}: {of[0]}" if len(set(of)) == 1 else f"[{', '.join(of)}]"
    if origin is dict:
        return f"table of: {_type_text(arguments[1])}"
    parts = [_type_text(each, metadata) for each in arguments if each is not type(None)]
    return " or ".join(dict.fromkeys(parts))


def _limits(metadata: Any) -> str:
    """Bounds as " from 0 to 1" or " >= 0, < 90"."""
    flat = [
        inner for each in metadata for inner in (each.metadata if isinstance(each, FieldInfo) else [each])
    ]
    bounds = {
        sign: getattr(each, kind.__name__.lower())
        for kind, sign in ((Gt, ">"), (Ge, ">="), (Lt, "<"), (Le, "<="))
        for each in flat
        if isinstance(each, kind)
    }
    if set(bounds) == {">=", "<="}:
        return f" from {_number(bounds['>='])} to {_number(bounds['<='])}"
    return f" {', '.join(f'{sign} {_number(bound)}' for sign, bound in bounds.items())}" if bounds else ""


def _number(value: Any) -> str:
    return str(value) if isinstance(value, int) else f"{value:.15g}"


def _unit(name: str, field: FieldInfo) -> str:
    kinds = _type_text(field.annotation, field.metadata)
    if "number" not in kinds or models_in(field.annotation):
        return ""
    for ending, unit in _ENDINGS.items():
        if name.endswith(ending):
            return unit
    if "whole number" in kinds:
        return "px" if "in pixels" in (field.description or "") else ""
    for phrase, unit in _PHRASES.items():
        if re.search(rf"\b{phrase}\b", field.description or ""):
            return unit
    return ""


def _default(field: FieldInfo) -> str:
    """The value as TOML, "" where there is none or it is a table."""
    if field.is_required() or field.default is None or isinstance(field.default, BaseModel):
        return ""
    return _toml(field.default)


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(each) for each in value)}]"
    if isinstance(value, float):
        return "inf" if math.isinf(value) else _number(value)
    return json.dumps(value)
