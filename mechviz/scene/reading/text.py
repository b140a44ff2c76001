"""Scene files: finding and reading them, reporting errors of TOML syntax, and writing TOML as a person would."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mechcore.errors import Fault
from mechviz.files import read_regular
from mechviz.scene.faults import SceneError, closest, did_you_mean, nearest
from mechviz.scene.folder import GALLERY_FOLDER, gallery_names

LARGEST_FILE = 8_000_000
"""Largest scene file [bytes]: far beyond any scene, short of what would keep a machine busy for minutes."""

DEEPEST_NESTING = 20
"""Levels of tables and lists in a scene file; a scene needs six."""


def find_scene(source: str | Path) -> Path:
    """The file of a gallery name or of a path. A text with a folder or a file ending is a path. Raises `SceneError`."""
    text = str(source)
    names = gallery_names()
    if isinstance(source, str) and text in names:
        return GALLERY_FOLDER / f"{text}.toml"
    path = Path(source)
    try:
        if path.exists():
            return path
    except (OSError, ValueError) as error:
        raise SceneError(
            text[:60],
            Fault("scene", f"this is no path of a file: {error}.", "Give a gallery name or the path of a .toml file."),
        ) from None
    if path.is_symlink():
        fault = Fault("file", f"this is a link to '{path.resolve()}', which does not exist.", "Give the scene itself.")
        raise SceneError(text, fault)
    if isinstance(source, Path) or path.suffix or len(path.parts) != 1:
        folder = path.parent
        if not folder.is_dir():
            raise SceneError(text, Fault("file", f"there is no folder '{folder}'.", "Check the path."))
        beside = [entry.name for entry in folder.glob("*.toml")]
        near = closest(path.name, beside)
        stem = closest(path.stem, names)
        remedy = (
            f"Did you mean '{folder / near}'?"
            if near
            else f"Did you mean the gallery scene '{stem}'?"
            if stem
            else "Check the path; gallery scenes are named without '.toml'."
        )
        raise SceneError(text, Fault("file", "there is no such file.", remedy))
    part = _letters(text)
    holding = [name for name in sorted(names, key=len) if part and part in _letters(name)]
    alike = [f"'{name}'" for name in list(dict.fromkeys([*holding, *nearest(text, names, 3)]))[:3]]
    listed = "The gallery is listed by: mechviz scenes"
    suggestion = f"Did you mean {' or '.join(filter(None, (', '.join(alike[:-1]), *alike[-1:])))}? " if alike else ""
    raise SceneError(
        text,
        Fault(
            "scene",
            f"neither a gallery scene nor a file is called {text!r}.",
            suggestion + listed,
        ),
    )


def _letters(name: str) -> str:
    """A name in lower case without the characters that separate its words."""
    return re.sub(r"[\W_]", "", name.casefold())


def read_text(path: Path) -> str:
    """The text of a scene file. Raises `SceneError` where it cannot be read, or is no text."""
    name = path.name or str(path)

    def fault(message: str, remedy: str = "") -> SceneError:
        return SceneError(name, Fault("file", message, remedy))

    try:
        if path.is_dir():
            raise fault(
                "this is a folder.",
                did_you_mean("", [entry.name for entry in sorted(path.glob("*.toml"))], what="Scenes in it"),
            )
        data = read_regular(path, LARGEST_FILE)
    except OSError as error:
        raise fault(
            f"cannot be read: {error.strerror or error}.", "Check that it is the right file, and its permissions."
        ) from None
    if data.startswith(b"RRF2") or path.suffix == ".rrd":
        raise fault("this is a recording, not a scene.", "Look into it with 'mechviz inspect', or give the scene that made it.")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise fault(
            f"is not a text in UTF-8: line {line} holds the byte 0x{data[error.start]:02x}.",
            "Save it as UTF-8, or check that it is the right file.",
        ) from None
    if "\0" in text:
        raise fault("is a binary file.", "Check that it is the right file.")
    if not text.strip():
        raise fault("is empty.", "Write a scene; docs/scenes.md shows how, 'mechviz scenes' lists examples.")
    return text


_TWICE = "A key stands twice in the same table. Keep one."
_REMEDIES = (
    ("Cannot overwrite a value", _TWICE),
    ("Duplicate inline table key", _TWICE),
    ("Cannot declare", "The same table is opened twice. Join the two."),
    ("Cannot mutate immutable", "A table in braces cannot be extended below. Put everything inside the braces."),
    ("Invalid value", 'Write values like 60, 2.5, "60 rpm", true, [1, 2] or { a = 1 }: texts and numbers with a unit need quotes.'),
    ("Expected '='", "Write key = value, or the name of a table in brackets: [links]. Other keys than plain words need quotes."),
    (
        "Unclosed inline table",
        "Close the braces on the same line, with commas between the entries; or write a table such as [links.crank].",
    ),
    (
        "Invalid initial character for a key",
        "A table in braces stays on one line and has no comma at its end; for long ones write [links.crank].",
    ),
    ("Unclosed array", "Close the bracket, and put commas between the entries."),
    ("Unterminated string", "Close the quotes."),
    ("Illegal character", "A text in quotes stays on one line; tabs and line ends inside it are written \\t and \\n."),
    ("Unescaped '\\'", "Double the backslash, or use single quotes."),
    (
        "Expected newline or end of document",
        "One key = value on a line: put the rest on a line of its own, or into the brackets.",
    ),
    ("Expected ']'", "Close the bracket of the table's name."),
    ("Invalid statement", "Write key = value, or [table]."),
)


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """TOML text -> plain data. Raises `SceneError` with line and column where it is not valid."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(name, _syntax_fault(str(error), text)) from None
    except ValueError as error:  # Python refuses integers of thousands of digits
        raise SceneError(name, Fault("file", f"cannot be read: {error}.", "Write long numbers as 1e6.")) from None
    except RecursionError:
        data = None
    if data is None or not _is_shallow(data, DEEPEST_NESTING):
        fault = Fault("file", "brackets are nested too deep.", f"A scene needs no more than {DEEPEST_NESTING} levels.")
        raise SceneError(name, fault)
    return data


def _is_shallow(value: object, levels: int) -> bool:
    """Whether tables and lists are nested at most ``levels`` deep."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return levels > 0 and all(_is_shallow(item, levels - 1) for item in inner)


def _syntax_fault(said: str, text: str) -> Fault:
    """The fault of an error that the TOML reader reports, with the line in which it occurs."""
    message, _, place = said.splitlines()[0].partition(" (at ")
    numbers = [int(n) for n in re.findall(r"[0-9]+", place)]
    rows = text.splitlines()
    if len(numbers) > 1:
        line, where = numbers[0], f"line {numbers[0]}, column {numbers[1]}"
    else:
        line = len(text.rstrip().splitlines())
        where = f"line {line}, end of file"
    shown = rows[line - 1].strip() if 0 < line <= len(rows) else ""
    quoted = f", in: {shown[:60]}{'...' if len(shown) > 60 else ''}" if shown else "."
    remedy = next((hint for start, hint in _REMEDIES if message.startswith(start)), "Check brackets and quotes there.")
    frozen = re.search(r"immutable namespace .*'([^']*)'", message)
    if frozen and len(re.findall(rf"\b{re.escape(frozen[1])}\s*=", shown)) > 1:  # so tomllib calls a second list or table, too
        message, remedy = f"the key '{frozen[1]}' stands twice", _TWICE
    return Fault(where, f"not valid TOML: {message[:1].lower()}{message[1:]}{quoted}", remedy)


_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_LONGEST_LINE = 118


def toml_text(data: Mapping[str, Any]) -> str:
    """TOML of nested tables, lists, texts, numbers and flags; floats read back bit for bit.

    tomlkit is not used: equality and hash of a scene use this text, which would take 16 times as long, and every command would take
    50 ms longer to load. The choice between a line and a table for each entry, 2.0 as 2 and blanks in braces would need code of
    ours anyway.
    """
    plain = {key: value for key, value in data.items() if not _is_section(key, value)}
    lines = [f"{key_text(key)} = {value_text(value)}" for key, value in plain.items()]
    for name, section in data.items():
        if _is_section(name, section):
            lines += ["", *_section(name, section)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _is_section(key: str, value: object) -> bool:
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
    """A key, in quotes where TOML requires them."""
    return key if _BARE_KEY.fullmatch(key) else _text(key)


def _text(text: str) -> str:
    """A basic string. JSON escapes all characters that TOML requires to be escaped, except delete."""
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
