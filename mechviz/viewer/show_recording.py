"""A recording as the viewer shows it: read by its contract, nothing is computed anew."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, cached_property, partial
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..coils import Coil
from ..linkers import Linker
from ..record import Recording
from ..record.paths import entity as path_of
from ..riders import KINDS, Rider
from ..share.frames import parts_of
from ..vectors import FAMILIES, FORCE_FAMILIES, LARGEST_ARROW, Scales, centre_name
from .quantities import Axis, Quantity, inverse
from .recorded_plans import RecordedPlans
from .show import ArcTrack, Arrows, Body, DriveWay, Happening, Health, Show
from .show_run import split_by_color
from .solids3d import composed

__all__ = ["show_of_recording"]

Real = NDArray[np.float64]

SLIDING = ("prismatic", "pin_slot", "cylinder", "rolling")
LOOKS = 48  # poses at which the extent of the mechanism is looked at


def show_of_recording(recording: Recording) -> Show:
    """What is shown of a recording, complete or interrupted. KeyError and ValueError where it does not keep to the contract."""
    return _Reader(recording).show()


class _Reader:
    """Tables of a recording, and what is made of them."""

    def __init__(self, recording: Recording):
        self.recording = recording
        self.model = recording.model
        self.joints: Mapping[str, Any] = self.model["joints"]
        self.ticks, _ = recording.scalars("data", "links", self.model["links"][0], "pose")
        self.time: Real = 1e-9 * self.ticks.astype(float)

    def table(self, *parts: str) -> Real | None:
        """Values (F, n) of an entity of scalars, None where it is not there."""
        if not self.recording.has(*parts):
            return None
        ticks, values = self.recording.scalars(*parts)
        if len(ticks) != len(self.time):
            raise ValueError(f"/{'/'.join(parts)} has {len(ticks)} rows, the poses have {len(self.time)}")
        return values

    @cached_property
    def poses(self) -> dict[str, Real]:
        found = {}
        for link in self.model["links"]:
            pose = self.table("data", "links", link, "pose")
            if pose is None or not np.isfinite(pose).all():
                raise ValueError(f"the pose of link {link} is not there, or not finite")
            found[link] = pose
        return found

    @cached_property
    def places(self) -> dict[str, Real]:
        """Where the joints are (F, 2) [m]."""
        found = {name: self.table("data", "joints", name, "position") for name in self.joints}
        return {name: xy for name, xy in found.items() if xy is not None and np.isfinite(xy).all()}

    @cached_property
    def bodies(self) -> dict[str, Body]:
        found = {}
        for link in self.model["links"]:
            part = partial(self.recording.static, "mechanism", "links", link, "mesh")
            vertices, faces = part(component="Mesh3D:vertex_positions"), part(component="Mesh3D:triangle_indices")
            if vertices is None or faces is None:
                continue
            packed = part(component="Mesh3D:vertex_colors")
            colors = np.full((len(vertices), 3), 150, np.uint8)
            if packed is not None and len(packed) == len(vertices):  # 0xRRGGBBAA
                shades = packed.astype(np.uint32)
                colors = np.column_stack([(shades >> shift) & 255 for shift in (24, 16, 8)]).astype(np.uint8)
            found[link] = Body(split_by_color(vertices.astype(np.float32), faces.astype(np.uint32), colors))
        return found

    @cached_property
    def bounds(self) -> Real:
        """The box (2, 3) [m] around the solids, looked at at some poses."""
        lows, highs = [], []
        some = np.unique(np.linspace(0, len(self.time) - 1, LOOKS).round().astype(int))
        for link, body in self.bodies.items():
            vertices = np.concatenate([piece.vertices for piece in body.pieces]).astype(float)
            z = vertices[:, 0] + 1j * vertices[:, 1]
            pose = self.poses[link][some]
            placed = z * np.exp(1j * pose[:, 2:]) + (pose[:, 0] + 1j * pose[:, 1])[:, None]
            lows.append([placed.real.min(), placed.imag.min(), vertices[:, 2].min()])
            highs.append([placed.real.max(), placed.imag.max(), vertices[:, 2].max()])
        if not lows:
            flat = np.concatenate([pose[:, :2] for pose in self.poses.values()])
            return np.array([[*flat.min(axis=0), 0.0], [*(flat.max(axis=0) + 1e-3), 1e-3]])
        return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])

    @cached_property
    def size(self) -> float:
        """The mechanism's size [m]: the largest force (else velocity) is drawn as a third of it, by the recorded scales."""
        whole = float(np.max((self.bounds[1] - self.bounds[0])[:2])) or 1.0
        peaks: dict[str, float] = {}
        for family, _, _, value in self.vectors():
            unit = "newtons" if family in FORCE_FAMILIES else {"velocity": "mps"}.get(family, "mps2")
            peaks[unit] = max(peaks.get(unit, 0.0), _largest(np.hypot(value[:, 0], value[:, 1])))
        for unit in ("newtons", "mps", "mps2"):
            per_metre = float(self.recording.properties[f"{unit}_per_metre"])
            if peaks.get(unit) and per_metre != 1.0:
                return float(np.clip(peaks[unit] / per_metre / LARGEST_ARROW, 0.2 * whole, 1.5 * whole))
        return whole

    def sliding(self, joint: str) -> bool:
        return self.joints.get(joint, {}).get("type") in SLIDING

    # -- arrows -------------------------------------------------------------------------------------------------------
    def vectors(self) -> Iterator[tuple[str, str, Real, Real]]:
        """Family, item, origin and value (F, 2) of every vector."""
        for name in self.points:
            at = self.table("data", "points", name, "position")
            for family in ("velocity", "acceleration"):
                value = self.table("data", "points", name, family)
                if at is not None and value is not None:
                    yield family, name, at, value
        for name in self.joints:
            for family in ("reaction", "friction"):
                value = self.table("data", "joints", name, family)
                if value is not None and name in self.places:
                    yield family, name, self.places[name], value[:, :2]
        for name, load in self.model["loads"].items():
            gravity = load["kind"] == "gravity"
            item = load["links"][0] if gravity else name
            value = self.table("data", "loads", *(("gravity", item) if gravity else (name,)))
            if value is not None and np.any(np.nan_to_num(value[:, :2])):
                yield "gravity" if gravity else "applied", item, value[:, 3:], value[:, :2]
        for link in self.model["links"]:
            value, at = self.table("data", "links", link, "inertia"), self.table("data", "points", centre_name(link), "position")
            if value is not None and at is not None:
                force = value[:, :2]
                square = (force**2).sum(axis=1)
                with np.errstate(divide="ignore", invalid="ignore"):  # moved to its line of action
                    arm = np.column_stack([force[:, 1], -force[:, 0]]) * (value[:, 2] / square)[:, None]
                yield "inertia", link, at + np.where(square[:, None] > 0.0, arm, 0.0), force
        for name in self.model["drives"]:
            value = self.table("data", "drive", name, "wrench")
            if value is not None and name in self.places and np.any(value[:, :2]):
                yield "drive", name, self.places[name], value[:, :2]

    def moments(self) -> Iterator[tuple[str, str, Real, Real]]:
        """Family, item, origin (F, 2) and value (F,) of every moment that is not just rounding."""
        found: list[tuple[str, str, Real, Real]] = []
        for name in self.model["drives"]:
            value = self.table("data", "drive", name, "wrench")
            if value is not None and name in self.places:
                found.append(("drive", name, self.places[name], value[:, 2]))
        for name in self.joints:
            value = self.table("data", "joints", name, "reaction")
            if value is not None and name in self.places:
                found.append(("reaction", name, self.places[name], value[:, 2]))
        for name, load in self.model["loads"].items():
            value = None if load["kind"] == "gravity" else self.table("data", "loads", name)
            if value is not None and np.any(np.nan_to_num(value[:, 2])) and not np.any(np.nan_to_num(value[:, :2])):
                pin = next((j for j, joint in self.joints.items() if load["links"][0] in joint["links"] and j in self.places), None)
                found.append(("applied", name, value[:, 3:] if pin is None else self.places[pin], value[:, 2]))
        largest = max((_largest(m[3]) for m in found), default=0.0)
        yield from (m for m in found if _largest(m[3]) > 1e-9 * largest)

    def height(self, family: str, item: str) -> float:
        """At which height an arrow was drawn [m]."""
        for component in ("Arrows3D:origins", "LineStrips3D:strips"):
            try:
                rows = self.recording.rows("vectors", family, item, component=component)
            except KeyError:
                continue
            if len(rows.values):
                return float(np.atleast_2d(rows.values[0])[0, 2])
        return float(self.bounds[1, 2])

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of traced points and centres of mass."""
        links = [centre_name(link) for link in self.model["links"]]
        return tuple(dict.fromkeys([*self.traced, *(n for n in links if self.recording.has("data", "points", n, "position"))]))

    @cached_property
    def traced(self) -> tuple[str, ...]:
        start = "/mechanism/paths/"
        return tuple(path[len(start) :].replace("\\", "") for path in self.recording.entities if path.startswith(start))

    def paths(self) -> dict[str, Real]:
        found = {}
        for name in self.traced:
            at = self.table("data", "points", name, "position")
            strips = self.recording.static("mechanism", "paths", name, component="LineStrips3D:strips")
            if at is not None and np.isfinite(at).all():
                z = float(strips[0][0][2]) if strips is not None and len(strips) else float(self.bounds[1, 2])
                found[name] = np.column_stack([at, np.full(len(at), z)])
        return found

    def linkers(self) -> Iterator[Linker]:
        """Dampers, gas springs, torsion springs, and springs of recordings in which they are lines, as they were drawn."""
        for path in self.recording.entities:
            if path.startswith("/mechanism/springs/") and self.recording.static(path, component="Mesh3D:triangle_indices") is None:
                rows = self.recording.rows(path, component="LineStrips3D:strips")
                per = int(rows.lengths[0]) if len(rows.lengths) else 0
                if not per or not (rows.lengths == per).all():
                    continue
                strips = [np.stack([np.asarray(s, float)[:, :2] for s in rows.values[k::per]]) for k in range(per)]
                row_of = np.clip(np.searchsorted(1e-9 * rows.time, self.time + 1e-12, side="right") - 1, 0, len(rows.time) - 1)
                yield Linker(_last(path), "damper", partial(_strips, tuple(strips), row_of))

    def coils(self) -> Iterator[Coil]:
        """Springs as they were drawn."""
        for path in self.recording.entities:
            mesh = self.solid(path) if path.startswith("/mechanism/springs/") else None
            if mesh is not None:
                vertices, faces, normals, row_of, at, turn = mesh
                scale = self.recording.rows(path, component="Transform3D:scale").values
                pose = np.column_stack([at[:, :2], np.unwrap(2.0 * np.arctan2(turn[:, 2], turn[:, 3]))])
                stretch = np.asarray(scale, float).reshape(-1, 3)[row_of, 0]
                yield Coil(_last(path), pose, stretch, float(at[0, 2]), 1.0, vertices, faces, normals)

    def riders(self) -> Iterator[Rider]:
        """Marks on rollers and belts as they were drawn."""
        for link in self.model["links"]:
            start = path_of("mechanism", "links", link) + "/"
            for path in self.recording.entities:
                kind = next((k for k in KINDS if path.startswith(start) and _last(path).startswith(f"{k} ")), None)
                mesh = self.solid(path) if kind else None
                if kind is not None and mesh is not None:
                    vertices, faces, normals, _, at, turn = mesh
                    way = turn[int(np.argmax(np.hypot(turn[:, 0], turn[:, 1]))), :2]  # of an axis in the plane
                    flat = float(np.hypot(*way)) > 1e-3
                    axis = (float(way[0] / np.hypot(*way)), float(way[1] / np.hypot(*way))) if flat else None
                    angle = np.unwrap(2.0 * np.arctan2(turn[:, :2] @ axis if axis else turn[:, 2], turn[:, 3]))
                    name, place = _last(path)[len(kind) + 1 :], (float(at[0, 0]), float(at[0, 1]), float(at[0, 2]))
                    moves = at if np.any(at != at[0]) else None
                    yield Rider(kind, name, link, place, angle, vertices, faces, normals, axis, moves)

    def solid(self, path: str) -> tuple[Any, ...] | None:
        """Vertices, faces and normals of a mesh that moves by itself, and at every frame: its row, its place, its turn; None where
        there is none."""
        part = partial(self.recording.static, path)
        names = ("vertex_positions", "triangle_indices", "vertex_normals")
        vertices, faces, normals = (part(component=f"Mesh3D:{name}") for name in names)
        if vertices is None or faces is None or normals is None:
            return None
        places = self.recording.rows(path, component="Transform3D:translation")
        turns = self.recording.rows(path, component="Transform3D:quaternion")
        row_of = np.clip(np.searchsorted(1e-9 * places.time, self.time + 1e-12, side="right") - 1, 0, len(places.time) - 1)
        at, turn = (np.asarray(r.values, float)[row_of] for r in (places, turns))
        return vertices.astype(np.float32), faces.astype(np.uint32), normals.astype(np.float32), row_of, at, turn

    # -- quantities ---------------------------------------------------------------------------------------------------
    def quantities(self) -> Iterator[Quantity]:
        for name in self.model["drives"]:
            table = self.table("data", "drive", name)
            if table is not None and np.isfinite(table[:, 3]).any():
                effort, unit = ("force", "N") if self.sliding(name) else ("torque", "N m")
                yield Quantity(f"drive {name}: {effort}", unit, (effort,), _columns(table[:, 3:4]))
                yield Quantity(f"drive {name}: power", "W", ("power",), _columns(table[:, 4:5]))
        for name in self.joints:
            motion, reaction = self.table("data", "joints", name, "motion"), self.table("data", "joints", name, "reaction")
            slides = self.sliding(name)
            words = ("displacement", "velocity", "acceleration")
            units: tuple[tuple[str, float], ...] = (("mm", 1e3), ("m/s", 1.0), ("m/s²", 1.0))
            if not slides:
                words = ("angle", "angular velocity", "angular acceleration")
                units = (("°", float(np.degrees(1.0))), ("rad/s", 1.0), ("rad/s²", 1.0))
            for k, (what, (unit, factor)) in enumerate(zip(words, units, strict=True)):
                if motion is not None:
                    yield Quantity(f"pair {name}: {what}", unit, (what,), _columns(motion[:, k : k + 1] * factor))
            if reaction is not None:
                yield Quantity(f"pair {name}: reaction", "N", ("Fx", "Fy", "|F|"), _columns(_with_length(reaction[:, :2])))
                if slides:
                    yield Quantity(f"pair {name}: couple", "N m", ("couple",), _columns(reaction[:, 2:3]))
            contact = self.table("data", "cams", name, "contact")
            if contact is not None:
                yield Quantity(f"cam {name}: pressure angle", "°", ("angle",), _columns(np.degrees(contact[:, 3:4])))
                yield Quantity(f"cam {name}: curvature", "1/m", ("curvature",), _columns(inverse(contact[:, 4:5])))
                yield Quantity(f"cam {name}: contact force", "N", ("force",), _columns(contact[:, 2:3]))
        for link in self.model["links"]:
            for entity, what, curve, unit, factor in (
                ("pose", "angle", "angle", "°", float(np.degrees(1.0))),
                ("velocity", "angular velocity", "velocity", "rad/s", 1.0),
                ("acceleration", "angular acceleration", "acceleration", "rad/s²", 1.0),
            ):
                values = self.table("data", "links", link, entity)
                if values is not None and link != self.model["frame"]:
                    yield Quantity(f"link {link}: {what}", unit, (curve,), _columns(values[:, 2:3] * factor))
        for name in self.points:
            for what, letter, unit, factor in (
                ("position", "", "mm", 1e3),
                ("velocity", "v", "m/s", 1.0),
                ("acceleration", "a", "m/s²", 1.0),
            ):
                values = self.table("data", "points", name, what)
                if values is not None:
                    curves = ("x", "y") if not letter else (f"{letter}x", f"{letter}y", f"|{letter}|")
                    shown = values * factor if not letter else _with_length(values)
                    yield Quantity(f"point {name}: {what}", unit, curves, _columns(shown))
        energy = self.table("data", "energy")
        if energy is not None:
            yield Quantity("energy", "J", ("kinetic", "potential", "work", "dissipated"), _columns(energy))
        for h in self.health():
            yield Quantity(f"health: {h.name}", h.unit, (h.name,), _columns(h.values[:, None]))

    def axes(self) -> Iterator[Axis]:
        for d in self.drives():
            steps = np.diff(d.position)
            if len(steps) and np.any(steps) and (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
                what, unit, factor = ("displacement", "mm", 1e3) if d.sliding else ("angle", "°", float(np.degrees(1.0)))
                yield Axis(f"{what} of drive {d.name}", unit, d.position * factor)
        yield Axis("time", "s", self.time)

    def drives(self) -> Iterator[DriveWay]:
        for name in self.model["drives"]:
            table = self.table("data", "drive", name)
            if table is not None:
                yield DriveWay(name, self.sliding(name), table[:, 0])

    def health(self) -> Iterator[Health]:
        for name, unit, good, bad in (
            ("closure", "m", 1e-12 * self.size, 1e-6 * self.size),
            ("condition", "1", 30.0, 1e8),
            ("power_balance", "1", 1e-9, 1e-3),
            ("energy_drift", "1", 1e-7, 1e-3),
        ):
            values = self.table("health", name)
            if values is not None:
                yield Health(name.replace("_", " "), unit, values[:, 0], good, bad)

    def output(self, quantities: tuple[Quantity, ...]) -> list[Quantity]:
        """What is plotted after the drives: the motion of the pair on the frame that is not driven, of traced points, reactions."""
        grounded = [n for n, j in self.joints.items() if self.model["frame"] in j["links"] and n not in self.model["drives"]]
        sliding = [name for name in grounded if self.sliding(name)]
        named = [f"pair {name}: " for name in sliding] if sliding else []
        if not sliding:  # of a link on a pin its own angle
            named = [f"link {link}: " for n in grounded for link in self.joints[n]["links"] if link != self.model["frame"]]
        named = (named if len(named) == 1 else []) + [f"point {name}: " for name in self.traced]
        found = [
            q for start in named for q in quantities if q.label.startswith(start) and not q.label.endswith(("reaction", "couple"))
        ]
        return [*found, *(q for q in quantities if q.label.endswith(": reaction"))]

    def spatial(self) -> dict[str, tuple[Real, Real]]:
        """Solids that turn about an axis of their own, below the frames of their links: spatial cams."""
        found = {}
        for link in self.model["links"]:
            part = partial(self.recording.rows, "mechanism", "links", link, "mesh")
            try:
                turn, place = part(component="Transform3D:quaternion"), part(component="Transform3D:translation")
            except KeyError:
                continue
            q, at = np.asarray(turn.values, float), np.asarray(place.values, float)
            if len(q) == len(at) == len(self.time) and np.isfinite(q).all():
                turns, places = composed(self.poses[link], at, q / np.linalg.norm(q, axis=1, keepdims=True))
                found[link] = places, turns
        return found

    @property
    def teaches(self) -> str:
        """What the scene teaches: in the notes it stands between the title and what was computed."""
        head = self.recording.notes.partition("\n## ")[0].splitlines()
        return " ".join(line.strip() for line in head if line.strip() and not line.startswith(("#", "**")))

    @property
    def about(self) -> str:
        """The notes without the title and what the scene teaches, with headings that fit a panel (markdown)."""
        head, cut, rest = self.recording.notes.partition("\n## ")
        text = f"#### {rest}".replace("\n## ", "\n#### ") if cut else head
        return escape(text, quote=False)

    def show(self) -> Show:
        properties = self.recording.properties
        quantities = tuple(self.quantities())
        drives = tuple(self.drives())
        plans = RecordedPlans(self.recording, self.ticks, self.poses, self.places)
        vectors: dict[str, list[tuple[str, Real, Real]]] = {}
        for family, item, at, value in self.vectors():
            vectors.setdefault(family, []).append((item, at, value))
        arrows = {
            family: Arrows(
                tuple(item for item, _, _ in vectors[family]),
                np.stack([at for _, at, _ in vectors[family]], axis=1),
                np.stack([value for _, _, value in vectors[family]], axis=1),
                np.array([self.height(family, item) for item, _, _ in vectors[family]]),
            )
            for family in FAMILIES
            if family in vectors
        }
        length = float(np.ptp(self.time)) or 1.0
        title = str(properties.get("title") or properties.get("scene") or self.recording.path.stem)
        first = [q for d in drives for q in quantities if q.label in (f"drive {d.name}: torque", f"drive {d.name}: force")]
        first += self.output(quantities)
        return Show(
            title=title,
            teaches=self.teaches,
            time=self.time,
            cycle=length,
            drives=drives,
            frame=self.model["frame"],
            poses=self.poses,
            bodies=self.bodies,
            size=self.size,
            bounds=self.bounds,
            z_top=float(self.bounds[1, 2]) + 0.01 * self.size,
            arrows=arrows,
            arcs=tuple(ArcTrack(f, item, at, value, self.height(f, item)) for f, item, at, value in self.moments()),
            scales=Scales(
                *(float(properties[f"{n}_per_metre"]) for n in ("newtons", "newton_metres", "mps", "mps2")),
            ),
            paths=self.paths(),
            joints=self.places,
            quantities=quantities,
            axes=tuple(self.axes()),
            first=tuple(dict.fromkeys([*first, *quantities]))[:3],
            health=tuple(self.health()),
            events=tuple(Happening(e.time, e.level, e.text) for e in self.recording.events),
            linkers=tuple(self.linkers()),
            coils=tuple(self.coils()),
            riders=tuple(self.riders()),
            spatial=self.spatial(),
            opening=_telling(quantities, len(self.time)),
            notes=self.about,
            kinds={name: (str(j["type"]), (str(j["links"][0]), str(j["links"][1]))) for name, j in self.joints.items()},
            drawings=cache(plans.drawings),
            charts=cache(plans.charts),
            polodes=cache(plans.polodes),
            overlays=cache(plans.overlays),
        )


def _last(path: str) -> str:
    """The name at the end of an entity's path, unescaped."""
    return parts_of(path)[-1]


def _columns(values: Real) -> Callable[[], Real]:
    return lambda: values


def _strips(strips: tuple[Real, ...], row_of: NDArray[np.int64], frames: NDArray[np.int64]) -> tuple[Real, ...]:
    return tuple(strip[row_of[frames]] for strip in strips)


def _with_length(vectors: Real) -> Real:
    return np.column_stack([vectors, np.hypot(vectors[:, 0], vectors[:, 1])])


def _largest(values: Real) -> float:
    return float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))


def _telling(quantities: tuple[Quantity, ...], frames: int) -> int:
    """Where reactions and driving efforts together come nearest to their peaks, else an eighth of the run."""
    load = np.zeros(frames)
    for q in quantities:
        if q.label.endswith((": reaction", ": torque")) or (q.label.startswith("drive ") and q.label.endswith(": force")):
            size = np.nan_to_num(np.abs(q.values()[:, -1]), posinf=0.0)
            load += size / max(float(size.max(initial=0.0)), 1e-300)
    return int(np.argmax(load)) if np.any(load) else frames // 8
