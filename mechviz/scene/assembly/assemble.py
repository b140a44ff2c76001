"""From a scene document to the mechanism that the core computes: SI units, every name resolved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from mechcore.dynamics.events import with_slot_ends
from mechcore.errors import Fault, MechanismError
from mechcore.forces.cam_rating import Solved, prescribed, with_least_sizes
from mechcore.laws.timed import Free, Law, moves
from mechcore.records import dataclass
from mechcore.reduction.bodies import RigidBody
from mechcore.spec.clearance import Clearance, with_clearances
from mechcore.spec.mechanism import CamJoint, Drive, Link, Mechanism, Planar, coordinates_of, friction_of
from mechcore.texts import as_length
from mechviz.scene.assembly.links import (
    Placement,
    drawn_bodies,
    drawn_links,
    drawn_outline,
    links_that_cannot_turn,
    mass_properties,
    place_links,
    shaft_faults,
)
from mechviz.scene.assembly.simulation import (
    REACHABLE,
    SimulationSpec,
    free_law,
    planar_starts,
    simulation_faults,
    simulation_spec,
    standstill,
    stated_duration,
    with_oscillations,
)
from mechviz.scene.convert import Converter, JoinedSegments, probable_coordinate
from mechviz.scene.document import SceneDocument
from mechviz.scene.faults import MOST_SOUGHT, document_path, first_ones, listing
from mechviz.scene.folder import SceneFolder
from mechviz.scene.kinds.drive_laws import law_of, laws_under_forces
from mechviz.scene.kinds.drives import DriveDocument
from mechviz.scene.kinds.friction import clearances_of, idle_effect
from mechviz.scene.kinds.joints.cam_documents import LEAST
from mechviz.scene.kinds.joints.document import JointDocument, check_joints, drawn_place, joint_spec, modes_of
from mechviz.scene.kinds.kind import drawn_angle
from mechviz.scene.kinds.loads.document import check_loads, load_specs
from mechviz.scene.kinds.settings import accuracy_faults
from mechviz.scene.kinds.studies import axis_faults, needs_inertia, studies_of
from mechviz.scene.names import check_names, split_point
from mechviz.scene.reading.recovery import Reading
from mechviz.scene.reading.references import (
    check_joining,
    check_link_names,
    check_references,
    check_trace,
    links_repaired,
    resolve_trace,
    sketch_repaired,
    touched_links,
)


@dataclass(frozen=True)
class AssembledScene:
    """The mechanism of a scene, how its motion is found where forces decide it, and what kinds of quantities its values are."""

    mechanism: Mechanism
    simulation: SimulationSpec | None
    kinds: Mapping[str, str]  # by paths such as links.crank.points.B[0]
    curves: Mapping[str, JoinedSegments]  # by paths such as joints.K.profile.lift


def assemble_scene(
    reading: Reading, name: str, folder: SceneFolder, outlines: Mapping[str, RigidBody] | None = None
) -> tuple[AssembledScene | None, list[Fault]]:
    """The mechanism and its settings, or None, and every fault beside those of form in ``reading.faults``.

    Parts that could not be read are left out; the rest is still converted, since that shows further faults. Files are read from the
    scene's ``folder``. ``outlines``: the drawn bodies of links whose mass follows from their outline; they are computed here once
    everything else is known.
    """
    faults, repaired = _named(reading)
    if repaired is None:
        return None, faults
    reading = repaired
    faults += check_joints(reading)
    touched = {
        key: touched_links(reading, key, joint) for key, joint in (reading.document.joints | reading.kindless_joints).items()
    }
    certain = not reading.kindless_joints and all(sure for _, sure in touched.values())
    joined = {
        key: links
        for key, (links, _) in touched.items()
        if key in reading.kindless_joints or reading.document.joints[key].traits.places_link
    }
    faults += [*check_joining(reading, joined), *first_ones(check_trace(reading, certain=certain))]
    document = reading.document
    convert = Converter.of(document.units, folder)
    placement = place_links(document, convert)
    parallel = links_that_cannot_turn(document, touched)
    drawn = outlines or {}
    links = [
        made
        for key in document.links
        if (made := _link(reading, key, placement, convert, can_turn=key not in parallel, drawn=drawn.get(key))) is not None
    ]
    made_joints = [
        joint_spec(key, joint, document, placement, convert) for key, joint in document.joints.items() if len(joint.kinds) == 1
    ]
    joints = [joint for joint in made_joints if joint is not None]
    if not reading.faults:
        idle_effect(document.effects, document.joints, [friction_of(joint) for joint in joints], convert)
    moved = document.joints | reading.kindless_joints
    driven = {key: joint.drive for key, joint in moved.items() if joint.drive is not None}
    run_duration = stated_duration(document, Converter.of(document.units, folder))  # its faults are noted where the run is read
    laws = _drive_laws(document, moved, driven, run_duration, placement, convert)
    starts = _free_starts(moved, placement, convert)
    convert.faults += laws_under_forces(laws, run_duration) if starts else ()
    own_laws = {**laws, **starts}
    drives = [Drive(joint=name, law=own_laws[name]) for joint in joints for name in coordinates_of(joint) if name in own_laws]
    drives.sort(key=lambda drive: not moves(drive.law))  # a moving drive is the first: a run is shown against it
    moving = [name for name, law in laws.items() if moves(law)]
    if document.reduced and len(moving) > 1:
        why = f"drives {listing(moving)} move: the energy of the scene does not depend on one speed alone."
        convert.faults.append(Fault("reduced", why, "Leave it out, or let all drives but one stand still."))
    watched = {w.point: at for w in document.watch.values() if w.point and (at := split_point(reading, w.point)) is not None}
    faults += simulation_faults(reading)
    simulation = simulation_spec(document, starts, convert, watched)
    still = 0.0 if simulation is not None or len(laws) < len(driven) else standstill(document, laws.values(), convert)
    leader = next((name for name in moved if name in own_laws and moves(own_laws[name])), None)
    loads = {key: load_specs(key, load, reading, convert, leader) for key, load in document.loads.items()}
    studies = studies_of(document, placement, {link.name: link.centre for link in links}, convert)
    gravity = convert.vector(document.gravity, "gravity", "gravity")
    faults += accuracy_faults(document, starts, convert)
    clearances = clearances_of(document, convert)
    faults += convert.faults
    if faults or reading.faults:
        return None, faults
    if not all(loads.values()):
        raise RuntimeError("a load of the scene was lost without a fault")
    traced = [place for text in document.trace if not isinstance(place := resolve_trace(reading, text), Fault)]
    mechanism = Mechanism(
        name=name,
        frame=document.frame,
        links=tuple(links),
        joints=tuple(joints),
        drives=tuple(drives),
        loads=tuple(load for made in loads.values() for load in made),
        effects=tuple(document.effects),
        metrics=tuple(document.metrics),
        studies=studies,
        gravity=gravity,
        modes=modes_of(document),
        sketch={key: pose for key, pose in placement.poses.items() if key != document.frame},
        traced=tuple(traced),
        standstill=still,
    )
    faults = [*axis_faults(mechanism), *shaft_faults(mechanism, document, convert)]
    if faults:
        return None, faults
    mechanism, faults = with_oscillations(mechanism, [key for key, drive in driven.items() if drive.range == REACHABLE])
    if faults:
        return None, faults
    if outlines is None and drawn_links(document):
        return assemble_scene(reading, name, folder, drawn_bodies(mechanism, document))
    if faults := _least_roller_faults(document):
        return None, faults
    mechanism, faults = _sized(mechanism, document, simulation, clearances)
    if faults:
        return None, faults
    mechanism = with_clearances(mechanism, clearances)
    if simulation is not None and mechanism.ends:
        simulation = replace(simulation, stops=with_slot_ends(mechanism, simulation.stops))
    return AssembledScene(mechanism, simulation, convert.kinds, convert.curves), []


def _named(reading: Reading) -> tuple[list[Fault], Reading | None]:
    """Faults of the names in a reading, and the reading with misspelt names repaired; None in its place where there are too many
    faults to search for more."""
    faults = [*first_ones(check_link_names(reading)), *first_ones(check_names(reading))]
    if len(faults) + len(reading.faults) > MOST_SOUGHT:
        return faults, None
    if faults or reading.faults:
        reading = links_repaired(reading)
    faults += [*first_ones(check_loads(reading)), *first_ones(check_references(reading))]
    if len(faults) > MOST_SOUGHT:
        return faults, None
    return faults, sketch_repaired(reading) if faults else reading


def _link(
    reading: Reading, key: str, placement: Placement, convert: Converter, *, can_turn: bool, drawn: RigidBody | None
) -> Link | None:
    """A link with its masses; None where it has no point, or where a part of the scene that it needs could not be read.

    ``drawn``: its solid, where its mass follows from that.
    """
    document = reading.document
    link, points = document.links[key], placement.points.get(key, {})
    named = [name for name in document.effects if name != "friction"]  # which needs no mass
    needed = [*named, *(["inertia"] if needs_inertia(document, key) else [])]
    effects = () if key == document.frame else tuple(dict.fromkeys(needed))
    try:
        mass, centre, inertia = mass_properties(key, link, points, effects, convert, can_turn=can_turn, drawn=drawn)
    except (ArithmeticError, AssertionError, LookupError, TypeError, ValueError):
        if not reading.faults:
            raise
        return None  # caused by a part that could not be read, whose fault is noted already
    if not points:
        return None
    gravity = None if link.gravity is None else convert.vector(link.gravity, "gravity", f"links.{key}.gravity")
    plane = convert.si(link.plane, "length", f"links.{key}.plane")
    made = Link(name=key, points=points, mass=mass, centre=centre, inertia=inertia, gravity=gravity, plane=plane)
    if link.outline is not None:
        made = replace(made, outline=drawn_outline(key, link.outline, document, placement, convert))
    if link.colour is not None and link.has_valid("colour"):
        red, green, blue = bytes.fromhex(link.colour[1:])
        made = replace(made, colour=(red, green, blue))
    return made


def _drive_laws(
    document: SceneDocument,
    joints: Mapping[str, JointDocument],
    driven: Mapping[str, DriveDocument],
    run_duration: float | None,
    placement: Placement,
    convert: Converter,
) -> dict[str, Law]:
    """The laws of the drives of ``joints``, by joint; faults are noted in ``convert``. ``run_duration`` in [s]."""
    laws: dict[str, Law] = {}
    masters: dict[str, Law | None] = {}
    for key in sorted(driven, key=lambda k: driven[k].program is not None):  # programs may follow the others
        joint, path = joints[key], f"joints.{key}.drive"
        clear = joint.traits.driven if len(joint.kinds) == 1 else ""
        coordinate_kind = clear or probable_coordinate(driven[key])
        drawn = drawn_angle(joint, placement) if clear == "angle" else 0.0
        law = law_of(
            driven[key],
            coordinate_kind,
            convert,
            path,
            drawn=drawn,
            cycles=document.run.cycles,
            run_duration=run_duration,
            masters=masters,
            drives=driven,
        )
        if law is not None:
            _check_length(joint, law, convert, path)
            laws[key] = law
        if coordinate_kind == "angle" and driven[key].program is None and driven[key].range != REACHABLE:
            masters[key] = law
    return laws


def _free_starts(joints: Mapping[str, JointDocument], placement: Placement, convert: Converter) -> dict[str, Free]:
    """Initial positions and speeds of the free coordinates of ``joints``, by coordinate; faults are noted in ``convert``."""
    starts: dict[str, Free] = {}
    for key, joint in joints.items():
        if joint.free is None or len(joint.kinds) != 1:
            continue
        path = f"joints.{key}.free"
        if joint.traits.is_planar:
            names, drawn_at = Planar(name=key, links=joint.links).coordinates, drawn_place(joint, placement)
            starts |= planar_starts(joint.free, names, convert, path, drawn=drawn_at)
        elif joint.drive is None:
            coordinate_kind = joint.traits.driven
            drawn = drawn_angle(joint, placement) if coordinate_kind == "angle" else 0.0
            start = free_law(joint.free, coordinate_kind or probable_coordinate(joint.free), convert, path, drawn=drawn)
            if start is not None:
                _check_length(joint, start, convert, path)
                starts[key] = start
    return starts


def _least_roller_faults(document: SceneDocument) -> list[Fault]:
    """Faults of least rollers of links whose mass follows from their drawn outline, since that depends on the roller."""
    faults = []
    for key, joint in document.joints.items():
        if joint.follower is None or joint.follower.roller != LEAST:
            continue
        drawn = [link for link in joint.links if link in drawn_links(document)]
        if drawn:
            why = f"the mass of '{drawn[0]}' follows from what is drawn, and that from the roller."
            faults.append(Fault(f"joints.{key}.follower.roller", why, "Give its radius."))
    return faults


def _sized(
    mechanism: Mechanism, document: SceneDocument, simulation: SimulationSpec | None, clearances: Mapping[str, Clearance]
) -> tuple[Mechanism, list[Fault]]:
    """The mechanism with the least sizes of its cams, and the faults of these. Where forces determine the motion, each roller that
    is tried has a motion of its own."""
    solved: Callable[[Mechanism], Solved] = prescribed
    if simulation is not None and any("roller" in p.least for p in mechanism.joints if isinstance(p, CamJoint)):
        from mechviz.scene.assembly.under_forces import solver  # most scenes need no motion to be read

        solved = solver(simulation, clearances)
    try:
        return with_least_sizes(mechanism, solved), []
    except MechanismError as error:
        return mechanism, [Fault(document_path(document, f.path), f.message, f.remedy) for f in error.faults]


def _check_length(joint: JointDocument, law: Law, convert: Converter, path: str) -> None:
    """The drive of a cylinder prescribes the distance of two points, which has to be positive."""
    start = float(law(0.0)[0])
    if joint.kinds == ["cylinder"] and start <= 0.0:
        convert.note(
            path,
            f"the cylinder's length starts at {as_length(start)}.",
            "Its coordinate is the distance of its two points: give a start, range or centre that is positive.",
        )
