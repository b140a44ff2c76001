"""Content of a recording: its families of entities, its properties, its notes."""

from __future__ import annotations

import cmath
import json
import re
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from mechcore.forces.powers import power_labels, power_table
from mechcore.records import dataclass
from mechviz.accuracy.fit import target_lines
from mechviz.outputs.drawings import Diagram, diagram_shapes, diagram_streams, polygon_shapes, polygon_streams, polygon_views
from mechviz.outputs.rerun.blueprint import BACKGROUND_COLOR
from mechviz.outputs.rerun.entities import Static, Stream, entity, link_streams, magnification, table_streams, view_statics
from mechviz.outputs.rerun.nodes import legend_shapes, nodes_json, picture_statics, picture_streams
from mechviz.outputs.rerun.plots import lane_styles, plot_streams, plot_styles
from mechviz.picture.constructions import Drawing
from mechviz.picture.nodes import Picture
from mechviz.picture.overlays import overlay_box
from mechviz.quantities.catalogue import Catalogue
from mechviz.quantities.items import ItemTable, links_of, links_with_mass
from mechviz.quantities.power_table import power_markdown, steady_lines
from mechviz.quantities.study_tables import study_lines
from mechviz.quantities.vectors import Scales
from mechviz.runs import Run, Stage, package_version
from mechviz.scene.reading.formulas import parameter_words
from mechviz.studies.equations import equation_table

if TYPE_CHECKING:
    import rerun as rr

    from mechcore.kinematics.model import Model
    from mechviz.meshes.solids import Solids


@dataclass(frozen=True, eq=False)
class Content:
    """Data from which the entities of all families are made."""

    run: Run
    solids: Solids
    tables: list[ItemTable]
    picture: Picture
    drawings: dict[str, Drawing]  # graphical constructions
    every: int  # arrows and drawings are recorded at every ``every``-th frame
    diagrams: Sequence[Diagram] = ()  # of one quantity over another


def _nothing(_: Content) -> Iterable[Any]:
    return ()


@dataclass(frozen=True)
class EntityFamily:
    """Entities that belong together: rows over the frames, static archetypes, and views of the blueprint beside the plots."""

    name: str
    streams: Callable[[Content], Iterable[Stream]] = _nothing
    statics: Callable[[Content], Iterable[Static]] = _nothing
    views: Callable[[Content], Iterable[Any]] = _nothing


ENTITY_FAMILIES: tuple[EntityFamily, ...] = (
    EntityFamily("links", streams=lambda c: link_streams(c.run), statics=lambda c: view_statics(c.picture.size)),
    EntityFamily("data", streams=lambda c: table_streams(c.tables, c.run.resolved_accuracy.numbers)),
    EntityFamily("picture", streams=lambda c: picture_streams(c.picture, c.every), statics=lambda c: picture_statics(c.picture)),
    EntityFamily("lanes", statics=lambda c: lane_styles(c.run)),
    EntityFamily("legend", statics=lambda c: legend_shapes(c.picture, overlay_box(c.run, c.solids), c.run.scene.units)),
    EntityFamily("plots", streams=lambda c: plot_streams(c.run, c.every), statics=lambda c: plot_styles(c.run, c.tables)),
    EntityFamily("diagrams", streams=lambda c: diagram_streams(c.diagrams, c.every), statics=lambda c: diagram_shapes(c.diagrams)),
    EntityFamily(
        "polygons",
        streams=lambda c: polygon_streams(c.drawings, c.every),
        statics=lambda c: polygon_shapes(c.drawings, c.picture.size),
        views=lambda c: polygon_views(c.drawings, magnification(c.solids.size), BACKGROUND_COLOR),
    ),
)
"""The families, in the order of writing."""


def find_streams(content: Content) -> list[Stream]:
    """The streams of all families."""
    return [stream for family in ENTITY_FAMILIES for stream in family.streams(content)]


def find_statics(content: Content) -> list[Static]:
    """The static archetypes of all families."""
    return [static for family in ENTITY_FAMILIES for static in family.statics(content)]


def find_views(content: Content) -> list[Any]:
    """The views of all families."""
    return [view for family in ENTITY_FAMILIES for view in family.views(content)]


# -- properties of links ----------------------------------------------------------------------------------------------
OBLIQUE_DIRECTION = cmath.exp(1j)
"""Direction to the reference point relative to the line of the joints: oblique to this line and to its perpendicular."""


def link_properties(run: Run) -> dict[str, tuple[float, float, float, float]]:
    """Mass [kg], reference point x, y in the link frame [m] and moment of inertia about it [kg m^2] of every moving link.

    The reference point is the centre of mass. For a link whose mass has no effect (it is 0, or neither inertia nor gravity is among
    the effects), moments may be balanced about any point. About a point on the line of its joints, the terms of the balance would
    be mere round-off for a two-force member, such as a rod or a cylinder. So the point lies beside this line: the balance is then a
    small sum of large terms.
    """
    model = run.motion.model
    heavy = set(links_with_mass(run))
    properties = {}
    for name in links_of(run.motion)[1:]:
        k = model.index[name]
        mass, centre, inertia = model.masses[k]
        if name not in heavy:
            mass, centre, inertia = 0.0, _reference_point(model, k), 0.0
        properties[name] = (mass, centre.real, centre.imag, inertia)
    return properties


def _reference_point(model: Model, k: int) -> complex:
    """A point [m] in the frame of link ``k`` beside the line of its joints, at a distance of about the length of the link.

    If all joints coincide: beside its guide, at a distance of the size of the mechanism.
    """
    own = [(j, 0 if p == k else 1) for j, (p, q) in enumerate(model.ends) if k in (p, q)]
    at = [model.joints[j].b if side else model.joints[j].a for j, side in own]
    span = max((b - a for a in at for b in at), key=abs)
    if abs(span) <= 1e-9 * model.length_scale:
        guides = [model.joints[j].slide for j, side in own if model.joints[j].guide == side]
        direction = next((d for d in guides if d is not None), 1 + 0j)
        span = model.length_scale * direction / abs(direction)
    return sum(at) / len(at) + span * OBLIQUE_DIRECTION


def property_statics(run: Run) -> Iterator[Static]:
    """Mass properties for balances of the moving links, see `link_properties`; nothing for a run without reactions."""
    import rerun as rr

    for name, values in link_properties(run).items() if run.forces is not None else ():
        yield Static(entity("data", "links", name, "properties"), rr.Scalars(values))


# -- properties and notes ---------------------------------------------------------------------------------------------
RECORDING_SCHEMA = 2
"""Version of the recording contract, incremented when the meaning of an entry changes."""


def describe_run(
    stream: rr.RecordingStream, run: Run, solids: Solids, picture: Picture, stages: list[Stage], every: int, *, complete: bool
) -> None:
    """Send properties, scene and notes: at the start, so that an interrupted recording has them; properties and notes again when it
    is ``complete``."""
    import rerun as rr

    spent = [*run.stages, *stages]
    wall = float(sum(s.seconds for s in spent))
    stream.send_property("mechviz", rr.AnyValues(**_properties(run, picture, wall, complete=complete)))
    if not complete:
        stream.log("scene", rr.TextDocument(scene_text(run)), static=True)
    text = notes(run, solids, picture.scales, spent, every, complete=complete)
    stream.log("notes", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)


def scene_text(run: Run) -> str:
    """The scene as TOML: the text of its file, if there is one."""
    return getattr(run.scene, "text", "") or run.scene.to_toml()


def _scene_files(run: Run) -> dict[str, str]:
    """The files that the scene refers to, by name, in base64: with them the scene can be run again from the recording alone."""
    return {name: b64encode(data).decode("ascii") for name, data in run.scene.files.items()}


def model_json(run: Run) -> str:
    """The connectivity that a reader needs to check the physics, as JSON."""
    n = run.numbers
    model = {
        "frame": n.frame,
        "links": n.links,
        "joints": {j.name: {"type": j.kind, "links": list(j.links)} for j in n.joints.values()},
        "drives": n.drives,
        "loads": {
            name: {"kind": load.kind, "links": list(load.links), **({"points": load.points} if load.points else {})}
            for name, load in n.loads.items()
        },
        "traced": n.traced,
    }
    return json.dumps(model, ensure_ascii=False)


def _properties(run: Run, picture: Picture, wall_seconds: float, *, complete: bool) -> dict[str, Any]:
    """The recording's properties; lists of strings are arrow arrays, so that an empty list keeps its type."""
    import pyarrow as pa

    scales = picture.scales
    return {
        "schema": RECORDING_SCHEMA,
        "version": package_version(),
        "scene": run.scene.name,
        "title": run.scene.title or run.scene.name,
        "frames": recorded_frames(run),
        "units": json.dumps(vars(run.scene.units)),
        "tolerance": run.numbers.tolerance,
        "length_scale": run.numbers.length_scale,
        "cycle": run.numbers.cycle,
        "size": picture.size,
        "bounds": json.dumps(picture.bounds.tolist()),
        "top": picture.top,
        "picture": nodes_json(picture),
        "quantities": _listed_quantities(run.catalogue),
        "model": model_json(run),
        "effects": pa.array(list(run.plan.effects), pa.string()),
        "skipped": pa.array([s.name for s in run.plan.skipped], pa.string()),
        "newtons_per_metre": scales.newtons_per_metre,
        "newton_metres_per_metre": scales.newton_metres_per_metre,
        "mps_per_metre": scales.mps_per_metre,
        "mps2_per_metre": scales.mps2_per_metre,
        "wall_seconds": wall_seconds,
        **_simulated(run),
        "accuracy": json.dumps(_stated(run)),
        "interpolation": run.accuracy.interpolation,
        "files": json.dumps(_scene_files(run)),
        "power_items": pa.array([] if run.forces is None else power_labels(run.forces), pa.string()),
        "marks": picture.marks,
        "complete": complete,
    }


def _listed_quantities(catalogue: Catalogue) -> str:
    """The catalogue as JSON: key, label, unit, curves and entity of every quantity."""
    entries = [
        {"key": q.key, "label": q.label, "unit": q.unit, "curves": list(q.curves), "entity": entity(*q.path)}
        for q in catalogue.quantities
    ]
    return json.dumps(entries, ensure_ascii=False)


def _stated(run: Run) -> dict[str, Any]:
    """The settings that differ from their defaults, including those chosen for a target error."""
    if run.accuracy.target is None:
        return run.accuracy.changed
    return {**run.resolved_accuracy.changed, "frames": run.motion.frames - 1}


def recorded_frames(run: Run) -> int:
    """Number of frames in the recording of a run."""
    return (run.motion.frames - 1) // run.accuracy.decimation + 1


def accuracy_words(run: Run) -> tuple[str, ...]:
    """Estimates of the errors of a run, as lines of text."""
    worst = run.errors.worst()
    words = ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in worst.items())
    lines = [f"estimated errors, relative: {words}"]
    if run.accuracy.target is not None:
        lines += target_lines(run)
    return tuple(lines)


def _simulated(run: Run) -> dict[str, Any]:
    """Properties of a simulation: duration, method and tolerance; empty for a driven motion."""
    s = run.simulation
    return {} if s is None else {"duration": s.duration, "method": s.method, "motion_tolerance": s.tolerance}


def notes(run: Run, solids: Solids, scales: Scales, stages: list[Stage], every: int, *, complete: bool) -> str:
    """Notes in markdown: computed stages, stages left out with reasons, computing times, accuracy, scales of arrows."""
    scene, plan = run.scene, run.plan
    lines = [f"# {scene.title or scene.name}", "", scene.learning_goal, ""]
    if not complete:
        lines += ["**Unfinished**: writing was interrupted; the frames up to then are here.", ""]
    if scene.document.parameters:
        lines += ["## Parameters", "", *(f"- {line}" for line in parameter_words(scene.document)), ""]
    lines += ["## Computed", "", *(f"- **{s.name}**: {s.why}" for s in plan.computed), ""]
    lines += ["## Left out", "", *(f"- **{s.name}**: {s.why}" for s in plan.skipped), ""]
    studies = study_lines(run)
    if studies:
        lines += ["## Studies", "", *(f"- {line}" for line in studies), ""]
    lines += equation_table(run)
    lines += ["## Cost", "", "| stage | time [ms] |", "|---|---|"]
    lines += [f"| {s.name} | {1e3 * s.seconds:.1f} |" for s in stages]
    length, per = scene.units.display_unit("m", small=True)
    shown = []
    for value, si, what in (
        (scales.newtons_per_metre, "N", "of force per {} of an arrow"),
        (scales.newton_metres_per_metre, "N m", "of moment per {} of an arc's length"),
        (scales.mps_per_metre, "m/s", "of velocity per {} of an arrow"),
        (scales.mps2_per_metre, "m/s^2", "of acceleration per {} of an arrow"),
    ):
        unit, factor = scene.units.display_unit(si)
        shown.append((value * factor / per, f"{unit} {what.format('metre' if length == 'm' else length)}"))
    if run.forces is not None:
        lines += ["", *power_markdown(power_table(run.forces))]
    lines += _simulation_notes(run)
    lines += ["", "## Accuracy", "", *(f"- {line}" for line in accuracy_words(run))]
    lines += ["", "## Scales", "", *(f"- {value:.6g} {what}" for value, what in shown)]
    lines += ["- arrows shorter than 1.5 % of the mechanism's size are not drawn"]
    if every > 1:
        lines += [f"- arrows are drawn at every {every}th frame; all numbers under /data are there at every frame"]
    for a, b in solids.clashes:
        lines += ["", f"The solids of {a} and {b} pass through each other: no order of layers avoids it."]
    return "\n".join(lines) + "\n"


def _simulation_notes(run: Run) -> list[str]:
    """Method, tolerance and energy balance of a simulation, as lines of markdown."""
    s = run.simulation
    if s is None:
        return []
    drift = float(np.abs(s.drift(run.motion.time)).max(initial=0.0))
    how = {"energy": "by its energy, without steps in time", "gauss": "by Gauss collocation", "radau": "by Radau collocation"}
    lines = ["", "## Motion under forces", ""]
    lines.append(f"- found {how.get(s.method, s.method)}, tolerance {s.tolerance:.1e}, {s.evaluations} evaluations of windows")
    lines.append(f"- energy balance of the whole run: drift at most {drift:.1e} of the largest energy or work")
    if run.steady is not None:
        lines += [f"- {line}" for line in steady_lines(run.steady)]
    kinds: dict[str, int] = {}
    for h in s.events:
        kinds[h.kind] = kinds.get(h.kind, 0) + 1
    lines += [f"- {count} × {kind}" for kind, count in kinds.items()]
    return lines


def html_of(text: str) -> str:
    """HTML of a markdown text in the form that `notes` writes."""
    return "\n".join(_blocks(text.splitlines()))


def _blocks(lines: list[str]) -> Iterator[str]:
    k = 0
    while k < len(lines):
        line = lines[k].strip()
        heading = re.match(r"(#{1,4}) +(.*)", line)
        if heading:
            level = len(heading[1]) + 1  # level 1 is the title of the page
            yield f"<h{level}>{_inline(heading[2])}</h{level}>"
            k += 1
        elif line.startswith(("- ", "|")):
            mark = line[0]
            end = next((i for i in range(k, len(lines)) if not lines[i].strip().startswith(mark)), len(lines))
            rows = [row.strip() for row in lines[k:end]]
            yield from _table(rows) if mark == "|" else ["<ul>", *(f"<li>{_inline(row[2:])}</li>" for row in rows), "</ul>"]
            k = end
        else:
            if line:
                yield f"<p>{_inline(line)}</p>"
            k += 1


def _table(rows: list[str]) -> Iterator[str]:
    cells = [[_inline(cell.strip()) for cell in row.strip("|").split("|")] for row in rows if not set(row) <= set("|-: ")]
    yield '<div class="wide"><table>'
    for number, row in enumerate(cells):
        tag = "th" if number == 0 else "td"
        yield "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in row) + "</tr>"
    yield "</table></div>"


def _inline(text: str) -> str:
    text = escape(text)
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", text)
    return re.sub(r"`(.+?)`", r"<code>\1</code>", text)
