"""The JSON Schema of a config, by which editors complete and check TOML."""

import json
import math
from typing import Any

from focusjax.config._load import Config

_DRAFT = "http://json-schema.org/draft-04/schema#"
"""The newest that taplo, and so most editors, knows of for TOML."""
_FILLED = {"CameraTable": {"resolution"}, "Config": {"camera", "lens"}, "ShotTable": {"frames"}}
"""Keys that must be there when all is read, but may come from a photograph, a camera file or a stage."""
_SECONDS = {"type": "string", "pattern": r"^[0-9.eE+-]+(/[0-9.eE+-]+)?$"}
"""Shutter times as they are engraved, such as 1/60."""
_TIMES = {"time", "longest_time", "shortest_time", "travel_time"}


def json_schema() -> dict[str, Any]:
    """The schema of a config as JSON Schema, draft 4; it knows each key by itself, not how keys go together.

    Example:
        >>> json_schema()["properties"]["title"]["type"]
        'string'
    """
    made = Config.model_json_schema()
    definitions = made.pop("$defs")
    for name, table in {**definitions, "Config": made}.items():
        table["required"] = [key for key in table.get("required", ()) if key not in _FILLED.get(name, ())]
        for key in _TIMES & set(table["properties"]):
            field = table["properties"][key]
            kinds = field.pop("anyOf", None) or [{"type": field.pop("type"), **_bounds(field)}]
            field["anyOf"] = [*kinds, _SECONDS]
    whole = {"$schema": _DRAFT, **made, "title": "focusjax config", "definitions": definitions}
    return _draft_4(whole)


def schema_text() -> str:
    """The same as a JSON file."""
    return json.dumps(json_schema(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _bounds(field: dict[str, Any]) -> dict[str, Any]:
    """Takes the bounds out of a field."""
    return {key: field.pop(key) for key in ("minimum", "exclusiveMinimum") if key in field}


def _draft_4(node: Any) -> Any:
    """A schema of draft 2020-12, as pydantic makes it, in the words of draft 4."""
    if isinstance(node, list):
        return [_draft_4(each) for each in node]
    if not isinstance(node, dict):
        return node
    out = {key: _draft_4(value) for key, value in node.items() if key != "discriminator"}
    value = out.get("default", 0)
    if value is None or isinstance(value, dict) or (isinstance(value, float) and math.isinf(value)):
        # TOML has no null, and JSON no infinity; a table's defaults are those of its keys.
        del out["default"]
    if "anyOf" in out:
        out["anyOf"] = [each for each in out["anyOf"] if each != {"type": "null"}]
        if len(out["anyOf"]) == 1:
            out = {**out.pop("anyOf")[0], **out}
    if isinstance(out.get("const"), str | int | bool):
        out["enum"] = [out.pop("const")]
    if isinstance(out.get("prefixItems"), list):
        out["items"], out["additionalItems"] = out.pop("prefixItems"), False
    for end, word in (("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum")):
        if isinstance(out.get(word), int | float) and not isinstance(out.get(word), bool):
            out[end], out[word] = out[word], True
    if isinstance(out.get("$ref"), str):
        reference = {"$ref": out.pop("$ref").replace("#/$defs/", "#/definitions/")}
        # Beside a reference nothing counts.
        out = {"allOf": [reference], **out} if out else reference
    if out.get("required") == []:
        # Draft 4 wants a name in it.
        del out["required"]
    return out
