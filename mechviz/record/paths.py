"""Names of entities, and their parts escaped as rerun does."""

from __future__ import annotations

from functools import lru_cache

__all__ = ["entity"]


@lru_cache(maxsize=8192)
def entity(*parts: str) -> str:
    """An entity path from its unescaped parts."""
    import rerun as rr

    return rr.new_entity_path(list(parts))
