"""Tables of which a keyword tells the kind: what every kind states of itself, and the checks that follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from mechviz.scene.fields import Table, one_of


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of joint or load, as far as its form goes."""

    words: str  # in a sentence
    example: str  # an entry of the scene in TOML
    keys: tuple[str, ...] = ()  # that go with it
    needs: Mapping[str, str] = field(default_factory=dict)  # those without a default, with an example of each
    one_of: tuple[str, ...] = ()  # exactly one of these
    synonyms: tuple[str, ...] = ()  # what people call it elsewhere
    instead: Mapping[str, str] = field(default_factory=dict)  # key of another kind -> what was probably meant by it


class KindTable(Table):
    """A table with exactly one of the keywords of ``KINDS``, and the keys that go with that kind."""

    KINDS: ClassVar[Mapping[str, Kind]]
    EVERY: ClassVar[tuple[str, ...]] = ()  # keys that go with every kind

    @classmethod
    def keys_beside(cls, raw: Mapping[str, Any]) -> list[str]:
        """The keys that go with the kind of a table of plain data; all, the keywords first, where its kind is not clear."""
        kinds = [kind for kind in cls.KINDS if kind in raw]
        if len(kinds) == 1:
            return [kinds[0], *cls.KINDS[kinds[0]].keys, *cls.EVERY]
        return [*cls.KINDS, *(key for key in cls.model_fields if key not in cls.KINDS)]

    @cached_property
    def kinds(self) -> list[str]:
        """The kinds that are given: one, in a table that is not faulty."""
        return [kind for kind in self.KINDS if getattr(self, kind) is not None]

    @property
    def kind(self) -> str:
        return self.kinds[0]

    def says(self, key: str) -> bool:
        """Whether a key says something."""
        return getattr(self, key) is not None

    def instead(self, key: str) -> str:
        """What to do about a key that does not go with the kind."""
        return self.KINDS[self.kind].instead.get(key, f"Leave out {key}.")

    def misfits(self, what: str) -> list[tuple[str, str, str]]:
        """The faults of keys that do not go with the kind, and of those that it lacks; ``what``: the table in a sentence."""
        kind = self.KINDS[self.kind]
        strangers = self.model_fields_set - {*self.KINDS, *self.EVERY, *kind.keys}
        order = list(type(self).model_fields).index if strangers else None
        found = [
            (key, f"{key} does not go with {kind.words}.", self.instead(key))
            for key in sorted(strangers, key=order)
            if self.says(key)
        ]
        for key, example in kind.needs.items():
            if getattr(self, key) is None:
                found.append(("", f"'{key}' is missing.", f"Add {key} = {example}."))
        return found + (one_of(self, kind.one_of, what) if kind.one_of else [])
