"""The JSON Schema of scenes, derived once, and whether a document conforms to it."""

from __future__ import annotations

import math
import re
from typing import Any

from mechviz.scene.scene import json_schema


def conforms(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    """The part of JSON Schema that ours uses."""
    if "$ref" in schema:
        target: Any = root
        for part in schema["$ref"].removeprefix("#/").split("/"):
            target = target[part]
        return conforms(value, target, root) and conforms(value, {k: v for k, v in schema.items() if k != "$ref"}, root)
    types = {"object": dict, "array": list, "string": str, "boolean": bool}
    kinds = schema.get("type", [])
    for kind in [kinds] if isinstance(kinds, str) else kinds:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if (number and (kind == "number" or (kind == "integer" and isinstance(value, int)))) or isinstance(
            value, types.get(kind, ())
        ):
            break
    else:
        if kinds:
            return False
    for key, among in (("anyOf", lambda n: n > 0), ("oneOf", lambda n: n == 1)):
        if key in schema and not among(sum(conforms(value, option, root) for option in schema[key])):
            return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, str):
        return re.search(schema.get("pattern", ""), value) is not None
    if isinstance(value, dict):
        named, extra = schema.get("properties", {}), schema.get("additionalProperties", True)
        names = schema.get("propertyNames", {})
        return (
            all(key in value for key in schema.get("required", []))
            and all(conforms(key, names, root) for key in value)
            and len(value) >= schema.get("minProperties", 0)
            and all(
                conforms(v, named[k], root) if k in named else extra if isinstance(extra, bool) else conforms(v, extra, root)
                for k, v in value.items()
            )
        )
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)):
            return False
        first = schema.get("prefixItems", [])
        return all(conforms(v, first[k] if k < len(first) else schema.get("items", {}), root) for k, v in enumerate(value))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return schema.get("minimum", -math.inf) <= value <= schema.get("maximum", math.inf) and value > schema.get(
            "exclusiveMinimum", -math.inf
        )
    return True


SCHEMA = json_schema()
