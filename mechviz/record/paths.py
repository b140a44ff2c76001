"""Names of entities, and their parts escaped as rerun does."""

from __future__ import annotations

from functools import lru_cache

__all__ = ["entity", "parts_of"]


@lru_cache(maxsize=8192)
def entity(*parts: str) -> str:
    """An entity path from its unescaped parts."""
    import rerun as rr

    return rr.new_entity_path(list(parts))


def parts_of(path: str) -> tuple[str, ...]:
    """The unescaped parts of an entity path."""
    parts, part, escaped = [], "", False
    for letter in path.removeprefix("/"):
        if escaped:
            part, escaped = part + letter, False
        elif letter == "\\":
            escaped = True
        elif letter == "/":
            parts.append(part)
            part = ""
        else:
            part += letter
    return (*parts, part)
