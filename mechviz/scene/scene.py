"""A scene: a validated document, the mechanism that it describes, and the text that reproduces both."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mechcore.accuracy import Accuracy
from mechcore.errors import Fault
from mechcore.records import dataclass
from mechcore.spec.mechanism import Mechanism
from mechviz.files import replacing
from mechviz.scene.annotations import Place, stated_value
from mechviz.scene.assembly.assemble import assemble_scene
from mechviz.scene.assembly.simulation import SimulationSpec
from mechviz.scene.convert import Converter, JoinedSegments
from mechviz.scene.document import FORMER, FORMER_INNER, FORMER_OF_LINKS, SceneDocument, value_at, with_values
from mechviz.scene.faults import SceneError, path_as_written, path_text
from mechviz.scene.folder import SceneFolder, copy_files
from mechviz.scene.kinds.copies import with_copies
from mechviz.scene.kinds.settings import accuracy_of
from mechviz.scene.limits import size_faults
from mechviz.scene.names import files_named
from mechviz.scene.reading.formulas import ParameterValue, parameter_changes, reevaluate, resolve
from mechviz.scene.reading.recovery import Reading, read_document
from mechviz.scene.reading.text import find_scene, parse_toml, read_text, toml_text
from mechviz.scene.units import EXPRESSION_PATTERN, Units


@dataclass(frozen=True, eq=False)
class Scene:
    """A mechanism with its drives, loads and effects, as a scene file states it.

    It is made by ``load``, ``loads``, ``Scene.build`` or a ``SceneBuilder``, and is always valid. Two scenes are equal if their
    documents and the contents of the files that they name are equal; name, folder and source text do not count.
    """

    name: str  # gallery name, or that of the file without its ending
    document: SceneDocument = field(repr=False)
    mechanism: Mechanism = field(repr=False)  # SI units and radians
    folder: SceneFolder = field(repr=False)  # where the files that it names are
    simulation: SimulationSpec | None = field(default=None, repr=False)  # where forces decide the motion
    source: str | None = field(default=None, repr=False)  # the text that it was read from, with its comments
    former_keys: Mapping[str, str] = field(
        default_factory=dict, repr=False
    )  # places with present names of keys -> with the former names in the text
    kinds: Mapping[str, str] = field(default_factory=dict, repr=False)  # kinds of quantities of its values, by path
    curves: Mapping[str, JoinedSegments] = field(default_factory=dict, repr=False)  # joined curves of its segments, by path

    @classmethod
    def build(cls, *, name: str = "scene", folder: SceneFolder | Path | str | None = None, **document: object) -> Scene:
        """A scene from the tables of a scene file: ``Scene.build(title=..., units={...}, links={...}, joints={...})``.

        Tuples are accepted for lists, and numpy numbers for numbers. ``folder`` is the folder of the files that the scene names, by
        default the working folder. Raises `SceneError` with every fault.
        """
        return _read(_plain(document), name, SceneFolder.of(folder))

    def changed(self, changes: Mapping[Place, Any], *, name: str | None = None) -> Scene:
        """The scene with the values at some places of its document replaced, and optionally with another name; None removes a key.

        ``scene.changed({("run", "frames"): 720, ("links", "crank", "points", "B", 0): "80 mm"})``. Only what changes is validated
        again. Raises `SceneError` with every fault.
        """
        try:
            document = changed_document(self.document, changes, self.name, self.folder)
        except SceneError:
            raise
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            if faults := _misplaced(self.document, changes):
                raise SceneError(self.name, faults) from error
            raise
        return assembled(document, name or self.name, self.folder)

    def with_parameters(self, values: Mapping[str, float | str]) -> Scene:
        """The scene with other values of some parameters: ``scene.with_parameters({"r": "42 mm"})``. Raises `SceneError` with every
        fault."""
        changes, faults = parameter_changes(self.document, values)
        if faults:
            raise SceneError(self.name, faults)
        return self.changed(changes) if changes else self

    @cached_property
    def text(self) -> str:
        """TOML of this scene: the text from which it was read, else the standard layout."""
        return self.source or self.to_toml()

    @property
    def files(self) -> dict[str, bytes]:
        """The contents of the files that it names, by these names: meshes of masses, profiles of cams, tables of laws."""
        return {name: self.folder.read(name) for name in files_named(self.document)}

    @property
    def file_paths(self) -> list[Path]:
        """The real paths of those files."""
        return [Path(os.path.realpath(self.folder.path / name)) for name in files_named(self.document)]

    @property
    def title(self) -> str:
        return self.document.title or self.name

    @property
    def learning_goal(self) -> str:
        return self.document.learning_goal

    @property
    def frames(self) -> int:
        """Number of frames of a run, the one at its start not counted: 0 where nothing moves and no time passes."""
        return self.document.run.frames if self.simulation is not None or self.mechanism.cycle else 0

    @property
    def cycles(self) -> int:
        """Number of drive cycles of a run."""
        return self.document.run.cycles

    @property
    def units(self) -> Units:
        """The units of the scene's bare numbers, in which its results are stated."""
        return self.document.unit_system

    @property
    def parameters(self) -> Mapping[str, ParameterValue]:
        """The parameters by name, in SI units."""
        return resolve({"parameters": self.document.parameters_data}).parameters

    @property
    def accuracy(self) -> Accuracy:
        """The accuracy settings of the run."""
        return accuracy_of(self.document.accuracy, Converter.of(self.document.units, self.folder))

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects to compute."""
        return tuple(self.document.effects)

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves it, neither a drive nor forces."""
        return self.simulation is None and not self.mechanism.moving

    def to_toml(self) -> str:
        """The scene as TOML in the standard layout, without comments; numbers read back bit for bit."""
        return toml_text(self.document.to_data(defaults=False))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        return self.to_toml() == other.to_toml() and self.files == other.files

    def __hash__(self) -> int:
        return hash(self.to_toml())


def load(source: str | Path) -> Scene:
    """Read a scene: a name from the gallery, or the path of a TOML file. Raises `SceneError` with every fault."""
    path = find_scene(source)
    text = read_text(path)
    return _read(parse_toml(text, path.name), path.stem, SceneFolder.of(path.parent), source=text, file=path.name)


def loads(text: str, name: str = "scene", folder: SceneFolder | Path | str | None = None) -> Scene:
    """Read a scene from TOML text. ``folder`` is the folder of the files that it names, by default the working folder. Raises
    `SceneError` with every fault."""
    return _read(parse_toml(text, name), name, SceneFolder.of(folder), source=text)


def dump(scene: Scene, path: str | Path, *, keep: bool = False) -> list[Path]:
    """Write a scene as a TOML file, and copy the files that it names beside it where they are missing there; returns the paths of
    the copies.

    An existing file is replaced only when the new one is complete. ``keep``: write the scene's ``text`` with its comments instead
    of the standard layout. Raises `OutputError` where it cannot be written.
    """
    with replacing(Path(path)) as temporary:
        temporary.write_text(scene.text if keep else scene.to_toml(), encoding="utf-8", newline="\n")
        return copy_files(scene.files, Path(path).parent)


def json_schema() -> dict[str, Any]:
    """A JSON Schema (draft 2020-12) of the scene format, for editors."""
    schema = _for_editors(SceneDocument.model_json_schema())
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mechviz scene",
        **{key: value for key, value in schema.items() if key != "title"},
        "properties": {**schema["properties"], **{old: schema["properties"][new] for old, new in FORMER.items()}},
        "required": ["links"],
        "anyOf": [{"required": ["joints"]}, {"required": ["pairs"]}],
    }


def changed_document(document: SceneDocument, changes: Mapping[Place, Any], name: str, folder: SceneFolder) -> SceneDocument:
    """A document with the values at some places replaced, of which only what changes is validated again. Raises `SceneError` with
    every fault."""
    if not all(isinstance(place, tuple) and place for place in changes):
        raise TypeError("a place is a tuple of names and numbers")
    changes = {tuple(_present_key(place, k) for k in range(len(place))): _plain(value) for place, value in changes.items()}
    try:
        made = _with_formulas(document, changes)
    except (ValidationError, AttributeError):  # the whole is read again, for every fault with its place, also of keys
        return Scene.build(name=name, folder=folder, **with_values(document.to_data(), changes)).document
    return made


def _misplaced(document: SceneDocument, changes: Mapping[Place, Any]) -> list[Fault]:
    """Faults of places that a document does not have."""

    def wrong(place: Place, value: Any) -> bool:
        try:
            with_values(document, {place: value})
        except ValidationError:
            return False
        except (AttributeError, LookupError, TypeError, ValueError):
            return True
        return False

    if strange := [str(place) for place in changes if not (isinstance(place, tuple) and place)]:
        return [Fault(place, "this is no place.", 'Give its parts, such as ("run", "frames").') for place in strange]
    places = [place for place, value in changes.items() if wrong(place, value)]
    return [Fault(path_text(place), "there is no such place in the scene.", "Give one that it has.") for place in places]


def _with_formulas(document: SceneDocument, changes: Mapping[Place, Any]) -> SceneDocument:
    """The document with changed values, and with the values of all expressions that depend on them. Raises `ValidationError`."""
    if not document.parameters and not document.formulas:
        made: SceneDocument = with_values(document, changes)
        return made
    if all(place[0] == "parameters" and len(place) > 1 for place in changes):  # only parameters change
        values, faults = reevaluate(document, changes)
        if faults:
            raise ValidationError.from_exception_data("scene", [])
        following = {place: value for place, value in values.items() if value != value_at(document, place)}
        made = with_values(document, following | dict(changes))
        made.keep_formulas(document.formulas)
        return made
    resolved = resolve(with_values(document.to_data(), changes))
    if resolved.faults:
        raise ValidationError.from_exception_data("scene", [])
    following = {
        place: value for place in resolved.formulas if (value := value_at(resolved.data, place)) != stated_value(document, place)
    }
    values = {place: None if value is None else value_at(resolved.data, place) for place, value in changes.items()}
    made = with_values(document, following | values)
    made.keep_formulas(resolved.formulas)
    return made


def assembled(document: SceneDocument, name: str, folder: SceneFolder) -> Scene:
    """The scene of a valid document. Raises `SceneError` with every fault."""
    return _assembled(Reading(document), name, folder, {})


def _read(raw: Mapping[str, Any], name: str, folder: SceneFolder, *, source: str | None = None, file: str | None = None) -> Scene:
    """The scene of plain data; ``source`` is the text from which they come, ``file`` its name in messages."""
    large = size_faults(raw)
    if large:
        raise SceneError(file or name, large)
    former = {FORMER[key]: key for key in raw if key in FORMER}
    twice = [
        Fault(old, f"{new} and {old} at once, which say the same.", f"Keep {new}.") for new, old in former.items() if new in raw
    ]
    if twice:
        raise SceneError(file or name, twice)
    data = {FORMER.get(key, key): value for key, value in raw.items()}
    for section in ("watch", "loads", "links"):
        if isinstance(data.get(section), Mapping):
            names, deep = (FORMER_OF_LINKS, False) if section == "links" else (FORMER_INNER, True)
            entries = data[section].items()
            data[section] = {k: _with_present_keys(entry, f"{section}.{k}", former, names, deep=deep) for k, entry in entries}
    reading = read_document(with_copies(data, resolve(data).data if "copies" in data else {}))
    reading.faults += [
        Fault(f"copies[{k}]", "its links cannot be copied as it is written.", "Name links of the scene, and write plain values.")
        for k in range(len(reading.document.copies))
        if not reading.faults
    ]
    return _assembled(reading, name, folder, former, source, file)


def _present_key(place: Place, k: int) -> int | str:
    """The present name of part k of a place."""
    part = place[k]
    if k == 0:
        return FORMER.get(str(part), part)
    return FORMER_OF_LINKS.get(str(part), part) if k == 2 and place[0] == "links" else part


def _with_present_keys(value: object, path: str, former: dict[str, str], names: Mapping[str, str], *, deep: bool) -> Any:
    """A part of a scene's data with former names of keys replaced by the present ones in ``names``, also in its inner tables if
    ``deep``. Replaced names are added to ``former`` by their places."""
    if not isinstance(value, Mapping):
        return value
    renamed = {}
    for key, inner in value.items():
        new = key if names.get(key, key) in value else names.get(key, key)
        if new != key:
            former[f"{path}.{new}"] = f"{path}.{key}"
        renamed[new] = _with_present_keys(inner, f"{path}.{new}", former, names, deep=True) if deep else inner
    return renamed


def _assembled(
    reading: Reading, name: str, folder: SceneFolder, former: Mapping[str, str], source: str | None = None, file: str | None = None
) -> Scene:
    with np.errstate(all="ignore" if reading.faults else None):  # stand-ins for faulty values may have any value
        assembly, faults = assemble_scene(reading, name, folder)
    if assembly is None:
        ordered = reading.in_file_order([*reading.faults, *faults])
        formulas = {path_text(place): text for place, text in reading.document.formulas.items()}
        ordered = [replace(f, message=f"'{formulas[f.path]}': {f.message}") if f.path in formulas else f for f in ordered]
        raise SceneError(file or name, [replace(fault, path=path_as_written(former, fault.path)) for fault in ordered])
    return Scene(
        name, reading.document, assembly.mechanism, folder, assembly.simulation, source, former, assembly.kinds, assembly.curves
    )


def _plain(value: object) -> Any:
    """Python values as TOML would hold them: lists for tuples and arrays, plain numbers for numpy's; no None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, tuple | list):
        return [_plain(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return value


def _for_editors(schema: object) -> Any:
    """The schema with three changes: TOML has no null, so an optional key is one that may be left out; every name must match the
    pattern; and every number may be an expression."""
    if isinstance(schema, list):
        return [_for_editors(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    texts = [option for option in schema.get("anyOf", ()) if isinstance(option, dict) and option.get("type") == "string"]
    plain = {
        key: value if key == "anyOf" and texts else _for_editors(value)
        for key, value in schema.items()
        if not (key == "default" and value is None)
    }
    if isinstance(plain.get("patternProperties"), dict):
        ((pattern, entry),) = plain.pop("patternProperties").items()
        plain |= {"propertyNames": {"pattern": pattern}, "additionalProperties": entry}
    if plain.get("type") in ("number", "integer"):
        number = {key: plain.pop(key) for key in list(plain) if key not in ("description", "default", "title", "examples")}
        plain["anyOf"] = [number, {"type": "string", "pattern": EXPRESSION_PATTERN}]
    options = plain.get("anyOf")
    if isinstance(options, list) and {"type": "null"} in options:
        rest = [option for option in options if option != {"type": "null"}]
        if len(rest) == 1:
            del plain["anyOf"]
            return {**rest[0], **plain}
        plain["anyOf"] = rest
    return plain
