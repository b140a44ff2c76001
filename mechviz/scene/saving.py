"""Saving an edited scene into the text that it came from: only values that differ are written, comments and layout stay.

The text is walked through once to find where each value stands (TOML 1.0). What is made of it is read back, and counts only if it
says exactly what the edited scene says.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from mechviz.scene.faults import SceneError
from mechviz.scene.scene import Scene, loads
from mechviz.scene.writing import key_text, toml_text, value_text

_BLANK = re.compile(r"[ \t]*")
_GAP = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")  # between values of an array
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_WORD = re.compile(r"[^\s,\]}#]+")  # numbers, flags, dates
_STRINGS = [
    re.compile(pattern, re.DOTALL)
    for pattern in (r'"""(?:\\.|[^\\])*?"""(?:"{0,2}(?!"))', r"'''.*?'''(?:'{0,2}(?!'))", r'"(?:\\.|[^"\\\n])*"', r"'[^'\n]*'")
]


class _Lost(Exception):
    """A value is not where it should be."""


@dataclass
class _Node:
    """A value: where it stands, and what is in it. A table with a header of its own has no such place."""

    start: int = -1
    end: int = -1
    keys: dict[str, _Node] | None = None
    items: list[_Node] | None = None
    entry: int = -1  # where the key of the value begins, if it has one
    head: int = -1  # where the line of its header begins
    last: int = -1  # where the line after its own last key begins

    @property
    def inline(self) -> bool:
        return self.start >= 0


def kept_text(opened: Scene, scene: Scene) -> str | None:
    """The text of ``opened`` with the values of ``scene``, an edited copy of it; None where that text cannot say it."""
    if not opened.text:
        return None
    before, after = (s.document.model_dump(exclude_unset=True) for s in (opened, scene))
    text = patched(opened.text, before, after)
    try:
        return text if text is not None and loads(text, scene.name, scene.folder) == scene else None
    except SceneError:
        return None


def patched(text: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> str | None:
    """TOML ``text`` that says ``before``, changed so that it says ``after``; None where a changed value cannot be found in it."""
    try:
        edits = sorted(_changes(before, after, _Reader(text).read(), text), key=lambda edit: edit[:2])  # stable: in turn at a place
    except _Lost:
        return None
    parts, done = [], 0
    for start, end, new in edits:
        if start < done:
            return None  # within what is taken away
        parts += [text[done:start], new]
        done = end
    return "".join(parts) + text[done:]


def _changes(before: Any, after: Any, node: _Node, text: str) -> Iterator[tuple[int, int, str]]:
    """What has to be written where: from, to, text."""
    if before == after:
        return
    if isinstance(before, Mapping) and isinstance(after, Mapping) and node.keys is not None:
        gone = [key for key in before if key not in after]
        if node.inline and gone and (len(gone) > 1 or any(key not in before for key in after)):
            yield node.start, node.end, value_text(after)  # commas would have to be shared out
            return
        if node.last < 0 and not node.inline and len(gone) == len(before):
            raise _Lost  # it has no header of its own: nothing would be left of it
        for key in before:
            if key not in node.keys:
                raise _Lost(key)
            if key in after:
                yield from _changes(before[key], after[key], node.keys[key], text)
            else:
                yield from _removed(node, key, text)
        new = {key: value for key, value in after.items() if key not in before}
        if new:
            yield from _added(node, new, text)
    elif (
        isinstance(before, list | tuple)
        and isinstance(after, list | tuple)
        and node.items is not None
        and len(before) == len(after) == len(node.items)
    ):
        for old, value, item in zip(before, after, node.items, strict=True):
            yield from _changes(old, value, item, text)
    elif node.inline:
        yield node.start, node.end, value_text(after)
    else:
        raise _Lost


def _removed(table: _Node, key: str, text: str) -> Iterator[tuple[int, int, str]]:
    """Take away a key: its line, its part of an inline table, or all its sections."""
    assert table.keys is not None
    node = table.keys[key]
    if not node.inline:
        for start, end in _sections(node):
            yield start, end, ""
    elif table.inline:
        names = list(table.keys)
        k = names.index(key)
        if k + 1 < len(names):
            yield node.entry, table.keys[names[k + 1]].entry, ""
        else:
            yield (table.keys[names[k - 1]].end if k else node.entry), node.end, ""
    else:
        line = text.rfind("\n", 0, node.entry) + 1
        yield line, _line_end(text, node.end), ""


def _sections(node: _Node) -> Iterator[tuple[int, int]]:
    """The lines of a table, from its header to its last key, and of those below it; comments after that belong to what follows."""
    if node.head >= 0:
        yield node.head, node.last
    for inner in [*(node.keys or {}).values(), *(node.items or [])]:
        yield from _sections(inner)


def _added(table: _Node, new: Mapping[str, Any], text: str) -> Iterator[tuple[int, int, str]]:
    """Write more keys at the end of a table."""
    assert table.keys is not None
    words = {key: f"{key_text(key)} = {value_text(value)}" for key, value in new.items()}
    if table.inline:
        if not table.keys:
            yield table.start, table.end, "{ " + ", ".join(words.values()) + " }"
        else:
            at = max(node.end for node in table.keys.values())
            yield at, at, "".join(f", {word}" for word in words.values())
        return
    if table.last < 0:
        raise _Lost
    own = {key: value for key, value in new.items() if table.head < 0 and isinstance(value, Mapping)}
    lines = "".join(f"{word}\n" for key, word in words.items() if key not in own)
    if lines:
        yield table.last, table.last, ("" if table.last == 0 or text[table.last - 1] == "\n" else "\n") + lines
    if own:  # tables of the scene, with headers of their own
        yield len(text), len(text), ("" if text.endswith("\n") else "\n") + "\n" + toml_text(own)


def _line_end(text: str, at: int) -> int:
    """The beginning of the next line."""
    end = text.find("\n", at)
    return len(text) if end < 0 else end + 1


class _Reader:
    """Walks through a text; raises `_Lost` where it is not what is expected."""

    def __init__(self, text: str):
        self.text, self.at = text, 0

    def read(self) -> _Node:
        root = table = _Node(keys={}, last=0)
        while True:
            self.skip(_GAP)
            if self.at >= len(self.text):
                break
            if self.sees("["):
                start = self.text.rfind("\n", 0, self.at) + 1
                table = self.header(root)
                table.head, table.last = start, _line_end(self.text, self.at)
                self.at = table.last
            else:
                self.entry(table)
                table.last = self.at = _line_end(self.text, self.at)
        return root

    def header(self, root: _Node) -> _Node:
        many = self.text.startswith("[[", self.at)
        self.at += 2 if many else 1
        path = self.path()
        self.expect("]]" if many else "]")
        node = root
        for key in path[:-1]:
            node = self.inner(node, key)
        if not many:
            return self.inner(node, path[-1])
        assert node.keys is not None
        items = node.keys.setdefault(path[-1], _Node(items=[])).items
        if items is None:
            raise _Lost
        items.append(_Node(keys={}))
        return items[-1]

    def inner(self, node: _Node, key: str) -> _Node:
        if node.keys is None:
            raise _Lost
        found = node.keys.setdefault(key, _Node(keys={}))
        return found.items[-1] if found.items and not found.inline else found

    def entry(self, table: _Node) -> None:
        """A key, = and a value."""
        start = self.at
        path = self.path()
        self.expect("=")
        self.skip(_BLANK)
        value = self.value()
        value.entry = start
        for key in path[:-1]:
            table = self.inner(table, key)
        if table.keys is None or path[-1] in table.keys:
            raise _Lost
        table.keys[path[-1]] = value

    def path(self) -> list[str]:
        keys = []
        while True:
            self.skip(_BLANK)
            if self.sees('"') or self.sees("'"):
                node = self.value()
                keys.append(_plain(self.text[node.start : node.end]))
            else:
                keys.append(self.take(_BARE))
            self.skip(_BLANK)
            if not self.sees("."):
                return keys
            self.at += 1

    def value(self) -> _Node:
        start = self.at
        if self.sees("["):
            items: list[_Node] = []
            self.at += 1
            self.skip(_GAP)
            while not self.sees("]"):
                items.append(self.value())
                self.separated("]")
            self.at += 1
            return _Node(start, self.at, items=items)
        if self.sees("{"):
            node = _Node(start, start, keys={})
            self.at += 1
            self.skip(_BLANK)
            while not self.sees("}"):
                self.entry(node)
                self.separated("}")
            self.at += 1
            node.end = self.at
            return node
        if self.sees('"') or self.sees("'"):
            for string in _STRINGS:
                match = string.match(self.text, self.at)
                if match:
                    self.at = match.end()
                    return _Node(start, self.at)
            raise _Lost
        self.take(_WORD)
        return _Node(start, self.at)

    def separated(self, end: str) -> None:
        self.skip(_GAP)
        if self.sees(","):
            self.at += 1
            self.skip(_GAP)
        elif not self.sees(end):
            raise _Lost

    def sees(self, mark: str) -> bool:
        return self.text.startswith(mark, self.at)

    def expect(self, mark: str) -> None:
        self.skip(_BLANK)
        if not self.sees(mark):
            raise _Lost
        self.at += len(mark)

    def skip(self, gap: re.Pattern[str]) -> None:
        match = gap.match(self.text, self.at)
        assert match is not None
        self.at = match.end()

    def take(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.at)
        if match is None:
            raise _Lost
        self.at = match.end()
        return match.group()


def _plain(string: str) -> str:
    """What a quoted key says."""
    return str(tomllib.loads(f"key = {string}")["key"])
