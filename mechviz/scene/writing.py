"""Scenes as TOML text, laid out as a person would write it: one line for each link and joint where it fits."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_LONGEST_LINE = 118


def toml_text(data: Mapping[str, Any]) -> str:
    """Nested tables, lists, texts, numbers and flags -> TOML. Floats are written so that they read back bit for bit."""
    plain = {key: value for key, value in data.items() if not _is_section(key, value)}
    lines = [f"{key_text(key)} = {value_text(value)}" for key, value in plain.items()]
    for name, section in data.items():
        if _is_section(name, section):
            lines += ["", *_section(name, section)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _is_section(key: str, value: Any) -> bool:
    return isinstance(value, Mapping) and key != "units"  # units read best on one line, at the top


def _section(name: str, section: Mapping[str, Any]) -> list[str]:
    """A table of one line for each entry; where one is too long, a table for each entry, which keeps their order."""
    lines = [f"{key_text(key)} = {value_text(value)}" for key, value in section.items()]
    if all(len(line) <= _LONGEST_LINE or not isinstance(section[key], Mapping) for line, key in zip(lines, section, strict=True)):
        return [f"[{key_text(name)}]", *lines]
    plain = [line for line, value in zip(lines, section.values(), strict=True) if not isinstance(value, Mapping)]
    out: list[str] = [f"[{key_text(name)}]", *plain, ""] if plain else []
    for key, value in section.items():
        if not isinstance(value, Mapping):
            continue
        out += [f"[{key_text(name)}.{key_text(key)}]", *(f"{key_text(k)} = {value_text(v)}" for k, v in value.items()), ""]
    return out[:-1]


def key_text(key: str) -> str:
    """A key, in quotes where TOML wants that."""
    return key if _BARE_KEY.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    """A basic string. JSON escapes all that TOML wants escaped, except for the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def value_text(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e15 and str(value) != "-0.0" else repr(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key_text(k)} = {value_text(v)}" for k, v in value.items()) + " }" if value else "{}"
    return "[" + ", ".join(map(value_text, value)) + "]"
