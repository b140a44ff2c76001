"""A scene: a validated document, the mechanism that it describes, and the text that reproduces both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mechcore.accuracy import Accuracy
from mechcore.spec import Mechanism

from ..files import replacing
from .accuracies import accuracy_of
from .assemble import assemble
from .bodies import FOLDER
from .convert import Converter
from .document import SceneDocument
from .faults import SceneError, in_file_order
from .free_motion import SimulationSpec
from .reading import find_scene, parse_toml, read_text
from .validate import read_document
from .writing import toml_text

__all__ = ["Scene", "dump", "json_schema", "load", "loads"]


@dataclass(frozen=True, eq=False)
class Scene:
    """A mechanism with its drives, loads and effects, as a scene file states it.

    Made by ``load``, ``loads``, ``Scene.build`` or a ``SceneBuilder``, never half valid.
    Two scenes are equal if they say the same; the name, which only tells where a scene came from, does not count.
    """

    name: str  # gallery name, or the file's without its ending
    document: SceneDocument = field(repr=False)
    mechanism: Mechanism = field(repr=False)  # SI units and radians
    text: str = field(
        repr=False
    )  # TOML that gives this scene again: the file's own text, with its comments, if it came from a file
    simulation: SimulationSpec | None = field(default=None, repr=False)  # where forces decide the motion

    @classmethod
    def build(cls, *, name: str = "scene", **document: Any) -> Scene:
        """A scene from the tables of a scene file: ``Scene.build(title=..., units={...}, links={...}, pairs={...})``.

        Tuples may stand for lists and numpy numbers for numbers. SceneError reports every fault at once.
        """
        return _scene(_plain(document), name, text=None)

    @property
    def title(self) -> str:
        return self.document.title or self.name

    @property
    def teaches(self) -> str:
        return self.document.teaches

    @property
    def frames(self) -> int:
        """Number of frames of a run."""
        return self.document.run.frames

    @property
    def cycles(self) -> int:
        """Number of drive cycles of a run."""
        return self.document.run.cycles

    @property
    def accuracy(self) -> Accuracy:
        """How exact the run is to be."""
        return accuracy_of(self.document.accuracy, Converter.of(self.document.units))

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects to compute."""
        return tuple(self.document.effects)

    def to_toml(self) -> str:
        """The scene as TOML in the standard layout, without comments; numbers read back bit for bit."""
        return toml_text(self.document.model_dump(exclude_defaults=True))

    def _repr_mimebundle_(self, include: object = None, exclude: object = None) -> dict[str, str]:
        """In a notebook a scene is solved and shows itself. Raises `MechanismError`."""
        from ..run import run_scene
        from ..share.notebook import mime_bundle

        return mime_bundle(run_scene(self))

    def __eq__(self, other: object) -> bool:
        return self.to_toml() == other.to_toml() if isinstance(other, Scene) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.to_toml())


def load(source: str | Path) -> Scene:
    """Read a scene: a name from the gallery, or the path of a TOML file. SceneError reports every fault at once."""
    path = find_scene(source)
    text = read_text(path)
    token = FOLDER.set(path.parent)
    try:
        return _scene(parse_toml(text, path.name), path.stem, text=text, source=path.name)
    finally:
        FOLDER.reset(token)


def loads(text: str, name: str = "scene") -> Scene:
    """Read a scene from TOML text."""
    return _scene(parse_toml(text, name), name, text=text)


def dump(scene: Scene, path: str | Path, *, keep: bool = False) -> None:
    """Write a scene as a TOML file; a file that is already there is replaced only by a whole new one.

    ``keep``: its ``text`` with the comments, not the standard layout. Raises `OutputError` where it cannot be written.
    """
    with replacing(Path(path)) as temporary:
        temporary.write_text(scene.text if keep else scene.to_toml(), encoding="utf-8", newline="\n")


def json_schema() -> dict[str, Any]:
    """A JSON Schema (draft 2020-12) of the scene format, for editors."""
    schema = _for_editors(SceneDocument.model_json_schema())
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mechviz scene",
        **{key: value for key, value in schema.items() if key != "title"},
        "required": ["links", "pairs"],
    }


def _scene(raw: Mapping[str, Any], name: str, *, text: str | None, source: str | None = None) -> Scene:
    reading = read_document(raw)
    mechanism, simulation, faults = assemble(reading, name)
    if mechanism is None:
        raise SceneError(source or name, in_file_order([*reading.faults, *faults], raw))
    scene = Scene(name, reading.document, mechanism, text or "", simulation)
    return scene if text is not None else replace(scene, text=scene.to_toml())


def _plain(value: Any) -> Any:
    """Python values as TOML would hold them: lists for tuples and arrays, plain numbers for numpy's; no None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, tuple | list):
        return [_plain(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return value


def _for_editors(schema: Any) -> Any:
    """Two changes: TOML has no null, so an optional key is one that may be left out; and every name must fit the pattern."""
    if isinstance(schema, list):
        return [_for_editors(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    plain = {key: _for_editors(value) for key, value in schema.items() if not (key == "default" and value is None)}
    if isinstance(plain.get("patternProperties"), dict):
        ((pattern, entry),) = plain.pop("patternProperties").items()
        plain |= {"propertyNames": {"pattern": pattern}, "additionalProperties": entry}
    options = plain.get("anyOf")
    if isinstance(options, list) and {"type": "null"} in options:
        rest = [option for option in options if option != {"type": "null"}]
        if len(rest) == 1:
            del plain["anyOf"]
            return {**rest[0], **plain}
        plain["anyOf"] = rest
    return plain
