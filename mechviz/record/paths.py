"""Names of entities, and their parts escaped as rerun does."""

from __future__ import annotations

__all__ = ["entity"]


def entity(*parts: str) -> str:
    """An entity path from its unescaped parts."""
    import rerun as rr

    return rr.new_entity_path(list(parts))
