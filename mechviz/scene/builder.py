"""Scenes built step by step in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mechcore.errors import Fault
from mechviz.scene.faults import SceneError
from mechviz.scene.kinds.joints.document import JOINT_KINDS
from mechviz.scene.scene import Scene

Value = float | str
"""A number in the builder's units, or a text with its own unit such as ``"60 rpm"``."""


class SceneBuilder:
    """Collects the parts of a scene; ``scene()`` validates them all at once, exactly as a scene file.

    Every kind of joint has a method of its name: ``revolute``, ``prismatic`` ... ``cam``.

    >>> b = SceneBuilder("four-bar", length="mm")
    >>> b.link("frame", A=(0, 0), D=(200, 0)).link("crank", A=(0, 0), B=(60, 0))
    >>> b.link("coupler", B=(0, 0), C=(180, 0)).link("rocker", D=(0, 0), C=(150, 0))
    >>> b.revolute("A", "frame", "crank", drive={"speed": "60 rpm"}).revolute("B", "crank", "coupler")
    >>> b.revolute("C", "coupler", "rocker", side="left").revolute("D", "rocker", "frame")
    >>> scene = b.scene()
    """

    def __init__(
        self,
        name: str,
        *,
        title: str = "",
        learning_goal: str = "",
        frame: str = "frame",
        folder: Path | str | None = None,
        **units: str,
    ):
        """``units`` are those of bare numbers: ``length="mm"``, ``angle="deg"`` ...; ``folder`` is where the files that the scene
        names are, by default the working folder."""
        self._name, self._folder = name, folder
        self._data: dict[str, Any] = {
            "title": title,
            "learning_goal": learning_goal,
            "units": units,
            "effects": [],
            "metrics": [],
            "frame": frame,
            "trace": [],
        }
        self._faults: list[Fault] = []

    def _add(self, section: str, name: str, entry: object) -> SceneBuilder:
        entries = self._data.setdefault(section, {})
        if name in entries:
            self._faults.append(Fault(f"{section}.{name}", "is given twice.", "Give each a name of its own."))
        entries[name] = entry
        return self

    def link(
        self,
        name: str,
        points: Mapping[str, Sequence[Value]] | Sequence[str] | None = None,
        *,
        mass: Value | Mapping[str, Any] | None = None,
        centre: Sequence[Value] | str | None = None,
        inertia: Value | None = None,
        shape: str | None = None,
        gravity: Sequence[Value] | None = None,
        point_masses: Sequence[Mapping[str, Any]] = (),
        **more_points: Sequence[Value],
    ) -> SceneBuilder:
        """A link. Points are given as a mapping, as keywords, or as a list of names that the sketch places."""
        places: Any = {**points, **more_points} if isinstance(points, Mapping) else more_points if points is None else list(points)
        if more_points and isinstance(places, list):
            self._faults.append(
                Fault(f"links.{name}.points", "a list of names and coordinates at once.", "Give all points in one way.")
            )
        body = {
            "mass": mass,
            "centre": centre,
            "inertia": inertia,
            "shape": shape,
            "gravity": gravity,
            "point_masses": list(point_masses),
        }
        return self._add("links", name, {"points": places, **body})

    def joint(self, name: str, kind: str, first: str, second: str, /, **keys: object) -> SceneBuilder:
        """A joint of a kind between two links. ``keys`` are those of a scene file: ``at="B"``, ``side="left"``, ``drive={...}``."""
        return self._add("joints", name, {kind: [first, second], **keys})

    if TYPE_CHECKING:

        def __getattr__(self, kind: str) -> Callable[..., SceneBuilder]:
            """The methods of the kinds of joints."""

    def force(
        self,
        name: str,
        vector: Sequence[Value],
        *,
        on: str,
        at: str | None = None,
        axes: str = "world",
        table: Mapping[str, Any] | None = None,
    ) -> SceneBuilder:
        """A force on a link at one of its points."""
        return self._add("loads", name, {"force": vector, "on": on, "at": at, "axes": axes, "table": table})

    def torque(self, name: str, moment: Value, *, on: str, table: Mapping[str, Any] | None = None) -> SceneBuilder:
        """A free moment on a link, counter-clockwise positive."""
        return self._add("loads", name, {"torque": moment, "on": on, "table": table})

    def load(self, name: str, **entry: object) -> SceneBuilder:
        """Any load, by the keys of a scene file: ``spring=("frame.P", "boom.Q"), stiffness="2 N/mm", free_length="80 mm"``."""
        return self._add("loads", name, entry)

    def sketch(self, **places: Sequence[Value] | Mapping[str, Any]) -> SceneBuilder:
        """Rough start: places of points, ``B=(60, 0)``, poses of links, ``rod={"at": (60, 0), "angle": "9 deg"}``."""
        for name, place in places.items():
            self._add("sketch", name, place)
        return self

    def friction(self, **defaults: object) -> SceneBuilder:
        """Default friction of all revolute, sliding and slot joints.

        ``coefficient``, ``radius`` of pins, ``length`` of bearings, ``exact`` for exact friction circles.
        """
        self._data["friction"] = defaults
        return self

    def effect(self, *names: str) -> SceneBuilder:
        """Effects to compute: "inertia", "gravity", "friction"."""
        self._data["effects"].extend(names)
        return self

    def metric(self, *names: str) -> SceneBuilder:
        """Metrics to record: "transmission_angle", "velocity_ratio", "mechanical_advantage", "instant_centre", "curvature"."""
        self._data["metrics"].extend(names)
        return self

    def polygon(self, *names: str) -> SceneBuilder:
        """Graphical constructions to draw: "velocity", "acceleration", "force", "graph"."""
        self._data.setdefault("polygons", []).extend(names)
        return self

    def centrodes(self, *links: str) -> SceneBuilder:
        """Links whose centrodes are drawn."""
        self._data.setdefault("centrodes", []).extend(links)
        return self

    def instant_centres(self, *links: str) -> SceneBuilder:
        """Links of which all instant centres are drawn."""
        self._data.setdefault("instant_centres", []).extend(links)
        return self

    def evolutes(self, *points: str) -> SceneBuilder:
        """Points, such as "coupler.E", of whose paths the evolutes are drawn."""
        self._data.setdefault("evolutes", []).extend(points)
        return self

    def inflection(self, *links: str) -> SceneBuilder:
        """Links whose inflection circles are drawn."""
        self._data.setdefault("inflection", []).extend(links)
        return self

    def percussion(self, *points: str) -> SceneBuilder:
        """Points, such as "rod.A", about which links turn whose centres of percussion are drawn."""
        self._data.setdefault("percussion", []).extend(points)
        return self

    def inversion(self, *joints: str) -> SceneBuilder:
        """Disc cams and wedges whose synthesis by inversion is drawn."""
        self._data.setdefault("inversion", []).extend(joints)
        return self

    def equivalent(self, *joints: str) -> SceneBuilder:
        """Cams, gears, racks, pins in slots whose equivalent linkages are drawn."""
        self._data.setdefault("equivalent", []).extend(joints)
        return self

    def reduce(self, *places: str) -> SceneBuilder:
        """Links, or points such as "rocker.D", to which the whole mechanism is reduced."""
        self._data.setdefault("reduced", []).extend(places)
        return self

    def shaking(self, *, about: Sequence[Value] = (0.0, 0.0), counterweights: Mapping[str, Any] | None = None) -> SceneBuilder:
        """Shaking force and moment on the frame, with ``counterweights={"radius": ..., "fraction": ...}`` also those of the
        balanced mechanism."""
        self._data["shaking"] = {"about": about, "counterweights": counterweights}
        return self

    def system(
        self, name: str, *, on: str, loads: Sequence[str] = (), at: str | None = None, pole: Sequence[Value] | None = None
    ) -> SceneBuilder:
        """The loads on a link as a force system, reduced and drawn."""
        return self._add("systems", name, {"on": on, "loads": list(loads), "at": at, "pole": pole})

    def substitute(self, link: str, *masses: Mapping[str, Any], solution: int = 1, static: bool = False) -> SceneBuilder:
        """Substitute masses of a link, such as ``{"at": "B"}, {"at": "C"}, {"y": 0.2}``; values that are not given are computed."""
        return self._add("substitutes", link, {"masses": list(masses), "solution": solution, "static": static})

    def section_forces(
        self, link: str, *, along: Sequence[str] | None = None, section: Mapping[str, Any] | None = None
    ) -> SceneBuilder:
        """Section forces along a link, whose cross-section may be ``{"diameter": ...}`` or ``{"height": ..., "width": ...}``."""
        return self._add("sections", link, {"along": None if along is None else list(along), "section": section})

    def gravity(self, x: Value, y: Value) -> SceneBuilder:
        """Acceleration of gravity [m/s^2]."""
        self._data["gravity"] = [x, y]
        return self

    def trace(self, *points: str) -> SceneBuilder:
        """Points whose paths are traced: "E", or "coupler.E"."""
        self._data["trace"].extend(points)
        return self

    def watch(self, name: str, **entry: object) -> SceneBuilder:
        """A value to watch in a motion under forces, by the keys of a scene file: ``joint="A", at="90 deg"``."""
        return self._add("watch", name, entry)

    def run(
        self,
        *,
        frames: int = 360,
        cycles: int = 1,
        duration: Value | None = None,
        steady: int | None = None,
        tolerance: float | None = None,
        method: str | None = None,
    ) -> SceneBuilder:
        """Frames and drive cycles of a run; duration, steady, tolerance and method where forces determine the motion."""
        run = {"frames": frames, "cycles": cycles, "duration": duration, "steady": steady, "tolerance": tolerance, "method": method}
        self._data["run"] = {key: value for key, value in run.items() if value is not None}
        return self

    def scene(self) -> Scene:
        """The validated scene; SceneError reports every fault at once."""
        try:
            scene = Scene.build(name=self._name, folder=self._folder, **self._data)
        except SceneError as error:
            raise SceneError(self._name, [*self._faults, *error.faults]) from None
        if self._faults:
            raise SceneError(self._name, self._faults)
        return scene


def _method(kind: str) -> Callable[..., SceneBuilder]:
    """The method that adds a joint of a kind."""

    def add(self: SceneBuilder, name: str, first: str, second: str, /, **keys: object) -> SceneBuilder:
        return self.joint(name, kind, first, second, **keys)

    own = [Parameter(key, Parameter.KEYWORD_ONLY, default=None) for key in JOINT_KINDS[kind].keys]
    positional = [p for p in signature(add).parameters.values() if p.kind is Parameter.POSITIONAL_ONLY]
    vars(add)["__signature__"] = Signature([*positional, *own], return_annotation="SceneBuilder")
    add.__name__, add.__qualname__ = kind, f"SceneBuilder.{kind}"
    add.__doc__ = f"Adds {JOINT_KINDS[kind].words} between two links; the keywords are the keys of a scene file."
    return add


for _kind in JOINT_KINDS:
    setattr(SceneBuilder, _kind, _method(_kind))
