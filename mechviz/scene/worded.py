"""What the core says of a scene's mechanism, in the scene's words: its units, and paths of keys that its document has."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from mechcore.errors import Fault, MechanismError

if TYPE_CHECKING:
    from mechviz.scene.document import SceneDocument
    from mechviz.scene.scene import Scene


P = ParamSpec("P")
R = TypeVar("R")

_SECTIONS = {"dynamics": "run", "drives": "joints"}
"""Parts of a mechanism that are called otherwise in a scene."""


@contextmanager
def worded(scene: Scene) -> Iterator[None]:
    """Faults of the core that arise inside, in the words of the scene. Raises `MechanismError`."""
    try:
        yield
    except MechanismError as error:
        if type(error) is not MechanismError:
            raise  # a scene's own
        raise MechanismError([fault_of_scene(scene, fault) for fault in error.faults]) from error


def in_scene_words(function: Callable[Concatenate[Scene, P], R]) -> Callable[Concatenate[Scene, P], R]:
    """The function of a scene, raising faults of the core in the words of the scene."""

    @wraps(function)
    def called(scene: Scene, *args: P.args, **options: P.kwargs) -> R:
        with worded(scene):
            return function(scene, *args, **options)

    return called


def fault_of_scene(scene: Scene, fault: Fault) -> Fault:
    """A fault of the core in the scene's units, at a path that its document has."""
    shown = fault.in_units(scene.units)
    return Fault(path_as_written(scene.former, document_path(scene.document, fault.path)), shown.message, shown.remedy)


def path_as_written(former: Mapping[str, str], path: str) -> str:
    """A path of the document with the name that the scene's text has for its first key; ``former``: present name -> former one."""
    first = re.split(r"[.\[]", path, maxsplit=1)[0]
    return former.get(first, first) + path[len(first) :]


def document_path(document: SceneDocument, path: str) -> str:
    """The longest beginning of a path of the core that the document has a place for; as it is where it is of something else.

    The core knows parts that a pair brings along (``H.base`` of the cylinder ``H``) and names drives apart from their pairs.
    """
    first, _, rest = path.partition(".")
    section = _SECTIONS.get(first, first)
    if section.partition("[")[0] not in type(document).model_fields:
        return path
    found, place = section, getattr(document, section, None)
    if section == "links" and rest and _split(place, rest)[0] is None:  # a link that a pair brings along
        found, place = "joints", document.joints
    if found == "joints":
        rest = _in_scene(document, rest)
    while rest:
        key, after = _split(place, rest)
        if key is None:
            return found
        found, rest = f"{found}.{key}", after
        place = place[key] if isinstance(place, Mapping) else getattr(place, key, None)
    return found


def _in_scene(document: SceneDocument, path: str) -> str:
    """A path inside the joints, with what the core's joint calls otherwise as its scene calls it."""
    name, inner = _split(document.joints, path)
    pair = document.joints.get(name or "")
    if pair is None or pair.traits.core_path is None or not inner:
        return path
    return f"{name}.{pair.traits.core_path(pair, inner)}"


def _split(place: Any, path: str) -> tuple[str | None, str]:
    """The key of a place with which a path goes on, and what comes after it; None where it has no such key. Names hold dots."""
    keys = place if isinstance(place, Mapping) else getattr(type(place), "model_fields", ())
    fitting = [key for key in keys if path == key or path.startswith((f"{key}.", f"{key}["))]
    if not fitting:
        return None, ""
    key = max(fitting, key=len)
    return key, path[len(key) :].lstrip(".")
